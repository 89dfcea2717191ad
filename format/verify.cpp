// Volume::verify: the whole-file check of spec/svol-1.md, section 10.
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

#include "base/interruption.h"
#include "base/run_tasks.h"
#include "format/codes.h"
#include "format/series_index.h"
#include "format/verify_cells.h"
#include "format/volume.h"

namespace splatvol::format {

class Volume::Verifier {
 public:
  Verifier(const Volume& volume, const std::function<void(double)>& progress, std::size_t threads)
      : volume_(volume), info_(volume.info_), progress_(progress), threads_(std::max<std::size_t>(threads, 1)) {
    for (const Attribute& attribute : info_.attributes) bins_.push_back(bins_of(attribute));
  }

  Status run() {
    SPLATVOL_TRY(check_parts());
    SPLATVOL_TRY(check_rows(0));
    SPLATVOL_TRY_ASSIGN(checked, check_chunks(0));
    if (!volume_.series_) SPLATVOL_TRY(check_counted_values(checked.values));
    SPLATVOL_TRY(std::move(checked.nodes));
    return verify_cells(volume_, progress_, threads_);
  }

  /// Checks some of the chunks, and the nodes round them.
  Result<CheckedValues> run_chunks(std::uint64_t part, std::uint64_t parts) const {
    SPLATVOL_TRY_ASSIGN(checked, check_chunks(0, part, parts));
    SPLATVOL_TRY(std::move(checked.nodes));
    return std::move(checked.values);
  }

  Status run_rest(const CheckedValues& values) {
    SPLATVOL_TRY(check_parts());
    SPLATVOL_TRY(check_rows(0));
    SPLATVOL_TRY(check_counted_values(values));
    return verify_cells(volume_, progress_, threads_);
  }

  /// Checks what the step adds.
  Status run_step() {
    SPLATVOL_TRY(check_sections(*volume_.step_part_));
    SPLATVOL_TRY(check_step_summaries());
    SPLATVOL_TRY(verify_cells_of_step(volume_, progress_, threads_));
    SPLATVOL_TRY(check_rows(1));
    SPLATVOL_TRY_ASSIGN(checked, check_chunks(1));
    SPLATVOL_TRY(check_counted_values(checked.values));
    return checked.nodes;
  }

 private:
  // All but rows and nodes.
  Status check_parts() {
    SPLATVOL_TRY(check_footer());
    SPLATVOL_TRY(check_dead_parts());
    SPLATVOL_TRY(check_sections(*volume_.file_));
    SPLATVOL_TRY(volume_.check_boundary());
    return check_index();
  }

  Status check_footer() const {
    SPLATVOL_TRY_ASSIGN(bytes, volume_.read_bytes(volume_.file_bytes() - sizeof(Footer), sizeof(Footer)));
    const auto footer = read_record<Footer>(bytes, 0);
    if (!std::ranges::equal(footer.magic, footer_magic) || footer.file_bytes != volume_.file_bytes() ||
        footer.table_hash != volume_.file_->table_hash() ||
        footer.hash != hash_bytes(std::span(bytes).first(offsetof(Footer, hash))))
      return volume_.broken("footer: checksum mismatch");
    return {};
  }

  // Sections of unknown kinds and dead parts may be long.
  static Result<std::uint64_t> hash_of(const Container& container, std::uint64_t offset, std::uint64_t bytes) {
    return container.read_in_parts(offset, bytes, 1, [](std::span<const std::byte>) { return Status(); });
  }

  // The hash covers sections of unknown kinds too. An extent has no hash: those of its parts cover it.
  static Status check_sections(const Container& container) {
    for (const SectionEntry& section : container.sections()) {
      if (section.codec == Codec::extent) continue;
      SPLATVOL_TRY_ASSIGN(hash, hash_of(container, section.offset, section.packed_bytes));
      if (hash != section.hash)
        return container.broken(fmt::format("section {}: checksum mismatch", static_cast<std::uint32_t>(section.kind)));
    }
    return {};
  }

  Status check_dead_parts() const {
    if (!volume_.series_) return {};
    if (volume_.series_->bytes_behind > 0)
      return fail(ErrorCode::invalid_data,
                  "{}: an append was interrupted: {} bytes behind the end are of no use, and the next append cuts them "
                  "off",
                  volume_.name(), volume_.series_->bytes_behind);
    for (const StepEntry& entry : volume_.series_->entries) {
      if (entry.kind != StepEntryKind::dead) continue;
      if (entry.bytes > max_dead_bytes) return volume_.broken("a dead part is too large [R18]");
      SPLATVOL_TRY_ASSIGN(hash, hash_of(*volume_.file_, entry.offset, entry.bytes));
      if (hash != entry.hash) return volume_.broken("a dead part: checksum mismatch [R18]");
    }
    return {};
  }

  Status check_step_summaries() const {
    for (std::uint32_t number = 0; number < volume_.summaries_.size(); ++number) {
      IndexPage page;
      page.number = number;
      page.nodes.child_masks.resize(volume_.summaries_[number].node_count);
      for (std::size_t attribute = 0; attribute < info_.attributes.size(); ++attribute)
        SPLATVOL_TRY(volume_.read_step_summaries(page, attribute));
    }
    return {};
  }

