#include "format/verify_cells.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "base/interruption.h"
#include "base/run_tasks.h"
#include "format/cell_reader.h"
#include "format/ranked_points.h"

namespace splatvol::format {
namespace {

constexpr std::uint64_t held_bytes = std::uint64_t{16} << 20;  // by each thread
constexpr double area_error = 0.01;

bool is_area_of(double stated, double area) { return std::abs(stated - area) <= area_error * area; }

bool is_box(const double (&low)[3], const double (&high)[3], const Box& box) {
  for (int axis = 0; axis < 3; ++axis)
    if (low[axis] != box.low[axis] || high[axis] != box.high[axis]) return false;
  return true;
}

// What the order of cells of one shape is by.
struct CellKey {
  std::uint64_t point = 0;               // of a constant field
  std::span<const std::uint64_t> ranks;  // ascending; of a polyhedron its first, or none
  [[nodiscard]] bool is_before(const CellKey& other) const {
    return point != other.point ? point < other.point : std::ranges::lexicographical_compare(ranks, other.ranks);
  }
};

// The cells that a page begins and ends with.
struct Ends {
  struct Cell {
    CellShape shape{};
    std::uint64_t point = 0;
    std::vector<std::uint64_t> ranks = {};
    Cell() = default;
    Cell(CellShape of, const CellKey& key) : shape(of), point(key.point), ranks(key.ranks.begin(), key.ranks.end()) {}
    [[nodiscard]] CellKey key() const { return {point, ranks}; }
    [[nodiscard]] bool is_before(const Cell& other) const {
      return shape == other.shape && key().is_before(other.key());
    }
  };
  Cell first, last;
};

// The cells of each shape and field. Files may state very many of these.
struct Counts {
  std::uint64_t cells = 0, packed_bytes = 0;
};
using Kinds = std::map<std::pair<CellShape, CellField>, Counts>;

class CellVerifier {
 public:
  CellVerifier(const CellReader& cells, const std::function<void(double)>& progress, std::size_t threads,
               bool of_step = false)
      : cells_(cells),
        volume_(cells.volume()),
        info_(volume_.info()),
        progress_(progress),
        threads_(std::max<std::size_t>(threads, 1)),
        of_step_(of_step),
        points_(cells, own_room(threads_ * held_bytes)),
        vertices_([&cells](std::size_t page) { return cells.read_vertex_page(page); }, own_room(threads_ * held_bytes)),
        ends_(cells.pages().size()),
        kinds_(threads_) {
    // Summaries of a series are in its steps.
    if (!info_.series || of_step_)
      for (const Attribute& attribute : info_.attributes) bins_.push_back(bins_of(attribute));
  }

  // Checks the pages of chunks: all of them, or what the step has of them.
  Status run_pages() {
    const auto check = [&](std::size_t page, std::size_t thread) -> Status {
      SPLATVOL_TRY(check_page(page, thread));
      if (thread == 0) progress_(static_cast<double>(page + 1) / static_cast<double>(cells_.pages().size()));
      return {};
    };
    return run_tasks(cells_.pages().size(), threads_, check);
  }

  Status run() {
    SPLATVOL_TRY(check_ranks());
    for (std::size_t page = 0; page < cells_.vertex_page_count(); ++page) SPLATVOL_TRY(cells_.read_vertex_page(page));
    SPLATVOL_TRY(run_pages());
    for (std::size_t page = 1; page < ends_.size(); ++page)
      if (ends_[page].first.is_before(ends_[page - 1].last)) return unordered();
    return check_kinds();
  }

 private:
  [[nodiscard]] tl::unexpected<Error> broken(std::string_view rule) const {
    return fail(ErrorCode::invalid_data, "{}: {} [R24]", volume_.name(), rule);
  }
  [[nodiscard]] tl::unexpected<Error> unordered() const { return broken("cells are out of order"); }

  // Points of an index leaf have ranks that follow each other.
  Status check_ranks() {
    before_.assign(info_.resolutions(), 0);
    SPLATVOL_TRY_ASSIGN(root, volume_.read_index_root({}));
    SPLATVOL_TRY(check_leaves(root, 0));
    return rank_ == info_.resolution_counts.back() ? Status{} : unlike_index();
  }

  [[nodiscard]] tl::unexpected<Error> unlike_index() const {
    return broken("the ranks of the points are not those of the index");
  }

