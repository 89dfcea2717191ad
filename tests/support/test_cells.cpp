#include "tests/support/test_cells.h"

#include <algorithm>
#include <numeric>
#include <random>
#include <utility>

#include "format/cells.h"
#include "format/octree.h"
#include "format/ranked_points.h"
#include "tests/support/test_volume.h"

namespace splatvol::test {

using namespace format;

namespace {

std::vector<RankPage> rank_pages(const TestCells& cells, std::size_t segments) {
  std::vector<RankPage> pages;
  std::vector<std::uint64_t> before(segments);
  for (std::size_t first = 0; first < cells.segments.size(); first += rank_page_points) {
    const auto end = cells.segments.begin() + static_cast<std::ptrdiff_t>(std::min<std::size_t>(
                                                  first + rank_page_points, cells.segments.size()));
    pages.push_back({first, before, {cells.segments.begin() + static_cast<std::ptrdiff_t>(first), end}});
    for (const std::uint8_t segment : pages.back().segments) ++before[segment];
  }
  return pages;
}

// Chunks of a page, and what the page says of them.
struct Page {
  std::vector<CellChunkEntry> entries;
  std::vector<std::vector<ValueSummary>> summaries;  // [attribute][chunk]
};

Bytes pack_page(const Page& page, CellPageRef& ref) {
  Bytes table, parts;
  append_part(table, parts, std::as_bytes(std::span(page.entries)));
  for (const std::vector<ValueSummary>& summaries : page.summaries)
    append_part(table, parts, pack_summaries(summaries));
  Box box;
  for (const CellChunkEntry& entry : page.entries) {
    box.include({entry.low[0], entry.low[1], entry.low[2]});
    box.include({entry.high[0], entry.high[1], entry.high[2]});
    ref.area += entry.area;
  }
  for (int axis = 0; axis < 3; ++axis) {
    ref.low[axis] = box.low[axis];
    ref.high[axis] = box.high[axis];
  }
  ref.page_bytes = static_cast<std::uint32_t>(table.size() + parts.size());
  ref.chunks = static_cast<std::uint32_t>(page.entries.size());
  ref.hash = hash_bytes(table);
  table.insert(table.end(), parts.begin(), parts.end());
  return table;
}

// Makes the section in memory.
class SectionOfCells {
 public:
  SectionOfCells(const TestCells& cells, std::shared_ptr<const ChunkSource> chunks)
      : cells_(cells),
        info_(chunks->info()),
        rank_pages_(rank_pages(cells, info_.resolutions())),
        points_(
            std::move(chunks), [this](std::size_t page) -> Result<RankPage> { return rank_pages_[page]; },
            own_room(1 << 20)) {
    page_.summaries.resize(info_.attributes.size());
  }

  Result<Bytes> make() {
    std::vector<PackedPageRef> ranks;
    for (const RankPage& page : rank_pages_) {
      PackedPageRef& ref = ranks.emplace_back();
      ref.offset = section_.size();
      append(pack_rank_page(page, ref));
    }
    CellChunk tetrahedra;
    for (const auto& cell : cells_.corners)
      tetrahedra.corners.insert(tetrahedra.corners.end(), cell.begin(), cell.end());
    for (const CellChunk& cells : {tetrahedra, cells_.polyhedra})
      for (std::size_t first = 0; first < cells.size(); first += cells_.chunk_cells) {
        CellChunk chunk{cells.shape, cells.field, {}, {}, {}};
        append_cells(chunk, cells, first, std::min(first + cells_.chunk_cells, cells.size()));
        SPLATVOL_TRY(add_chunk(chunk));
      }
    if (!page_.entries.empty()) close_page();
    for (CellPageRef& page : pages_) page.offset += section_.size();
    append(page_bytes_);
    Bytes root;
    for (const CellKind& kind : kinds_) append_record(root, kind);
    for (const CellPageRef& page : pages_) append_record(root, page);
    for (const PackedPageRef& page : ranks) append_record(root, page);
    append_record(root, CellsTail{hash_bytes(root), chunks_, pages_.size(), 0,
                                  static_cast<std::uint32_t>(kinds_.size()), cells_version});
    append(root);
    return std::move(section_);
  }

 private:
  void append(const Bytes& bytes) { section_.insert(section_.end(), bytes.begin(), bytes.end()); }