  Status check_index() {
    SPLATVOL_TRY_ASSIGN(root, volume_.read_index_root({}));
    SPLATVOL_TRY(check_summaries(root_offset(), root));
    SPLATVOL_TRY(check_forest(root, 0));

    std::ranges::sort(pages_);
    std::uint64_t next = 0;
    for (const auto& [offset, bytes] : pages_) {
      if (offset != next) return volume_.broken(untiled_index);
      next += bytes;
    }
    if (next != index_section().packed_bytes) return volume_.broken(untiled_index);
    return {};
  }

  // The nodes of a page are in breadth-first order, so one pass finds the depth of each node before those of its
  // children.
  Status check_forest(const IndexPage& page, std::size_t depth) {
    std::vector<std::size_t> depths(page.nodes.size(), depth);
    for (std::size_t node = 0; node < page.nodes.size(); ++node) {
      if (depths[node] > max_node_depth)
        return fail(ErrorCode::invalid_data, "{}: the index is deeper than {}", volume_.name(), max_node_depth);
      const std::uint8_t mask = page.nodes.child_masks[node];
      if (page.links[node] != IndexPage::no_node)
        SPLATVOL_TRY(
            check_linked_page(page.pages[page.links[node]], mask, page.nodes.counts_of(node), depths[node] + 1));
      else if (mask != 0)
        std::fill_n(depths.begin() + page.first_children[node], std::popcount(mask), depths[node] + 1);
    }
    return {};
  }

  // Limits the walk to the bytes of the section: in a damaged file, many links to one page could make it endless.
  Status check_linked_page(const IndexPageRef& ref, std::uint8_t mask, std::span<const std::uint64_t> counts,
                           std::size_t depth) {
    pages_.emplace_back(ref.offset, ref.page_bytes);
    page_bytes_ += ref.page_bytes;
    if (page_bytes_ > index_section().packed_bytes) return volume_.broken(untiled_index);
    SPLATVOL_TRY_ASSIGN(forest, volume_.read_index_page(ref, mask, counts, {}));
    SPLATVOL_TRY(check_summaries(volume_.index_page_offset(ref), forest));
    return check_forest(forest, depth);
  }

  Status check_summaries(std::uint64_t offset, const IndexPage& page) const {
    if (volume_.series_) return check_number(page);
    for (std::size_t first = 0; first < info_.attributes.size(); first += most_attributes)
      SPLATVOL_TRY(read_summaries(offset, page, first, std::min(first + most_attributes, info_.attributes.size())));
    return {};
  }

  // Reads the summaries of some attributes.
  Result<PageSummaries> read_summaries(std::uint64_t offset, const IndexPage& page, std::size_t first_attribute,
                                       std::size_t end_attribute) const {
    PageSummaries summaries;
    if (first_attribute == end_attribute) return summaries;
    if (volume_.series_) {
      for (std::size_t a = first_attribute; a < end_attribute; ++a) {
        SPLATVOL_TRY_ASSIGN(read, volume_.read_step_summaries(page, a));
        summaries.push_back(std::move(read));
      }
      return summaries;
    }
    SPLATVOL_TRY_ASSIGN(front, volume_.read_bytes(offset, index_table_bytes(info_.attributes.size())));
    const std::uint64_t begin = find_summary_part(front, first_attribute, volume_.node_shape()).offset;
    const auto [last, last_part] = find_summary_part(front, end_attribute - 1, volume_.node_shape());
    SPLATVOL_TRY_ASSIGN(bytes, volume_.read_bytes(offset + begin, last + last_part.packed_bytes - begin));
    for (std::size_t a = first_attribute; a < end_attribute; ++a) {
      const auto [at, part] = find_summary_part(front, a, volume_.node_shape());
      const auto packed =
          std::span<const std::byte>(bytes).subspan(static_cast<std::size_t>(at - begin), part.packed_bytes);
      SPLATVOL_TRY_ASSIGN(read, unpack_summaries(part, packed, page.nodes.size(), volume_.name() + ": index page"));
      summaries.push_back(std::move(read));
    }
    return summaries;
  }

  // A step has summaries of the same nodes.
  Status check_number(const IndexPage& page) const {
    if (page.number >= volume_.summaries_.size() || volume_.summaries_[page.number].node_count != page.nodes.size())
      return fail(ErrorCode::invalid_data, "{}: index page {} has no summaries [R20]", volume_.name(), page.number);
    return {};
  }

  // Chunks follow each other. `directory`: 0: the rows of the file; 1: those of the step.
  Status check_rows(std::size_t directory) const {
    const Container& container = *volume_.directories_[directory].container;
    const SectionEntry& section = *container.find_section(SectionKind::rows);
    const std::uint64_t begin = container.begin() + section.offset;
    const std::uint64_t pages_before = directory == 0 ? 0 : volume_.directories_[0].refs.size();
    std::uint64_t next = begin;
    for (std::size_t number = 0; number < volume_.directories_[directory].refs.size(); ++number) {
      SPLATVOL_TRY_ASSIGN(page, volume_.read_directory_page(pages_before + number));
      for (const ChunkLocation& chunk : page.chunks) {
        if (chunk.offset != next) return volume_.broken(untiled_rows);
        next += chunk.entry.packed_bytes;
      }
      SPLATVOL_TRY(check_interruption());
    }
    return next == begin + section.packed_bytes ? Status() : volume_.broken(untiled_rows);
  }

