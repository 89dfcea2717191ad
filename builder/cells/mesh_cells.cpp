#include "builder/cells/mesh_cells.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <utility>

#include "base/interruption.h"
#include "builder/cells/polyhedra.h"
#include "format/codec.h"
#include "format/layout.h"

namespace splatvol {
namespace {

constexpr std::size_t joined_cells = 4096;  // most cells of a chunk that joins index leaves
constexpr std::uint32_t most_pieces = std::numeric_limits<std::int32_t>::max();

// The same for a cell whose corners come in another order. `ranks`: the corners in ascending order.
std::uint64_t hash_of(format::CellShape shape, const RankedCell& cell, std::span<const std::uint64_t> ranks) {
  const auto corners = std::span(cell.corners).first(ranks.size());
  const format::CellOrder order = format::find_order(shape, corners, ranks, cell.split);
  std::array<std::uint64_t, format::max_cell_corners + 2> words{};
  std::ranges::copy(ranks, words.begin());
  words[ranks.size()] = std::uint64_t{order.code} << 32 | order.split;
  words[ranks.size() + 1] = cell.point;
  return format::hash_bytes(std::as_bytes(std::span(words).first(ranks.size() + 2)));
}

// Cells of a block with their ranks, as records of CellSort.
struct RankedBlock {
  std::vector<std::uint64_t> records;     // of the block's shape
  std::vector<std::uint64_t> tetrahedra;  // of its cells that have lost a corner
  std::uint64_t collapsed = 0;
  std::uint64_t hash = 0;  // sum of those of the cells
  bool lacks_point = false;
};

// Cells of a block of RankedSpool.
void rank_joined(std::span<const std::byte> block, RankedBlock& ranked) {
  constexpr auto shape = format::CellShape::tetrahedron;
  std::vector<RankedTetrahedron> tetrahedra;
  RankedSpool::unpack(block, tetrahedra);
  ranked.records.reserve(tetrahedra.size() * format::corners_of(shape));
  for (const RankedTetrahedron& tetrahedron : tetrahedra) {
    RankedCell cell{.sign = tetrahedron.sign};
    std::ranges::copy(tetrahedron.corners, cell.corners.begin());
    ranked.hash += hash_of(shape, cell, tetrahedron.corners);
    const CellSort::Record record = CellSort::record_of(shape, cell);
    ranked.records.insert(ranked.records.end(), record.begin(), record.begin() + format::corners_of(shape));
  }
}

// Gives the cells of a block their ranks.
class BlockRanker {
 public:
  // `corners`: ranks or numbers of what the corners are; `ranks`: [point of the piece].
  BlockRanker(const CellBlock& block, std::span<const std::uint64_t> corners, std::span<const std::uint64_t> ranks,
              RankedBlock& ranked)
      : block_(block), corners_(corners), ranks_(ranks), ranked_(ranked) {}

  void run() {
    if (block_.shape == format::CellShape::polyhedron) return run_polyhedra();
    std::vector<SpooledCell> cells;
    unpack(block_, cells);
    const std::size_t count = format::corners_of(block_.shape);
    ranked_.records.reserve(cells.size() * CellSort::words_of(block_.shape, block_.field));
    for (const SpooledCell& spooled : cells) {
      RankedCell cell{.split = spooled.split, .sign = spooled.sign};
      for (std::size_t k = 0; k < count; ++k) {
        cell.corners[k] = corners_[spooled.corners[k]];
        ranked_.lacks_point = ranked_.lacks_point || cell.corners[k] == TagSort::none;
      }
      if (block_.field == format::CellField::constant) cell.point = ranks_[spooled.point];
      ranked_.lacks_point = ranked_.lacks_point || cell.point == TagSort::none;
      if (!ranked_.lacks_point) add(block_.shape, cell, ranked_.records);
    }
  }