  // NOLINTNEXTLINE(misc-no-recursion): no node is deeper than max_node_depth.
  Status check_leaves(const IndexPage& page, std::size_t node) {
    const std::uint8_t mask = page.nodes.child_masks[node];
    if (mask == 0) return check_leaf(page.nodes.counts_of(node));
    std::optional<IndexPage> linked;
    if (page.links[node] != IndexPage::no_node) {
      SPLATVOL_TRY_SET(linked,
                       volume_.read_index_page(page.pages[page.links[node]], mask, page.nodes.counts_of(node), {}));
      SPLATVOL_TRY(check_interruption());
    }
    const IndexPage& below = linked ? *linked : page;
    const std::size_t first = linked ? 0 : page.first_children[node];
    for (std::size_t child = 0; child < static_cast<std::size_t>(std::popcount(mask)); ++child)
      SPLATVOL_TRY(check_leaves(below, first + child));
    return {};
  }

  Status check_leaf(std::span<const std::uint64_t> counts) {
    std::vector<std::uint64_t> left(counts.begin(), counts.end());
    for (std::uint64_t count = std::accumulate(left.begin(), left.end(), std::uint64_t{0}); count > 0;
         --count, ++rank_) {
      if (rank_ >= info_.resolution_counts.back()) return unlike_index();
      if (rank_ % rank_page_points == 0) {
        SPLATVOL_TRY_ASSIGN(page, cells_.read_rank_page(static_cast<std::size_t>(rank_ / rank_page_points)));
        if (page.before != before_) return unlike_index();
        segments_ = std::move(page.segments);
      }
      const std::size_t segment = segments_[rank_ % rank_page_points];
      ++before_[segment];
      if (left[segment]-- == 0) return unlike_index();
    }
    return {};
  }

  Status check_page(std::size_t number, std::size_t thread) {
    SPLATVOL_TRY_ASSIGN(page, cells_.read_page(number, {}));
    std::vector<std::vector<ValueSummary>> summaries;
    for (std::size_t a = 0; a < bins_.size(); ++a) {
      SPLATVOL_TRY_ASSIGN(read, cells_.read_page(number, {static_cast<int>(a), -1}));
      summaries.push_back(std::move(read.summaries));
    }
    Box box;
    double area = 0;
    for (std::size_t chunk = 0; chunk < page.chunks.size(); ++chunk) {
      const CellChunkEntry& entry = page.chunks[chunk];
      box.include(dvec3(entry.low[0], entry.low[1], entry.low[2]));
      box.include(dvec3(entry.high[0], entry.high[1], entry.high[2]));
      area += entry.area;
      count(entry, thread);
      SPLATVOL_TRY(check_chunk(entry, ends_[number], [&](std::size_t a) { return summaries[a][chunk]; }));
      SPLATVOL_TRY(check_interruption());
    }
    const CellPageRef& ref = cells_.pages()[number];
    if (!is_box(ref.low, ref.high, box) || !is_area_of(ref.area, area))
      return broken("the box or area of a page of cells is wrong");
    return {};
  }

  void count(const CellChunkEntry& entry, std::size_t thread) {
    Counts& counts = kinds_[thread][{entry.shape, entry.field}];
    counts.cells += entry.cells;
    counts.packed_bytes += entry.packed_bytes;
  }

  template <class SummaryOf>
  Status check_chunk(const CellChunkEntry& entry, Ends& ends, const SummaryOf& summary_of) const {
    if (!is_known(entry.shape, entry.field)) return cells_.check_bytes(entry);
    SPLATVOL_TRY_ASSIGN(cells, cells_.read_chunk(entry));
    // Steps have the same cells: order and extent are checked once.
    if (!of_step_) SPLATVOL_TRY(check_order(cells, ends));
    const bool is_constant = cells.field == CellField::constant;
    const LocalCells local = number_corners(cells.corners);
    std::vector<RankedPoints::Place> places;
    if (!is_constant) SPLATVOL_TRY_SET(places, find_points(local.ranks));
    if (!of_step_) SPLATVOL_TRY(check_extent(cells, entry, local, places));
    if (is_constant) SPLATVOL_TRY_SET(places, find_points(cells.points));
    std::vector<float> values;
    for (std::size_t a = 0; a < bins_.size(); ++a) {
      if (info_.find_column(ColumnKind::value, static_cast<int>(a)) < 0) continue;
      SPLATVOL_TRY(points_.read_values(places, static_cast<int>(a), values));
      SPLATVOL_TRY(check_summary(
          is_constant ? bins_[a].summarize(values) : summarize_cells(cells, local, values, bins_[a]), summary_of(a)));
    }
    return {};
  }