  // --- The walk: each chunk is decoded once, and the nodes round its points are checked against it.

  // A column at a resolution; one of scope `segment` at all of them.
  struct Unit {
    int column = 0;
    std::optional<std::size_t> resolution = std::nullopt;
  };

  // What a walk checks, and the attributes whose summaries of nodes it needs.
  struct Part {
    std::vector<Unit> units = {};
    std::size_t first_attribute = 0, end_attribute = 0;
  };

  // Numbers of a chunk that nodes are checked against.
  struct Chunk {
    int column = 0;
    std::size_t resolution = 0;
    ValueSummary summary = {};  // of its entry
    std::vector<float> values = {};
    std::vector<ValueInterval> intervals = {};
  };

  // The group of a segment that holds the next point, and its chunks at all resolutions.
  struct Cursor {
    struct Page {
      std::shared_ptr<const DirectoryPage> page = {};  // cursors share those that they have in common
      std::uint64_t number = 0;
    };
    std::uint64_t begin = 0, end = 0;  // numbers of its points in the segment
    PositionCodes positions = {};
    std::vector<Chunk> chunks = {};
    std::vector<Page> pages = {};  // [resolution - segment]
  };

  // An index page with summaries: [attribute - first_attribute][node].
  struct Page {
    IndexPage index;
    PageSummaries summaries;
  };
  struct Node {
    const Page* page = nullptr;
    std::size_t number = 0;
  };

  // The wrong chunk that comes first in the file, and the wrong nodes that are told first (order_of).
  struct Findings {
    static constexpr std::uint64_t nothing = ~std::uint64_t{0};
    std::uint64_t chunk = nothing, contents = nothing;
    Status of_chunk = {}, of_nodes = {};

    void add_chunk(std::uint64_t offset, const Status& status) {
      if (offset < chunk) chunk = offset, of_chunk = status;
    }
    void add_nodes(std::uint64_t of, const Status& status) {
      if (of < contents) contents = of, of_nodes = status;
    }
  };

  // A walk through some leaves of the index, which follow each other, and the points in them.
  struct Walk {
    const Part& part;
    CheckedValues& values;
    std::function<void(std::uint64_t)> progress;  // gets `at`
    std::uint64_t begin, end;                     // of its leaves' first points, in depth-first order
    std::uint64_t at = 0;                         // points before the present node
    std::vector<std::uint64_t> before = {};       // [segment]: the same of each segment
    std::vector<Cursor> cursors = {};             // [segment]
    std::vector<Node> path = {};                  // from the root
    Findings found = {};
    bool has_all = false;  // whether it checks all columns
    Bytes bytes = {};      // of a row, or of one of its chunks
    std::uint64_t bytes_begin = 0;

    // For chunks that nodes are not checked against.
    PositionCodes centroids = {};
    MomentCodes moments = {};
    std::vector<std::uint8_t> depths = {}, counts = {};
    std::vector<std::uint32_t> directions = {};
  };

  struct Checked {
    CheckedValues values;
    Status nodes;
  };

  // Fails with what is wrong with the first chunk, however the work is divided. Does the `share`-th of `shares`.
  Result<Checked> check_chunks(std::size_t directory, std::uint64_t share = 0, std::uint64_t shares = 1) const {
    const std::size_t attributes = info_.attributes.size();
    const CheckedValues none{std::vector<Histogram>(attributes), std::vector<std::uint64_t>(attributes)};
    const std::size_t with_room = 1 + most_bytes_of_sums / (std::max<std::size_t>(attributes, 1) * sizeof(Histogram));
    std::vector<CheckedValues> of_threads(std::min(threads_, with_room), none);

    const std::vector<Part> parts = parts_of(directory);
    const std::uint64_t pieces = pieces_for(std::max<std::uint64_t>(of_threads.size(), shares));
    const auto tasks = static_cast<std::size_t>((parts.size() * pieces + shares - 1 - share) / shares);
    std::vector<Findings> found(tasks);
    const auto check = [&](std::size_t task, std::size_t thread) -> Status {
      const std::uint64_t number = share + task * shares;
      Walk walk =
          start_walk(parts[static_cast<std::size_t>(number / pieces)], number % pieces, pieces, of_threads[thread]);
      const auto report = [&](std::uint64_t at) {
        const auto points = static_cast<double>(std::max<std::uint64_t>(walk.end - walk.begin, 1));
        const double done = static_cast<double>(at - walk.begin) / points;
        progress_((static_cast<double>(task) + std::min(done, 1.0)) / static_cast<double>(tasks));
      };
      if (thread == 0) {
        walk.progress = report;
        report(walk.begin);
      }
      walk.has_all = parts.size() == 1;
      SPLATVOL_TRY_ASSIGN(root, volume_.read_index_root({}));
      SPLATVOL_TRY_ASSIGN(page, with_summaries(std::move(root), root_offset(), walk));
      SPLATVOL_TRY(check_node(page, 0, info_.cube, walk));
      found[task] = std::move(walk.found);
      if (thread == 0) report(walk.end);
      return {};
    };
    SPLATVOL_TRY(run_tasks(tasks, of_threads.size(), check));
    if (tasks > 0) SPLATVOL_TRY(std::ranges::min_element(found, {}, &Findings::chunk)->of_chunk);
    return Checked{sum_of(of_threads),
                   tasks > 0 ? std::ranges::min_element(found, {}, &Findings::contents)->of_nodes : Status()};
  }