 private:
  void run_polyhedra() {
    Polyhedron cell;
    std::vector<std::uint64_t> numbers;
    for (std::span<const std::byte> bytes = block_.bytes; !bytes.empty();) {
      get_polyhedron(bytes, cell);
      numbers.clear();
      for (const std::uint64_t corner : cell.corners) numbers.push_back(corners_[corner]);
      if (block_.field == format::CellField::constant) cell.point = ranks_[cell.point];
      ranked_.lacks_point = ranked_.lacks_point || cell.point == TagSort::none ||
                            std::ranges::find(numbers, TagSort::none) != numbers.end();
      if (ranked_.lacks_point) return;
      if (renumber(numbers, cell))
        ranked_.hash += append_records(cell, block_.field, ranked_.records);
      else
        format::for_each_tetrahedron(cell.triangles, cell.apex,
                                     [&](const auto& corners) { add_part(corners, numbers, cell.point); });
    }
  }

  void add(format::CellShape shape, const RankedCell& cell, std::vector<std::uint64_t>& records) {
    const std::size_t count = format::corners_of(shape);
    auto sorted = cell.corners;
    const auto ranks = std::span(sorted).first(count);
    format::sort_corners(ranks);
    if (std::ranges::adjacent_find(ranks) != ranks.end()) return add_parts(shape, cell);
    ranked_.hash += hash_of(shape, cell, ranks);
    const CellSort::Record record = CellSort::record_of(shape, cell);
    const auto words = static_cast<std::ptrdiff_t>(CellSort::words_of(shape, block_.field));
    records.insert(records.end(), record.begin(), record.begin() + words);
  }

  // Adds the tetrahedra that have four corners.
  void add_parts(format::CellShape shape, const RankedCell& cell) {
    if (shape == format::CellShape::tetrahedron) {
      ++ranked_.collapsed;
      return;
    }
    for (const auto& tetrahedron : format::tetrahedra_of(shape, cell.split))
      add_part(tetrahedron, cell.corners, cell.point);
  }

  void add_part(const std::array<std::uint8_t, 4>& tetrahedron, std::span<const std::uint64_t> corners,
                std::uint64_t point) {
    RankedCell part{.point = point};
    for (std::size_t k = 0; k < tetrahedron.size(); ++k) part.corners[k] = corners[tetrahedron[k]];
    add(format::CellShape::tetrahedron, part, ranked_.tetrahedra);
  }