  Result<std::vector<RankedPoints::Place>> find_points(std::span<const std::uint64_t> ranks) const {
    std::vector<RankedPoints::Place> places;
    SPLATVOL_TRY(points_.find(ranks, places));
    if (places.size() > max_chunk_groups && RankedPoints::groups_of(places).size() > max_chunk_groups)
      return broken("a chunk of cells has corners in too many groups");
    return places;
  }

  // `places`: of corners that are points.
  Status check_extent(const CellChunk& cells, const CellChunkEntry& entry, const LocalCells& local,
                      std::span<const RankedPoints::Place> places) const {
    std::vector<dvec3> positions;
    if (cells.field == CellField::constant)
      SPLATVOL_TRY(vertices_.read_positions(local.ranks, positions));
    else
      SPLATVOL_TRY(points_.read_positions(places, positions));
    if (local.ranks.size() != entry.points) return broken("a chunk of cells has corners at others than it states");
    const CellExtent extent = measure_cells(cells, local, positions);
    if (!is_box(entry.low, entry.high, extent.box) || !is_area_of(entry.area, extent.area))
      return broken("the box or area of a chunk of cells is wrong");
    return {};
  }

  Status check_summary(const ValueSummary& found, const ValueSummary& stated) const {
    if (found.min != stated.min || found.max != stated.max || found.occupancy != stated.occupancy)
      return broken("the range or occupancy of a chunk of cells is wrong");
    return {};
  }

  Status check_order(const CellChunk& cells, Ends& ends) const {
    std::array<std::vector<std::uint64_t>, 2> sorted;  // of the present cell, and of that before it
    bool has_last = ends.last.shape == cells.shape;
    CellKey last = ends.last.key();
    for (std::size_t i = 0; i < cells.size(); ++i) {
      auto corners = cells.corners_at(i);
      if (cells.shape == CellShape::polyhedron) corners = corners.first(cells.field == CellField::corners ? 1 : 0);
      if (!std::ranges::is_sorted(corners)) {
        sorted[i % 2].assign(corners.begin(), corners.end());
        sort_corners(sorted[i % 2]);
        corners = sorted[i % 2];
      }
      const CellKey key{cells.points.empty() ? 0 : cells.points[i], corners};
      if (has_last && key.is_before(last)) return unordered();
      if (ends.first.shape == CellShape{}) ends.first = {cells.shape, key};
      has_last = true;
      last = key;
    }
    ends.last = {cells.shape, last};
    return {};
  }

  Status check_kinds() const {
    Kinds found;
    for (const Kinds& kinds : kinds_)
      for (const auto& [kind, counts] : kinds) {
        found[kind].cells += counts.cells;
        found[kind].packed_bytes += counts.packed_bytes;
      }
    for (const CellKind& stated : cells_.kinds()) {
      const auto kind = found.find({stated.shape, stated.field});
      if (kind == found.end() || kind->second.cells != stated.cells ||
          kind->second.packed_bytes != stated.packed_bytes || stated.turned > stated.cells)
        return wrong_counts();
      found.erase(kind);
    }
    return found.empty() ? Status{} : wrong_counts();
  }
  [[nodiscard]] tl::unexpected<Error> wrong_counts() const {
    return broken("there are other cells than the root of the cells states");
  }

  const CellReader& cells_;
  const Volume& volume_;
  const VolumeInfo& info_;
  const std::function<void(double)>& progress_;  // called by this thread only
  std::size_t threads_;
  bool of_step_;
  std::vector<ValueBins> bins_;  // [attribute]
  RankedPoints points_;
  CellVertices vertices_;
  std::vector<Ends> ends_;    // [page]
  std::vector<Kinds> kinds_;  // [thread]

  // Of check_ranks().
  std::uint64_t rank_ = 0;
  std::vector<std::uint64_t> before_;   // [segment]: points of lower ranks
  std::vector<std::uint8_t> segments_;  // of the present page
};

}  // namespace

Status verify_cells(const Volume& volume, const std::function<void(double)>& progress, std::size_t threads) {
  SPLATVOL_TRY_ASSIGN(cells, CellReader::open(volume));
  return cells ? CellVerifier(*cells, progress, threads).run() : Status{};
}

Status verify_cells_of_step(const Volume& volume, const std::function<void(double)>& progress, std::size_t threads) {
  SPLATVOL_TRY_ASSIGN(cells, CellReader::open(volume));
  return cells && cells->has_step_summaries() ? CellVerifier(*cells, progress, threads, true).run_pages() : Status{};
}

}  // namespace splatvol::format
