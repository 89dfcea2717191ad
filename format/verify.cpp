// Volume::verify: the whole-file check of spec/svol-1.md, section 10.
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <glm/vector_relational.hpp>
#include <limits>
#include <numeric>
#include <optional>

#include "base/interruption.h"
#include "base/run_tasks.h"
#include "format/series_index.h"
#include "format/verify_cells.h"
#include "format/volume.h"

namespace splatvol::format {

class Volume::Verifier {
 public:
  Verifier(const Volume& volume, const std::function<void(double)>& progress, std::size_t threads)
      : volume_(volume), info_(volume.info_), progress_(progress), threads_(std::max<std::size_t>(threads, 1)) {}

  Status run() {
    SPLATVOL_TRY(check_parts());
    SPLATVOL_TRY(check_rows(0));
    SPLATVOL_TRY_ASSIGN(values, check_chunks(pages_of(0)));
    SPLATVOL_TRY(volume_.series_ ? check_nodes(positions_only()) : check_nodes_and_values(values, positions_only()));
    return verify_cells(volume_, progress_, threads_);
  }

  /// Checks the chunks of some directory pages.
  Result<CheckedValues> run_chunks(std::uint64_t part, std::uint64_t parts) const {
    std::vector<std::uint64_t> pages;
    for (std::uint64_t page = part; page < volume_.directories_[0].refs.size(); page += parts) pages.push_back(page);
    return check_chunks(pages);
  }

  Status run_rest(const CheckedValues& values) {
    SPLATVOL_TRY(check_parts());
    SPLATVOL_TRY(check_rows(0));
    SPLATVOL_TRY(check_nodes_and_values(values, positions_only()));
    return verify_cells(volume_, progress_, threads_);
  }

  /// Checks what the step adds.
  Status run_step() {
    SPLATVOL_TRY(check_sections(*volume_.step_part_));
    SPLATVOL_TRY(check_step_summaries());
    SPLATVOL_TRY(verify_cells_of_step(volume_, progress_, threads_));
    SPLATVOL_TRY(check_rows(1));
    SPLATVOL_TRY_ASSIGN(values, check_chunks(pages_of(1)));
    return check_nodes_and_values(values, {});
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
    SPLATVOL_TRY(
        check_summaries(volume_.root_ref(), volume_.file_->find_section(SectionKind::index_root)->offset, root));
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
    SPLATVOL_TRY(check_summaries(ref, index_section().offset + ref.offset, forest));
    return check_forest(forest, depth);
  }

  Status check_summaries(const IndexPageRef& ref, std::uint64_t offset, const IndexPage& page) const {
    if (volume_.series_) return check_number(page);
    SPLATVOL_TRY_ASSIGN(bytes, volume_.read_bytes(offset, ref.page_bytes));
    for (std::size_t attribute = 0; attribute < info_.attributes.size(); ++attribute) {
      const auto [part_offset, part] = find_summary_part(bytes, attribute, volume_.node_shape());
      const auto packed = std::span<const std::byte>(bytes).subspan(part_offset, part.packed_bytes);
      SPLATVOL_TRY(unpack_summaries(part, packed, page.nodes.size(), volume_.name() + ": index page"));
    }
    return {};
  }

  // A step has summaries of the same nodes.
  Status check_number(const IndexPage& page) const {
    if (page.number >= volume_.summaries_.size() || volume_.summaries_[page.number].node_count != page.nodes.size())
      return fail(ErrorCode::invalid_data, "{}: index page {} has no summaries [R20]", volume_.name(), page.number);
    return {};
  }

  // Returns the numbers of pages. `directory`: 0: the rows of the file; 1: those of the step.
  [[nodiscard]] std::vector<std::uint64_t> pages_of(std::size_t directory) const {
    std::vector<std::uint64_t> pages(volume_.directories_[directory].refs.size());
    std::iota(pages.begin(), pages.end(), directory == 0 ? 0 : volume_.directories_[0].refs.size());
    return pages;
  }

  // Calls visit(chunk, its column, its points) for the chunks of a page, in the order of the file.
  template <class Visit>
  Status visit_chunks(const DirectoryPage& page, const Visit& visit) const {
    const RowLayout& rows = volume_.rows_;
    std::size_t chunk = 0;
    for (std::uint64_t row = page.first_row; row < volume_.end_row(page); ++row) {
      const Group group = rows.group(rows.group_of_row(row));
      for (const int column : volume_.columns_of_row(page, row))
        SPLATVOL_TRY(visit(page.chunks[chunk++], info_.columns[static_cast<std::size_t>(column)], group.count));
      SPLATVOL_TRY(check_interruption());
    }
    return {};
  }