  static CheckedValues sum_of(std::vector<CheckedValues>& of_threads) {
    CheckedValues& sum = of_threads[0];
    for (std::size_t thread = 1; thread < of_threads.size(); ++thread)
      for (std::size_t a = 0; a < sum.missing.size(); ++a) {
        sum.missing[a] += of_threads[thread].missing[a];
        std::ranges::transform(sum.histograms[a], of_threads[thread].histograms[a], sum.histograms[a].begin(),
                               std::plus());
      }
    return std::move(sum);
  }

  // Returns in how many pieces the leaves are divided. Two pieces decode the groups that they share.
  [[nodiscard]] std::uint64_t pieces_for(std::uint64_t workers) const {
    if (workers == 1) return 1;
    std::uint64_t shared = 0;
    for (std::size_t resolution = 0; resolution < info_.resolutions(); ++resolution)
      shared += points_of_groups(resolution + 1);
    return std::min(pieces_per_worker * workers, 1 + info_.point_count() / (least_share * shared));
  }

  // Returns the points of a group of each of the coarsest segments.
  [[nodiscard]] std::uint64_t points_of_groups(std::size_t segments) const {
    return std::accumulate(info_.points_per_chunk.begin(),
                           info_.points_per_chunk.begin() + static_cast<std::ptrdiff_t>(segments), std::uint64_t{0});
  }

  // Divides the columns so that a walk holds few chunks, and summaries of few attributes, at once.
  [[nodiscard]] std::vector<Part> parts_of(std::size_t directory) const {
    std::vector<int> columns;
    for (int column = 0; column < static_cast<int>(info_.columns.size()); ++column)
      if (volume_.is_of_step(column) == (directory == 1)) columns.push_back(column);
    // The order in which what is wrong is told. Values come before value moments.
    std::ranges::stable_sort(columns, {}, [&](int column) {
      const Column& of = column_at(column);
      return std::pair(of.attribute, of.kind);
    });
    std::vector<Part> parts;
    std::uint64_t held = 0;
    const auto add = [&](const Unit& unit, std::size_t resolutions) {
      const Column& column = column_at(unit.column);
      const std::uint64_t bytes = points_of_groups(resolutions) * held_bytes(column.kind);
      held += bytes;
      const std::size_t attribute = has_summaries(column.kind) ? static_cast<std::size_t>(column.attribute) : 0;
      if (parts.empty() || held > most_held_bytes || attribute >= parts.back().first_attribute + most_attributes) {
        parts.push_back({{}, attribute, attribute});
        held = bytes;
      }
      parts.back().units.push_back(unit);
      if (has_summaries(column.kind)) parts.back().end_attribute = attribute + 1;
    };
    for (const int column : columns) {
      if (column_at(column).scope == ColumnScope::segment) {
        add({column}, info_.resolutions());
        continue;
      }
      for (std::size_t resolution = 0; resolution < info_.resolutions(); ++resolution)
        add({column, resolution}, resolution + 1);
    }
    return parts;
  }

  [[nodiscard]] const Column& column_at(int column) const { return info_.columns[static_cast<std::size_t>(column)]; }

  static bool has_summaries(ColumnKind kind) { return kind == ColumnKind::value || kind == ColumnKind::value_moments; }

  // Returns the bytes that a walk holds of each point of a chunk.
  static std::uint64_t held_bytes(ColumnKind kind) {
    switch (kind) {
      case ColumnKind::position:
        return 3 * sizeof(std::uint64_t);
      case ColumnKind::value:
        return sizeof(float);
      case ColumnKind::value_moments:
        return sizeof(ValueInterval);
      default:
        return 0;
    }
  }

  [[nodiscard]] Walk start_walk(const Part& part, std::uint64_t piece, std::uint64_t pieces,
                                CheckedValues& values) const {
    const std::uint64_t points = info_.point_count() / pieces, rest = info_.point_count() % pieces;
    const auto begin_of = [&](std::uint64_t number) { return points * number + std::min(number, rest); };
    Walk walk{part, values, {}, begin_of(piece), begin_of(piece + 1)};
    walk.before.resize(info_.resolutions());
    for (std::size_t segment = 0; segment < info_.resolutions(); ++segment) {
      Cursor& cursor = walk.cursors.emplace_back();
      cursor.pages.resize(info_.resolutions() - segment);
      for (std::size_t resolution = segment; resolution < info_.resolutions(); ++resolution)
        for (const Unit& unit : part.units)
          if (unit.resolution.value_or(segment) == resolution) cursor.chunks.push_back({unit.column, resolution});
      std::ranges::sort(cursor.chunks, {},
                        [](const Chunk& chunk) { return std::pair(chunk.resolution, chunk.column); });
    }
    return walk;
  }