  const CellBlock& block_;
  std::span<const std::uint64_t> corners_, ranks_;
  RankedBlock& ranked_;
};

}  // namespace

Result<std::unique_ptr<MeshCells>> MeshCells::create(std::uint64_t memory, const std::string& folder, bool exact) {
  SPLATVOL_TRY_ASSIGN(tags, TagSort::create(memory / 8, folder));
  return std::unique_ptr<MeshCells>(new MeshCells(std::move(tags), memory, folder, exact));
}

Status MeshCells::add(const Piece& piece) {
  // The sort of tags knows 63 bits of them.
  if (spool_.pieces() > most_pieces) return fail(ErrorCode::unsupported, "more than {} pieces with cells", most_pieces);
  if (piece.cells) {
    if (!vertices_) vertices_ = std::make_unique<VertexSort>(memory_ / 4, folder_, exact_);
    SPLATVOL_TRY(vertices_->add(spool_.pieces(), piece));
  }
  return spool_.add(piece);
}

Status MeshCells::add_joined(std::span<const RankedTetrahedron> tetrahedra) {
  for (const RankedTetrahedron& tetrahedron : tetrahedra)
    rank_end_ = std::max(rank_end_, tetrahedron.corners.back() + 1);
  return joined_.add(tetrahedra);
}

Status MeshCells::add_rank(PointTag tag, std::uint64_t rank) {
  rank_end_ = std::max(rank_end_, rank + 1);
  return tags_.add(tag, rank);
}

Status MeshCells::add_stay(std::size_t level, std::uint64_t rank) {
  while (stays_.size() <= level) stays_.push_back(std::make_unique<NumberQueue>(folder_));
  return stays_[level]->add(rank);
}

Status MeshCells::add_leaf(std::uint64_t points) {
  for (const std::unique_ptr<OfShape>& of_shape : shapes_) SPLATVOL_TRY(of_shape->leaves.add(points));
  return {};
}

std::uint64_t MeshCells::count() const {
  std::uint64_t count = 0;
  for (const std::unique_ptr<OfShape>& of_shape : shapes_) count += of_shape->sort.count();
  return count;
}

Result<std::optional<std::uint64_t>> MeshCells::NumberQueue::next() {
  if (left_.empty()) SPLATVOL_TRY_SET(left_, spool_.next());
  if (left_.empty()) return std::optional<std::uint64_t>();
  const auto number = record_at<std::uint64_t>(left_, 0);
  left_ = left_.subspan(sizeof(number));
  return std::optional(number);
}

Status MeshCells::sort() {
  SPLATVOL_TRY(start_sorts(spool_.counts(), rank_end_));
  const auto add = [&](format::CellShape shape, std::span<const std::uint64_t> records) {
    return add_records(shape, records);
  };
  SPLATVOL_TRY(translate(add));
  SPLATVOL_TRY(add_joined_to(add));
  return finish_sorts();
}

Status MeshCells::hash_only() {
  const auto drop = [](format::CellShape, std::span<const std::uint64_t>) { return Status(); };
  SPLATVOL_TRY(translate(drop));
  return add_joined_to(drop);
}

Status MeshCells::translate(const TakeRecords& take) {
  SPLATVOL_TRY(tags_.finish());
  if (vertices_) SPLATVOL_TRY(vertices_->sort());
  const auto add = [&](std::span<const CellBlock> blocks) -> Status {
    SPLATVOL_TRY(load_ranks(blocks[0]));
    return add_ranked(blocks, take);
  };
  SPLATVOL_TRY(spool_.read(add));
  ranks_ = {};
  numbers_ = {};
  return {};
}

Status MeshCells::finish_sorts() {
  for (const std::unique_ptr<OfShape>& of_shape : shapes_) SPLATVOL_TRY(of_shape->sort.finish());
  return {};
}

// Shapes share the memory by the bytes of their records.
Status MeshCells::start_sorts(const CellSpool::Counts& counts, std::uint64_t rank_end) {
  using format::CellShape;
  constexpr std::array all = {CellShape::tetrahedron, CellShape::pyramid, CellShape::wedge, CellShape::hexahedron,
                              CellShape::polyhedron};
  const format::CellField field = vertices_ ? format::CellField::constant : format::CellField::corners;
  const auto bytes_of = [&](CellShape shape) {
    const std::uint64_t joined = shape == CellShape::tetrahedron ? joined_.count() : 0;
    const std::uint64_t records = shape == CellShape::polyhedron ? 3 : 1;  // of a cell, about
    return (counts[static_cast<std::size_t>(shape)] + joined) * records * CellSort::words_of(shape, field);
  };
  std::uint64_t bytes = 0;
  for (const CellShape shape : all) bytes += bytes_of(shape);
  for (const CellShape shape : all) {
    // Tetrahedra may come of the others.
    const std::uint64_t own = bytes_of(shape);
    if (own == 0 && shape != CellShape::tetrahedron) continue;
    const auto share = static_cast<double>(own) / static_cast<double>(std::max<std::uint64_t>(bytes, 1));
    const auto memory = static_cast<std::uint64_t>(share * static_cast<double>(memory_));
    SPLATVOL_TRY_ASSIGN(sort, CellSort::create(shape, field, rank_end, memory, folder_));
    shapes_.push_back(std::unique_ptr<OfShape>(new OfShape{std::move(sort), NumberQueue(folder_), 0, {}}));
    shapes_.back()->leaf_cells.chunk.shape = shape;
    shapes_.back()->leaf_cells.chunk.field = field;
  }
  return {};
}

CellSort* MeshCells::sort_of(format::CellShape shape) {
  const auto found =
      std::ranges::find_if(shapes_, [&](const auto& of_shape) { return of_shape->sort.shape() == shape; });
  return &(*found)->sort;
}

Status MeshCells::load_ranks(const CellBlock& block) {
  if (piece_ == block.piece) return {};
  piece_ = block.piece;
  if (vertices_) SPLATVOL_TRY(vertices_->load(block.piece, block.piece_corners, numbers_));
  return tags_.load(block.piece, block.piece_points, ranks_);
}

Status MeshCells::add_ranked(std::span<const CellBlock> blocks, const TakeRecords& take) {
  std::vector<RankedBlock> ranked(blocks.size());
  const std::vector<std::uint64_t>& corners = vertices_ ? numbers_ : ranks_;
  tbb::parallel_for(std::size_t{0}, blocks.size(),
                    [&](std::size_t b) { BlockRanker(blocks[b], corners, ranks_, ranked[b]).run(); });
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    if (ranked[b].lacks_point) return fail(ErrorCode::invalid_data, "a cell has a corner that is no point of the file");
    collapsed_ += ranked[b].collapsed;
    hash_ += ranked[b].hash;
    SPLATVOL_TRY(take(blocks[b].shape, ranked[b].records));
    SPLATVOL_TRY(take(format::CellShape::tetrahedron, ranked[b].tetrahedra));
  }
  return check_interruption();
}