  // Chunks follow each other.
  Status check_rows(std::size_t directory) const {
    const Container& container = *volume_.directories_[directory].container;
    const SectionEntry& section = *container.find_section(SectionKind::rows);
    const std::uint64_t begin = container.begin() + section.offset;
    std::uint64_t next = begin;
    for (const std::uint64_t number : pages_of(directory)) {
      SPLATVOL_TRY_ASSIGN(page, volume_.read_directory_page(number));
      SPLATVOL_TRY(visit_chunks(page, [&](const ChunkLocation& chunk, const Column&, std::uint32_t) -> Status {
        if (chunk.offset != next) return volume_.broken("chunks do not tile the rows [R12]");
        next += chunk.entry.packed_bytes;
        return {};
      }));
    }
    if (next != begin + section.packed_bytes) return volume_.broken("chunks do not tile the rows [R12]");
    return {};
  }

  Result<CheckedValues> check_chunks(const std::vector<std::uint64_t>& pages) const {
    const std::size_t attributes = info_.attributes.size();
    const CheckedValues none{std::vector<Histogram>(attributes), std::vector<std::uint64_t>(attributes)};
    const std::size_t with_room = 1 + most_bytes_of_sums / (std::max<std::size_t>(attributes, 1) * sizeof(Histogram));
    std::vector<CheckedValues> of_threads(std::min(threads_, with_room), none);
    const auto check_page = [&](std::size_t number, std::size_t thread) -> Status {
      SPLATVOL_TRY_ASSIGN(page, volume_.read_directory_page(pages[number]));
      const auto check = [&](const ChunkLocation& chunk, const Column& column, std::uint32_t points) {
        return check_chunk(chunk, column, points, of_threads[thread]);
      };
      SPLATVOL_TRY(visit_chunks(page, check));
      if (thread == 0) progress_(static_cast<double>(number + 1) / static_cast<double>(pages.size()));
      return check_interruption();
    };
    SPLATVOL_TRY(run_tasks(pages.size(), of_threads.size(), check_page));
    for (std::size_t thread = 1; thread < of_threads.size(); ++thread)
      for (std::size_t a = 0; a < attributes; ++a) {
        of_threads[0].missing[a] += of_threads[thread].missing[a];
        std::ranges::transform(of_threads[0].histograms[a], of_threads[thread].histograms[a],
                               of_threads[0].histograms[a].begin(), std::plus());
      }
    return std::move(of_threads[0]);
  }

  Status check_chunk(const ChunkLocation& location, const Column& column, std::uint32_t points,
                     CheckedValues& sums) const {
    SPLATVOL_TRY_ASSIGN(packed, volume_.read_bytes(location.offset, location.entry.packed_bytes));
    const std::string what = fmt::format("{}: chunk at {}", volume_.name(), location.offset);
    switch (column.kind) {
      case ColumnKind::position:
        return check_positions(location.entry, packed, points, what);
      case ColumnKind::value:
        return check_values(location.entry, packed, points, static_cast<std::size_t>(column.attribute), what, sums);
      case ColumnKind::octant: {
        std::vector<std::uint8_t> depths(points), counts(points);
        return unpack_octants(location.entry, packed, depths, counts, what);
      }
      case ColumnKind::centroid: {
        std::vector<dvec3> centroids(points);
        return unpack_centroids(location.entry, packed, centroids, info_.cube, what);
      }
      case ColumnKind::moments: {
        std::vector<SplatShape> shapes(points);
        return unpack_moments(location.entry, packed, shapes, info_.cube.edge, what);
      }
      case ColumnKind::value_moments:
        return check_value_moments(location.entry, packed, points, column.attribute, what);
      case ColumnKind::gradient: {
        std::vector<vec3> directions(points);
        return unpack_gradients(location.entry, packed, directions, what);
      }
      case ColumnKind::unknown:
        break;
    }
    // Chunks of unknown kinds cannot be decoded.
    if (hash_bytes(packed) != location.entry.hash) return fail(ErrorCode::invalid_data, "{}: checksum mismatch", what);
    return {};
  }

  Status check_positions(const ChunkEntry& entry, std::span<const std::byte> packed, std::uint32_t points,
                         const std::string& what) const {
    std::vector<dvec3> positions(points);
    SPLATVOL_TRY(unpack_positions(entry, packed, positions, info_.cube, what));
    SPLATVOL_TRY_ASSIGN(error, stated_position_error(entry, packed));
    if (error > info_.position_error)
      return fail(ErrorCode::invalid_data, "{}: states a larger error than the metadata", what);
    return {};
  }