  Result<Page> with_summaries(IndexPage index, std::uint64_t offset, const Walk& walk) const {
    SPLATVOL_TRY_ASSIGN(summaries, read_summaries(offset, index, walk.part.first_attribute, walk.part.end_attribute));
    return Page{std::move(index), std::move(summaries)};
  }

  // NOLINTNEXTLINE(misc-no-recursion): no node is deeper than max_node_depth.
  Status check_node(const Page& page, std::size_t node, const Cube& cube, Walk& walk) const {
    const auto counts = page.index.nodes.counts_of(node);
    const std::uint64_t points = std::accumulate(counts.begin(), counts.end(), std::uint64_t{0});
    const bool is_leaf = page.index.nodes.child_masks[node] == 0;
    const bool is_passed = is_leaf ? walk.at < walk.begin : walk.at + points <= walk.begin;
    if (is_passed || walk.at >= walk.end) {
      for (std::size_t segment = 0; segment < counts.size(); ++segment) walk.before[segment] += counts[segment];
      walk.at += points;
      return {};
    }
    if (!walk.path.empty()) check_ranges(walk.path.back(), {&page, node}, walk);
    walk.path.push_back({&page, node});
    if (is_leaf) {
      SPLATVOL_TRY(check_leaf(counts, cube, walk));
      walk.at += points;
    } else {
      SPLATVOL_TRY(check_children(page, node, cube, walk));
    }
    walk.path.pop_back();
    return {};
  }

  // NOLINTNEXTLINE(misc-no-recursion)
  Status check_children(const Page& page, std::size_t node, const Cube& cube, Walk& walk) const {
    const IndexPage& index = page.index;
    const std::uint8_t mask = index.nodes.child_masks[node];
    std::optional<Page> linked;
    if (index.links[node] != IndexPage::no_node) {
      const IndexPageRef& ref = index.pages[index.links[node]];
      SPLATVOL_TRY_ASSIGN(read, volume_.read_index_page(ref, mask, index.nodes.counts_of(node), {}));
      SPLATVOL_TRY_SET(linked, with_summaries(std::move(read), volume_.index_page_offset(ref), walk));
      if (walk.progress && walk.at >= walk.begin) walk.progress(walk.at);
    }
    const Page& below = linked ? *linked : page;
    std::size_t child = linked ? 0 : index.first_children[node];
    for (unsigned octant = 0; octant < 8; ++octant) {
      if ((mask >> octant & 1) == 0) continue;
      const double half = cube.edge / 2;
      const Cube part{cube.origin + half * dvec3(octant & 1, octant >> 1 & 1, octant >> 2), half};
      SPLATVOL_TRY(check_node(below, child++, part, walk));
    }
    return {};
  }

  static const ValueSummary& summary_at(const Node& node, int attribute, const Walk& walk) {
    return node.page->summaries[static_cast<std::size_t>(attribute) - walk.part.first_attribute][node.number];
  }

  // Checks a node against its parent.
  void check_ranges(const Node& parent, const Node& node, Walk& walk) const {
    int last = -1;
    for (const Unit& unit : walk.part.units) {
      const auto [kind, scope, attribute] = column_at(unit.column);
      // With the values, or else with the value moments.
      if (attribute == last || !has_summaries(kind)) continue;
      last = attribute;
      if (kind == ColumnKind::value_moments && info_.find_column(ColumnKind::value, attribute) >= 0) continue;
      if (!holds(summary_at(parent, attribute, walk), summary_at(node, attribute, walk)))
        walk.found.add_nodes(order_of(kind, attribute),
                             volume_.broken("a node of the index has a range that is not in that of its parent"));
    }
  }

  // Returns when it is told what is wrong with the nodes and a column.
  static std::uint64_t order_of(ColumnKind kind, int attribute) {
    const std::uint64_t of_attribute = 2 * static_cast<std::uint64_t>(attribute + 1);
    return kind == ColumnKind::position ? 0 : of_attribute + (kind == ColumnKind::value_moments ? 1 : 0);
  }

  static bool holds(const ValueSummary& outer, const ValueSummary& inner) {
    return inner.min > inner.max ||
           (outer.min <= inner.min && inner.max <= outer.max && (inner.occupancy & ~outer.occupancy) == 0);
  }

  Status check_leaf(std::span<const std::uint64_t> counts, const Cube& cube, Walk& walk) const {
    for (std::size_t segment = 0; segment < counts.size(); ++segment) {
      const Cursor& cursor = walk.cursors[segment];
      std::uint64_t& next = walk.before[segment];
      for (const std::uint64_t end = next + counts[segment]; next < end;) {
        if (next >= cursor.end) SPLATVOL_TRY(read_group(segment, walk));
        const std::uint64_t first = next;
        next = std::min(end, cursor.end);
        // Numbers of a chunk that is wrong mean nothing, and what is wrong with chunks is told first.
        if (walk.found.chunk == Findings::nothing)
          check_points(cursor, static_cast<std::size_t>(first - cursor.begin),
                       static_cast<std::size_t>(next - cursor.begin), cube, walk);
      }
    }
    return {};
  }