Status MeshCells::add_joined_to(const TakeRecords& take) {
  const auto add = [&](std::span<const std::span<const std::byte>> blocks) -> Status {
    std::vector<RankedBlock> ranked(blocks.size());
    tbb::parallel_for(std::size_t{0}, blocks.size(), [&](std::size_t b) { rank_joined(blocks[b], ranked[b]); });
    for (const RankedBlock& block : ranked) {
      hash_ += block.hash;
      SPLATVOL_TRY(take(format::CellShape::tetrahedron, block.records));
    }
    return check_interruption();
  };
  return joined_.read(add);
}

// Gathers the cells of the next index leaf that has some; of a leaf with too many for a chunk, the next of them.
Status MeshCells::gather_leaf(OfShape& of_shape) {
  while (of_shape.leaf_cells.has_room()) {
    SPLATVOL_TRY_ASSIGN(rank, of_shape.sort.next_rank());
    if (!rank) return {};
    while (*rank >= of_shape.leaf_end) {
      if (of_shape.leaf_cells.chunk.size() > 0) return {};
      SPLATVOL_TRY_ASSIGN(points, of_shape.leaves.next());
      if (!points) return fail(ErrorCode::invalid_data, "a cell has a corner that is in no leaf of the index");
      of_shape.leaf_end += *points;
    }
    of_shape.sort.take(of_shape.leaf_end, format::max_chunk_cells - of_shape.leaf_cells.chunk.size(),
                       of_shape.leaf_cells);
  }
  return {};
}

Result<bool> MeshCells::next_chunk(OfShape& of_shape, SortedCells& cells) {
  cells.clear();
  cells.chunk.shape = of_shape.sort.shape();
  cells.chunk.field = of_shape.sort.field();
  SortedCells& leaf = of_shape.leaf_cells;
  for (;;) {
    if (leaf.chunk.size() == 0) SPLATVOL_TRY(gather_leaf(of_shape));
    if (leaf.chunk.size() == 0) return cells.chunk.size() > 0;
    if (cells.chunk.size() > 0 && (cells.chunk.size() + leaf.chunk.size() > joined_cells ||
                                   cells.chunk.corners.size() + leaf.chunk.corners.size() > format::max_chunk_corners))
      return true;
    cells.add(leaf);
    leaf.clear();
    if (cells.chunk.size() >= joined_cells) return true;
  }
}

Result<bool> MeshCells::next_chunk(SortedCells& cells) {
  for (; next_shape_ < shapes_.size(); ++next_shape_) {
    SPLATVOL_TRY_ASSIGN(more, next_chunk(*shapes_[next_shape_], cells));
    if (more) return true;
  }
  return false;
}

Status MeshCells::next_segments(std::size_t count, std::size_t levels, std::vector<std::uint8_t>& segments) {
  segments.assign(count, static_cast<std::uint8_t>(levels - 1));
  next_stays_.resize(stays_.size());
  const std::uint64_t end = next_rank_ + count;
  for (std::size_t level = 1; level < stays_.size(); ++level) {
    std::optional<std::uint64_t>& next = next_stays_[level];
    if (!next) SPLATVOL_TRY_SET(next, stays_[level]->next());
    while (next && *next < end) {
      segments[*next - next_rank_] = static_cast<std::uint8_t>(levels - 1 - level);
      SPLATVOL_TRY_SET(next, stays_[level]->next());
    }
  }
  next_rank_ = end;
  return {};
}

}  // namespace splatvol