  Status check_values(const ChunkEntry& entry, std::span<const std::byte> packed, std::uint32_t points,
                      std::size_t attribute, const std::string& what, CheckedValues& sums) const {
    std::vector<float> values(points);
    SPLATVOL_TRY(unpack_values(entry, packed, values, what));
    const ValueBins bins = bins_of(info_.attributes[attribute]);
    const ValueSummary summary = bins.summarize(values);
    if (summary.min != entry.min || summary.max != entry.max || summary.occupancy != entry.occupancy)
      return fail(ErrorCode::invalid_data, "{}: range or occupancy is wrong", what);
    SPLATVOL_TRY_ASSIGN(error, stated_value_error(entry, packed));
    if (error * info_.attributes[attribute].scale > info_.attributes[attribute].error)
      return fail(ErrorCode::invalid_data, "{}: has a larger error than the metadata state", what);
    for (const float value : values) {
      if (std::isnan(value))
        ++sums.missing[attribute];
      else
        ++sums.histograms[attribute][static_cast<std::size_t>(bins.bin(double{value}))];
    }
    return {};
  }

  Status check_value_moments(const ChunkEntry& entry, std::span<const std::byte> packed, std::uint32_t points,
                             int attribute, const std::string& what) const {
    std::vector<ValueInterval> intervals(points);
    SPLATVOL_TRY(unpack_value_intervals(entry, packed, intervals, what));
    for (const ValueInterval& interval : intervals)
      if (!is_in(summary_of(entry), interval, attribute))
        return fail(ErrorCode::invalid_data, "{}: material has values that its range or occupancy leaves out [R22]",
                    what);
    return {};
  }

  // What the nodes of the index are checked against: a column, of value moments at some resolutions.
  struct Contents {
    ColumnKind kind = ColumnKind::position;
    int attribute = no_attribute;
    std::size_t first_resolution = 0, end_resolution = 0;
  };

  static std::vector<Contents> positions_only() { return {Contents{}}; }

  Status check_nodes_and_values(const CheckedValues& values, std::vector<Contents> contents) const {
    SPLATVOL_TRY(check_counted_values(values));
    for (int attribute = 0; attribute < static_cast<int>(info_.attributes.size()); ++attribute) {
      if (info_.find_column(ColumnKind::value, attribute) >= 0) contents.push_back({ColumnKind::value, attribute});
      if (info_.find_column(ColumnKind::value_moments, attribute) >= 0) add_resolutions(attribute, contents);
    }
    return check_nodes(contents);
  }

  // Divides the resolutions of value moments so that each part holds few chunks at once.
  void add_resolutions(int attribute, std::vector<Contents>& contents) const {
    std::uint64_t held = most_held_intervals;  // the first resolution begins a part
    for (std::size_t resolution = 0; resolution < info_.resolutions(); ++resolution) {
      std::uint64_t points = 0;
      for (std::size_t segment = 0; segment <= resolution; ++segment) points += info_.points_per_chunk[segment];
      if (held + points > most_held_intervals) {
        contents.push_back({ColumnKind::value_moments, attribute, resolution, resolution});
        held = 0;
      }
      held += points;
      contents.back().end_resolution = resolution + 1;
    }
  }

  // The points of a segment, one after the other: their positions, their values, or what a resolution's splats have.
  struct Cursor {
    std::size_t segment = 0, resolution = 0;
    std::uint64_t group = 0;  // the next one
    std::vector<dvec3> positions = {};
    std::vector<float> values = {};
    std::vector<ValueInterval> intervals = {};
    std::size_t at = 0, count = 0;                   // in the chunk
    std::shared_ptr<const DirectoryPage> page = {};  // cursors share those that they have in common
    std::uint64_t page_number = 0;
  };

  // A walk through the index, and through the points in the order of its leaves.
  struct Walk {
    Contents contents;
    std::vector<Cursor> cursors = {};
    std::vector<std::pair<std::uint8_t, ValueSummary>> path = {};  // from the root: first_resolution, and what it holds
  };

  [[nodiscard]] Walk start_walk(const Contents& contents) const {
    Walk walk{contents};
    const auto add = [&](std::size_t segment, std::size_t resolution) {
      walk.cursors.push_back({segment, resolution, volume_.rows_.group_at(segment, 0)});
    };
    if (contents.kind != ColumnKind::value_moments)
      for (std::size_t segment = 0; segment < info_.resolutions(); ++segment) add(segment, segment);
    for (std::size_t resolution = contents.first_resolution; resolution < contents.end_resolution; ++resolution)
      for (std::size_t segment = 0; segment <= resolution; ++segment) add(segment, resolution);
    return walk;
  }