  // Reads the group of the segment's next point, and checks its chunks.
  Status read_group(std::size_t segment, Walk& walk) const {
    Cursor& cursor = walk.cursors[segment];
    const std::uint64_t next = walk.before[segment];
    const std::uint64_t number = volume_.rows_.group_at(segment, next);
    const std::uint32_t points = volume_.rows_.group(number).count;
    cursor.begin = next - next % info_.points_per_chunk[segment];
    cursor.end = cursor.begin + points;
    const bool begins_here = next == cursor.begin;  // else, the walk before has checked it, too
    for (auto chunk = cursor.chunks.begin(); chunk != cursor.chunks.end();) {
      const std::size_t resolution = chunk->resolution;
      const std::uint64_t row = volume_.rows_.row(resolution, number);
      Cursor::Page& held = cursor.pages[resolution - segment];
      SPLATVOL_TRY(read_directory_page(volume_.directory_page_of_row(row, chunk->column), walk, held));
      // Reads a row at once if all of it is needed.
      walk.bytes.clear();
      const std::uint64_t row_end = begins_here && walk.has_all ? end_of_row(*held.page, row) : 0;
      for (; chunk != cursor.chunks.end() && chunk->resolution == resolution; ++chunk) {
        if (!begins_here && held_bytes(column_at(chunk->column).kind) == 0) continue;
        const ChunkLocation& location = volume_.find_chunk(*held.page, row, chunk->column);
        chunk->summary = summary_of(location.entry);
        SPLATVOL_TRY_ASSIGN(packed, read_chunk(location, row_end, walk));
        const Status checked = check_chunk(location, packed, points, begins_here, *chunk, cursor, walk);
        if (!checked) walk.found.add_chunk(location.offset, checked);
      }
    }
    return check_interruption();
  }

  [[nodiscard]] std::uint64_t end_of_row(const DirectoryPage& page, std::uint64_t row) const {
    const std::uint64_t chunks = volume_.directories_[page.directory].rows.chunks_before(row + 1) - page.first_chunk;
    const ChunkLocation& last = page.chunks[static_cast<std::size_t>(chunks - 1)];
    return last.offset + last.entry.packed_bytes;
  }

  // Returns the bytes of a chunk, which are valid until the next call. Reads those up to `row_end` with it.
  Result<std::span<const std::byte>> read_chunk(const ChunkLocation& location, std::uint64_t row_end,
                                                Walk& walk) const {
    const std::uint64_t count = location.entry.packed_bytes;
    if (walk.bytes.empty() || location.offset + count > walk.bytes_begin + walk.bytes.size()) {
      const std::uint64_t end = std::min(row_end, location.offset + most_read_bytes);
      SPLATVOL_TRY_SET(walk.bytes,
                       volume_.read_bytes(location.offset, std::max(location.offset + count, end) - location.offset));
      walk.bytes_begin = location.offset;
    }
    return std::span<const std::byte>(walk.bytes)
        .subspan(static_cast<std::size_t>(location.offset - walk.bytes_begin), location.entry.packed_bytes);
  }

  Status read_directory_page(std::uint64_t number, const Walk& walk, Cursor::Page& held) const {
    const auto is_it = [&](const Cursor::Page& other) { return other.page && other.number == number; };
    if (is_it(held)) return {};
    held = {{}, number};
    for (const Cursor& cursor : walk.cursors)
      if (const auto other = std::ranges::find_if(cursor.pages, is_it); other != cursor.pages.end()) {
        held.page = other->page;
        return {};
      }
    SPLATVOL_TRY_ASSIGN(page, volume_.read_directory_page(number));
    held.page = std::make_shared<const DirectoryPage>(std::move(page));
    return {};
  }

  // Decodes a chunk, for the nodes, too. `counts`: whether its values are counted.
  Status check_chunk(const ChunkLocation& location, std::span<const std::byte> packed, std::uint32_t points,
                     bool counts, Chunk& chunk, Cursor& cursor, Walk& walk) const {
    const ChunkEntry& entry = location.entry;
    const std::string what = fmt::format("{}: chunk at {}", volume_.name(), location.offset);
    const Column& column = column_at(chunk.column);
    switch (column.kind) {
      case ColumnKind::position:
        SPLATVOL_TRY(unpack_position_codes(entry, packed, points, info_.cube, what, cursor.positions));
        if (cursor.positions.error > info_.position_error)
          return fail(ErrorCode::invalid_data, "{}: states a larger error than the metadata", what);
        return {};
      case ColumnKind::value:
        chunk.values.resize(points);
        return check_values(entry, packed, chunk, what, counts ? &walk.values : nullptr);
      case ColumnKind::octant:
        walk.depths.resize(points);
        walk.counts.resize(points);
        return unpack_octants(entry, packed, walk.depths, walk.counts, what);
      case ColumnKind::centroid:
        return unpack_centroid_codes(entry, packed, points, info_.cube, what, walk.centroids);
      case ColumnKind::moments:
        return unpack_moment_codes(entry, packed, points, info_.cube.edge, what, walk.moments);
      case ColumnKind::value_moments:
        chunk.intervals.resize(points);
        SPLATVOL_TRY(unpack_value_intervals(entry, packed, chunk.intervals, what));
        if (!all_of(chunk.summary, std::span(std::as_const(chunk.intervals)), column.attribute))
          return fail(ErrorCode::invalid_data, "{}: material has values that its range or occupancy leaves out [R22]",
                      what);
        return {};
      case ColumnKind::gradient:
        walk.directions.resize(points);
        return unpack_gradient_codes(entry, packed, walk.directions, what);
      case ColumnKind::unknown:
        break;
    }
    return check_packed(entry, packed, what);  // chunks of unknown kinds cannot be decoded
  }