  Status add_chunk(const CellChunk& chunk) {
    const LocalCells local = number_corners(chunk.corners);
    std::vector<RankedPoints::Place> places;
    std::vector<dvec3> positions;
    SPLATVOL_TRY(points_.find(local.ranks, places));
    SPLATVOL_TRY(points_.read_positions(places, positions));
    PackedCells packed = pack_cells(chunk, local.ranks.size());
    const CellExtent extent = measure_cells(chunk, local, positions);
    for (int axis = 0; axis < 3; ++axis) {
      packed.entry.low[axis] = extent.box.low[axis];
      packed.entry.high[axis] = extent.box.high[axis];
    }
    packed.entry.area = extent.area;
    packed.entry.offset = section_.size();
    append(packed.bytes);
    for (std::size_t a = 0; a < info_.attributes.size(); ++a) {
      std::vector<float> values;
      if (info_.find_column(ColumnKind::value, static_cast<int>(a)) < 0) {
        page_.summaries[a].emplace_back();
        continue;
      }
      SPLATVOL_TRY(points_.read_values(places, static_cast<int>(a), values));
      page_.summaries[a].push_back(summarize_cells(chunk, local, values, bins_of(info_.attributes[a])));
    }
    page_.entries.push_back(packed.entry);
    if (kinds_.empty() || kinds_.back().shape != chunk.shape)
      kinds_.push_back({chunk.shape, chunk.field, {}, 0, 0, kinds_.empty() ? cells_.turned : 0});
    kinds_.back().cells += chunk.size();
    kinds_.back().packed_bytes += packed.bytes.size();
    ++chunks_;
    if (page_.entries.size() == cells_.page_chunks) close_page();
    return {};
  }

  void close_page() {
    CellPageRef& ref = pages_.emplace_back();
    ref.offset = page_bytes_.size();
    ref.chunks_offset = page_.entries.front().offset;
    const Bytes packed = pack_page(page_, ref);
    page_bytes_.insert(page_bytes_.end(), packed.begin(), packed.end());
    page_.entries.clear();
    for (std::vector<ValueSummary>& summaries : page_.summaries) summaries.clear();
  }