  Status read_group(const Walk& walk, Cursor& cursor) const {
    const Contents& contents = walk.contents;
    const Group group = volume_.rows_.group(cursor.group);
    const std::uint64_t row = volume_.rows_.row(cursor.resolution, cursor.group++);
    const int column = info_.find_column(contents.kind, contents.attribute);
    SPLATVOL_TRY(read_directory_page(walk, volume_.directory_page_of_row(row, column), cursor));
    const ChunkLocation& location = volume_.find_chunk(*cursor.page, row, column);
    SPLATVOL_TRY_ASSIGN(packed, volume_.read_bytes(location.offset, location.entry.packed_bytes));
    const std::string what = fmt::format("{}: chunk at {}", volume_.name(), location.offset);
    cursor.at = 0;
    cursor.count = group.count;
    if (contents.kind == ColumnKind::position) {
      cursor.positions.resize(group.count);
      return unpack_positions(location.entry, packed, cursor.positions, info_.cube, what);
    }
    if (contents.kind == ColumnKind::value_moments) {
      cursor.intervals.resize(group.count);
      return unpack_value_intervals(location.entry, packed, cursor.intervals, what);
    }
    cursor.values.resize(group.count);
    return unpack_values(location.entry, packed, cursor.values, what);
  }

  Status read_directory_page(const Walk& walk, std::uint64_t number, Cursor& cursor) const {
    const auto is_it = [&](const Cursor& other) { return other.page && other.page_number == number; };
    if (is_it(cursor)) return {};
    cursor.page.reset();
    cursor.page_number = number;
    if (const auto other = std::ranges::find_if(walk.cursors, is_it); other != walk.cursors.end()) {
      cursor.page = other->page;
      return {};
    }
    SPLATVOL_TRY_ASSIGN(page, volume_.read_directory_page(number));
    cursor.page = std::make_shared<const DirectoryPage>(std::move(page));
    return {};
  }

  // Checks the nodes of the index against the points in them. Points of a segment are in the order of the leaves.
  Status check_nodes(const std::vector<Contents>& contents) const {
    return run_tasks(contents.size(), threads_, [&](std::size_t number, std::size_t) -> Status {
      Walk walk = start_walk(contents[number]);
      SPLATVOL_TRY_ASSIGN(root, volume_.read_index_root({walk.contents.attribute}));
      return check_node(root, 0, info_.cube, walk);
    });
  }

  // NOLINTNEXTLINE(misc-no-recursion): no node is deeper than max_node_depth.
  Status check_node(const IndexPage& page, std::size_t node, const Cube& cube, Walk& walk) const {
    const int attribute = walk.contents.attribute;
    walk.path.emplace_back(page.nodes.first_resolutions[node],
                           attribute == no_attribute ? ValueSummary{} : page.nodes.summaries[node]);
    SPLATVOL_TRY(check_children(page, node, cube, walk));
    walk.path.pop_back();
    return {};
  }

  // NOLINTNEXTLINE(misc-no-recursion)
  Status check_children(const IndexPage& page, std::size_t node, const Cube& cube, Walk& walk) const {
    const std::uint8_t mask = page.nodes.child_masks[node];
    if (mask == 0) return check_leaf(page.nodes.counts_of(node), cube, walk);
    const int attribute = walk.contents.attribute;
    std::optional<IndexPage> linked;
    if (page.links[node] != IndexPage::no_node) {
      SPLATVOL_TRY_ASSIGN(
          read, volume_.read_index_page(page.pages[page.links[node]], mask, page.nodes.counts_of(node), {attribute}));
      linked = std::move(read);
      SPLATVOL_TRY(check_interruption());
    }
    const IndexPage& below = linked ? *linked : page;
    std::size_t child = linked ? 0 : page.first_children[node];
    for (unsigned octant = 0; octant < 8; ++octant) {
      if ((mask >> octant & 1) == 0) continue;
      if (attribute != no_attribute && !holds(page.nodes.summaries[node], below.nodes.summaries[child]))
        return volume_.broken("a node of the index has a range that is not in that of its parent");
      const double half = cube.edge / 2;
      const Cube part{cube.origin + half * dvec3(octant & 1, octant >> 1 & 1, octant >> 2), half};
      SPLATVOL_TRY(check_node(below, child++, part, walk));
    }
    return {};
  }