  Status check_values(const ChunkEntry& entry, std::span<const std::byte> packed, Chunk& chunk, const std::string& what,
                      CheckedValues* sums) const {
    const int number = column_at(chunk.column).attribute;
    const Attribute& attribute = info_.attributes[static_cast<std::size_t>(number)];
    SPLATVOL_TRY_ASSIGN(error, unpack_values_and_error(entry, packed, chunk.values, what));
    const ValueBins& bins = bins_[static_cast<std::size_t>(number)];
    ValueSummary summary;
    Histogram histogram{};
    std::uint64_t missing = 0;
    for (const float value : chunk.values) {
      if (std::isnan(value)) {
        ++missing;
        continue;
      }
      summary.min = std::min(summary.min, value);
      summary.max = std::max(summary.max, value);
      ++histogram[static_cast<std::size_t>(bins.bin(double{value}))];
    }
    for (std::size_t bin = 0; bin < histogram.size(); ++bin)
      if (histogram[bin] > 0) summary.occupancy |= std::uint64_t{1} << bin;
    if (summary.min != entry.min || summary.max != entry.max || summary.occupancy != entry.occupancy)
      return fail(ErrorCode::invalid_data, "{}: range or occupancy is wrong", what);
    if (error * attribute.scale > attribute.error)
      return fail(ErrorCode::invalid_data, "{}: has a larger error than the metadata state", what);
    if (!sums) return {};
    sums->missing[static_cast<std::size_t>(number)] += missing;
    Histogram& sum = sums->histograms[static_cast<std::size_t>(number)];
    std::ranges::transform(sum, histogram, sum.begin(), std::plus());
    return {};
  }

  // Checks points of a group against the leaf that they are in, and the nodes round it.
  void check_points(const Cursor& cursor, std::size_t begin, std::size_t end, const Cube& cube, Walk& walk) const {
    for (const Chunk& chunk : cursor.chunks) {
      const auto [kind, scope, attribute] = column_at(chunk.column);
      const char* broken = nullptr;
      if (kind == ColumnKind::position) {
        if (!is_in(cube, cursor.positions, begin, end)) broken = "a point lies outside of its node of the index";
      } else if (kind == ColumnKind::value) {
        const ValueSummary& leaf = summary_at(walk.path.back(), attribute, walk);
        if (!holds(leaf, chunk.summary) &&
            !all_of(leaf, std::span(chunk.values).subspan(begin, end - begin), attribute))
          broken = "a value lies outside of the range of its node of the index";
      } else if (kind == ColumnKind::value_moments) {
        const ValueSummary& drawn = summary_at(drawn_alone(walk, chunk.resolution), attribute, walk);
        if (!holds(drawn, chunk.summary) &&
            !all_of(drawn, std::span(chunk.intervals).subspan(begin, end - begin), attribute))
          broken = "material has values that the range or occupancy of its node leaves out [R22]";
      }
      if (broken) walk.found.add_nodes(order_of(kind, attribute), volume_.broken(broken));
    }
  }

  // Returns the smallest node round a leaf that may be drawn at a resolution. No cluster crosses its border.
  static const Node& drawn_alone(const Walk& walk, std::size_t resolution) {
    const auto found = std::find_if(walk.path.rbegin(), walk.path.rend(), [&](const Node& node) {
      return node.page->index.nodes.first_resolutions[node.number] <= resolution;
    });
    return found == walk.path.rend() ? walk.path.front() : *found;
  }

  // Points were sorted before they were rounded.
  bool is_in(const Cube& cube, const PositionCodes& positions, std::size_t begin, std::size_t end) const {
    const double error = info_.position_error + 1e-9 * info_.cube.edge;
    for (int axis = 0; axis < 3; ++axis) {
      const auto [low, high] = positions.range(axis, begin, end);
      if (!(low >= cube.origin[axis] - error && high <= cube.origin[axis] + (cube.edge + error))) return false;
    }
    return true;
  }

  // Whether a summary leaves out none of the values, or of the material's values.
  template <class Number>
  bool all_of(const ValueSummary& summary, std::span<const Number> numbers, int attribute) const {
    return std::ranges::all_of(numbers, [&](const Number& number) { return is_in(summary, number, attribute); });
  }

  bool is_in(const ValueSummary& summary, float value, int attribute) const {
    if (std::isnan(value)) return true;
    const Attribute& of = info_.attributes[static_cast<std::size_t>(attribute)];
    const double error = of.error / of.scale + 1e-6 * std::abs(double{value});
    if (!(value >= summary.min - error && value <= summary.max + error)) return false;
    // The value may have been in any of these bins before it was rounded.
    return is_occupied(summary, value, attribute) ||
           (bins_[static_cast<std::size_t>(attribute)].between(value - error, value + error) & summary.occupancy) != 0;
  }