  const TestCells& cells_;
  const VolumeInfo& info_;
  std::vector<RankPage> rank_pages_;
  RankedPoints points_;
  Bytes section_;
  Page page_;
  Bytes page_bytes_;  // of all pages, which follow the chunks
  std::vector<CellPageRef> pages_;
  std::vector<CellKind> kinds_;
  std::uint64_t chunks_ = 0;
};

}  // namespace

void append_cells(CellChunk& cells, const CellChunk& others, std::size_t begin, std::size_t end) {
  const auto add = [](auto& to, const auto& from, std::size_t first, std::size_t last) {
    if (from.empty()) return;
    const auto at = [&](std::size_t i) { return from.begin() + static_cast<std::ptrdiff_t>(i); };
    to.insert(to.end(), at(first), at(last));
  };
  const std::size_t had = cells.corners.size(), first = others.begin_of(begin), last = others.begin_of(end);
  add(cells.corners, others.corners, first, last);
  add(cells.splits, others.splits, begin, end);
  add(cells.points, others.points, begin, end);
  if (cells.shape != CellShape::polyhedron) return;
  for (std::size_t cell = begin; cell < end; ++cell)
    cells.ends.push_back(static_cast<std::uint32_t>(had + others.ends[cell] - first));
  add(cells.triangles, others.triangles, 2 * first - 4 * begin, 2 * last - 4 * end);
}

PackedCells repacked(PackedCells cells, const Bytes& payload, std::uint32_t count) {
  cells.bytes = pack(payload);
  cells.entry.hash = hash_bytes(cells.bytes);
  cells.entry.packed_bytes = static_cast<std::uint32_t>(cells.bytes.size());
  cells.entry.unpacked_bytes = static_cast<std::uint32_t>(payload.size());
  cells.entry.cells = count;
  return cells;
}

std::vector<std::uint64_t> ranks_of(const TestVolume& volume) {
  std::vector<std::size_t> order(volume.point_paths.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, {}, [&](std::size_t i) { return volume.point_paths[i]; });
  std::vector<std::uint64_t> ranks(order.size());
  for (std::size_t rank = 0; rank < order.size(); ++rank) ranks[order[rank]] = rank;
  return ranks;
}

void add_cells(TestVolume& volume, const std::vector<std::array<std::uint32_t, 4>>& tetrahedra) {
  const std::vector<std::uint64_t> ranks = ranks_of(volume);
  TestCells cells;
  for (const auto& tetrahedron : tetrahedra) {
    auto& corners = cells.corners.emplace_back();
    std::ranges::transform(tetrahedron, corners.begin(), [&](std::uint32_t point) { return ranks[point]; });
    std::ranges::sort(corners);
  }
  std::ranges::sort(cells.corners);
  cells.segments.resize(ranks.size());
  const std::vector<std::uint64_t>& ends = volume.info.resolution_counts;
  for (std::size_t point = 0; point < ranks.size(); ++point)
    cells.segments[ranks[point]] = static_cast<std::uint8_t>(std::ranges::upper_bound(ends, point) - ends.begin());
  volume.cells = std::move(cells);
  volume.info.cells = CellsInfo{0x0123456789abcdef};
}

void add_random_cells(TestVolume& volume, std::size_t count, std::uint32_t seed) {
  const std::vector<std::uint64_t> ranks = ranks_of(volume);
  std::vector<std::uint32_t> points(ranks.size());  // [rank]
  for (std::uint32_t point = 0; point < ranks.size(); ++point) points[ranks[point]] = point;
  std::mt19937 random(seed);
  const auto draw = [&](std::size_t below) { return random() % below; };
  std::vector<std::array<std::uint32_t, 4>> tetrahedra;
  while (tetrahedra.size() < count && points.size() >= 4) {
    const std::size_t near = std::min<std::size_t>(points.size(), 20), first = draw(points.size() - near + 1);
    std::array<std::size_t, 4> at{};
    for (std::size_t& rank : at) rank = first + draw(near);
    std::ranges::sort(at);
    if (std::ranges::adjacent_find(at) != at.end()) continue;
    tetrahedra.push_back({points[at[0]], points[at[1]], points[at[2]], points[at[3]]});
  }
  add_cells(volume, tetrahedra);
}

// A tetrahedron whose triangles are divided at random by new corners.
std::vector<SurfaceTriangle> random_surface(std::size_t corners, std::mt19937& random) {
  std::vector<SurfaceTriangle> surface = {{0, 1, 2}, {0, 2, 3}, {0, 3, 1}, {1, 3, 2}};
  for (std::size_t corner = 4; corner < corners; ++corner) {
    const std::size_t at = random() % surface.size();
    const auto [a, b, c] = surface[at];
    const auto d = static_cast<std::uint8_t>(corner);
    surface[at] = {a, b, d};
    surface.push_back({b, c, d});
    surface.push_back({c, a, d});
  }
  std::vector<std::uint8_t> numbers(corners);
  std::iota(numbers.begin(), numbers.end(), std::uint8_t{0});
  std::ranges::shuffle(numbers, random);
  for (SurfaceTriangle& t : surface)
    for (std::uint8_t& corner : t) corner = numbers[corner];
  return surface;
}

void add_random_polyhedra(TestVolume& volume, std::size_t count, std::uint32_t seed) {
  std::mt19937 random(seed);
  const std::size_t points = volume.cells->segments.size();
  std::vector<std::size_t> firsts(points < 30 ? 0 : count);
  for (std::size_t& first : firsts) first = random() % (points - 29);
  std::ranges::sort(firsts);
  CellChunk& cells = volume.cells->polyhedra;
  for (const std::size_t first : firsts) {
    std::vector<std::uint64_t> ranks(29);
    std::iota(ranks.begin(), ranks.end(), first + 1);
    std::ranges::shuffle(ranks, random);
    ranks.resize(4 + random() % 20);
    ranks.push_back(first);
    std::ranges::sort(ranks);
    cells.corners.insert(cells.corners.end(), ranks.begin(), ranks.end());
    cells.ends.push_back(static_cast<std::uint32_t>(cells.corners.size()));
    cells.splits.push_back(static_cast<CellSplit>(random() % ranks.size()));
    const std::vector<SurfaceTriangle> surface = random_surface(ranks.size(), random);
    cells.triangles.insert(cells.triangles.end(), surface.begin(), surface.end());
  }
}

Status write_test_cells(const TestCells& cells, std::shared_ptr<const ChunkSource> chunks, const AppendBytes& append) {
  SPLATVOL_TRY_ASSIGN(section, SectionOfCells(cells, std::move(chunks)).make());
  return append(section);
}

}  // namespace splatvol::test