  static bool holds(const ValueSummary& outer, const ValueSummary& inner) {
    return inner.min > inner.max ||
           (outer.min <= inner.min && inner.max <= outer.max && (inner.occupancy & ~outer.occupancy) == 0);
  }

  Status check_leaf(std::span<const std::uint64_t> counts, const Cube& cube, Walk& walk) const {
    for (Cursor& cursor : walk.cursors) {
      const ValueSummary& drawn = drawn_alone(walk, cursor.resolution);
      for (std::uint64_t left = counts[cursor.segment]; left > 0; --left, ++cursor.at) {
        if (cursor.at == cursor.count) SPLATVOL_TRY(read_group(walk, cursor));
        SPLATVOL_TRY(check_point(walk, cursor, cube, drawn));
      }
    }
    return {};
  }

  // Returns what the smallest node round a leaf holds that may be drawn at a resolution. No cluster crosses its border.
  static const ValueSummary& drawn_alone(const Walk& walk, std::size_t resolution) {
    const auto found =
        std::find_if(walk.path.rbegin(), walk.path.rend(), [&](const auto& node) { return node.first <= resolution; });
    return found == walk.path.rend() ? walk.path.front().second : found->second;
  }

  Status check_point(const Walk& walk, const Cursor& cursor, const Cube& cube, const ValueSummary& drawn) const {
    const int attribute = walk.contents.attribute;
    switch (walk.contents.kind) {
      case ColumnKind::position:
        if (is_in(cube, cursor.positions[cursor.at])) return {};
        return volume_.broken("a point lies outside of its node of the index");
      case ColumnKind::value_moments:
        if (is_in(drawn, cursor.intervals[cursor.at], attribute)) return {};
        return volume_.broken("material has values that the range or occupancy of its node leaves out [R22]");
      default:
        if (is_in(walk.path.back().second, cursor.values[cursor.at], attribute)) return {};
        return volume_.broken("a value lies outside of the range of its node of the index");
    }
  }

  // Points were sorted before they were rounded.
  bool is_in(const Cube& cube, const dvec3& position) const {
    const double error = info_.position_error + 1e-9 * info_.cube.edge;
    return glm::all(glm::greaterThanEqual(position, cube.origin - error)) &&
           glm::all(glm::lessThanEqual(position, cube.origin + (cube.edge + error)));
  }

  bool is_in(const ValueSummary& summary, float value, int attribute) const {
    if (std::isnan(value)) return true;
    const Attribute& of = info_.attributes[static_cast<std::size_t>(attribute)];
    const double error = of.error / of.scale + 1e-6 * std::abs(double{value});
    if (!(value >= summary.min - error && value <= summary.max + error)) return false;
    // The value may have been in any of these bins before it was rounded.
    const ValueBins bins = bins_of(of);
    for (auto bin = bins.bin(value - error); bin <= bins.bin(value + error); ++bin)
      if ((summary.occupancy >> bin & 1) != 0) return true;
    return false;
  }

  // Whether a bin is occupied that overlaps the range and the interval.
  bool is_in(const ValueSummary& summary, const ValueInterval& interval, int attribute) const {
    if (interval.low > interval.high) return true;
    const Attribute& of = info_.attributes[static_cast<std::size_t>(attribute)];
    const double lost = lost_deviation / of.scale;
    const double low = std::max(interval.low - lost, double{summary.min});
    const double high = std::min(interval.high + lost, double{summary.max});
    return low <= high && (bins_of(of).between(low, high) & summary.occupancy) != 0;
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

  const SectionEntry& index_section() const { return *volume_.file_->find_section(SectionKind::index_pages); }

  static constexpr int no_attribute = -1;
  // That a walk holds at once; one resolution may have more. Files of svbuild take one walk.
  static constexpr std::uint64_t most_held_intervals = std::uint64_t{1} << 20;
  // A deviation under this, of values, has a variance that is too small for double precision.
  static constexpr double lost_deviation = 0x1p-500;
  // Thousands of attributes have fewer threads.
  static constexpr std::size_t most_bytes_of_sums = std::size_t{1} << 24;
  // A dead part is a step directory and a footer.
  static constexpr std::uint64_t max_dead_bytes = std::uint64_t{1} << 30;
  static constexpr const char* untiled_index = "index pages do not tile their section [R16]";

  const Volume& volume_;
  const VolumeInfo& info_;
  const std::function<void(double)>& progress_;  // called by this thread only
  std::size_t threads_;
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