  // Whether a bin is occupied that overlaps the range and the interval.
  bool is_in(const ValueSummary& summary, const ValueInterval& interval, int attribute) const {
    if (interval.low > interval.high) return true;
    const Attribute& of = info_.attributes[static_cast<std::size_t>(attribute)];
    const double lost = lost_deviation / of.scale;
    const double low = std::max(interval.low - lost, double{summary.min});
    const double high = std::min(interval.high + lost, double{summary.max});
    return low <= high && (is_occupied(summary, low, attribute) ||
                           (bins_[static_cast<std::size_t>(attribute)].between(low, high) & summary.occupancy) != 0);
  }

  bool is_occupied(const ValueSummary& summary, double value, int attribute) const {
    return (summary.occupancy >> bins_[static_cast<std::size_t>(attribute)].bin(value) & 1) != 0;
  }

  Status check_counted_values(const CheckedValues& values) const {
    SPLATVOL_TRY_ASSIGN(histograms, volume_.read_histograms());
    for (std::size_t attribute = 0; attribute < info_.attributes.size(); ++attribute) {
      if (info_.find_column(ColumnKind::value, static_cast<int>(attribute)) < 0) continue;
      if (values.missing[attribute] != info_.attributes[attribute].missing ||
          (!histograms.empty() && values.histograms[attribute] != histograms[attribute]))
        return fail(ErrorCode::invalid_data, "{}: histogram or number of missing values of '{}' is wrong",
                    volume_.name(), info_.attributes[attribute].name);
    }
    return {};
  }

  std::uint64_t root_offset() const { return volume_.file_->find_section(SectionKind::index_root)->offset; }
  const SectionEntry& index_section() const { return *volume_.file_->find_section(SectionKind::index_pages); }

  // That a walk holds of chunks; those of one column and resolution may have more.
  static constexpr std::uint64_t most_held_bytes = std::uint64_t{1} << 22;
  // Whose summaries a walk holds. Files of svbuild with as many take one walk.
  static constexpr std::size_t most_attributes = 16;
  // Of a row, at once.
  static constexpr std::uint64_t most_read_bytes = std::uint64_t{1} << 18;
  // Enough pieces that all threads end at about the same time, each of so many times the points that it shares.
  static constexpr std::uint64_t pieces_per_worker = 8, least_share = 8;
  // A deviation under this, of values, has a variance that is too small for double precision.
  static constexpr double lost_deviation = 0x1p-500;
  // Thousands of attributes have fewer threads.
  static constexpr std::size_t most_bytes_of_sums = std::size_t{1} << 24;
  // A dead part is a step directory and a footer.
  static constexpr std::uint64_t max_dead_bytes = std::uint64_t{1} << 30;
  static constexpr const char* untiled_index = "index pages do not tile their section [R16]";
  static constexpr const char* untiled_rows = "chunks do not tile the rows [R12]";

  const Volume& volume_;
  const VolumeInfo& info_;
  const std::function<void(double)>& progress_;  // called by this thread only
  std::size_t threads_;
  std::vector<ValueBins> bins_;                                 // [attribute]
  std::vector<std::pair<std::uint64_t, std::uint64_t>> pages_;  // offset, bytes
  std::uint64_t page_bytes_ = 0;                                // of all in pages_
};

Result<Volume::CheckedValues> Volume::verify_chunks(std::uint64_t part, std::uint64_t parts,
                                                    const std::function<void(double)>& progress) const {
  return Verifier(*this, progress, 1).run_chunks(part, parts);
}

Status Volume::verify_rest(const CheckedValues& values, const std::function<void(double)>& progress) const {
  return Verifier(*this, progress, 1).run_rest(values);
}

Status Volume::verify(const std::function<void(double)>& progress, std::size_t threads) const {
  const std::size_t steps = series_ ? series_->steps.size() : 0;
  const auto part = [&](std::size_t index) {
    return [&, index](double fraction) {
      progress((static_cast<double>(index) + fraction) / static_cast<double>(steps + 1));
    };
  };
  const std::function<void(double)> of_file = part(0);
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  std::vector<StepRange> ranges(series_ ? series_->ranges.size() : 0, StepRange{nan, nan});
  SPLATVOL_TRY(Verifier(*this, of_file, threads).run());
  for (std::size_t step = 0; step < steps; ++step) {
    SPLATVOL_TRY_ASSIGN(volume, at_step(step));
    const std::function<void(double)> of_step = part(step + 1);
    SPLATVOL_TRY(Verifier(*volume, of_step, threads).run_step());
    for (std::size_t a = 0; a < ranges.size(); ++a)
      include(ranges[a], volume->info().attributes[a].min, volume->info().attributes[a].max);
  }
  for (std::size_t a = 0; a < ranges.size(); ++a)
    if (!is_same(ranges[a], series_->ranges[a]))
      return broken("the step directory has a range that is not that of the steps [R18]");
  return {};
}

}  // namespace splatvol::format
