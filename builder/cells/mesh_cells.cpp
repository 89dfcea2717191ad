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

// The same for a cell whose corners come in another order.
std::uint64_t hash_of(const CellForm& form, const RankedCell& cell) {
  const std::size_t corners = format::corners_of(form.shape());
  const format::CellOrder order = format::find_order(form.shape(), cell.permutation, cell.split);
  std::array<std::uint64_t, format::max_cell_corners + 2> words{};
  std::ranges::copy(cell.ranks, words.begin());
  words[corners] = std::uint64_t{order.code} << 32 | order.split;
  words[corners + 1] = cell.point;
  return format::hash_bytes(std::as_bytes(std::span(words).first(corners + 2)));
}

// Cells of a block with their ranks, as records of CellSort.
struct RankedBlock {
  std::vector<CellWord> records;     // of the block's shape
  std::vector<CellWord> tetrahedra;  // of its cells that have lost a corner
  std::uint64_t collapsed = 0;
  std::uint64_t hash = 0;  // sum of those of the cells
  bool lacks_point = false;
};

// Cells of a block of RankedSpool.
void rank_joined(std::span<const std::byte> block, const CellForm& form, RankedBlock& ranked) {
  std::vector<RankedTetrahedron> tetrahedra;
  RankedSpool::unpack(block, tetrahedra);
  ranked.records.reserve(tetrahedra.size() * form.words());
  for (const RankedTetrahedron& tetrahedron : tetrahedra) {
    RankedCell cell{.sign = tetrahedron.sign};
    std::ranges::copy(tetrahedron.corners, cell.ranks.begin());
    ranked.hash += hash_of(form, cell);
    form.append(cell, ranked.records);
  }
}

// Gives the cells of a block their ranks.
class BlockRanker {
 public:
  // `corners`: ranks or numbers of what the corners are; `ranks`: [point of the piece]; all are below `rank_end`.
  BlockRanker(const CellBlock& block, std::span<const std::uint64_t> corners, std::span<const std::uint64_t> ranks,
              std::uint64_t rank_end, RankedBlock& ranked)
      : block_(block),
        corners_(corners),
        ranks_(ranks),
        form_(block.shape, block.field, rank_end),
        of_tetrahedra_(format::CellShape::tetrahedron, block.field, rank_end),
        ranked_(ranked) {}

  void run() {
    if (form_.is_of_polyhedra()) return run_polyhedra();
    std::vector<SpooledCell> cells;
    unpack(block_, cells);
    const std::size_t count = format::corners_of(block_.shape);
    ranked_.records.reserve(cells.size() * form_.words());
    for (const SpooledCell& spooled : cells) {
      RankedCell cell{.split = spooled.split, .sign = spooled.sign};
      for (std::size_t k = 0; k < count; ++k) {
        cell.ranks[k] = corners_[spooled.corners[k]];
        ranked_.lacks_point = ranked_.lacks_point || cell.ranks[k] == TagSort::none;
      }
      if (block_.field == format::CellField::constant) cell.point = ranks_[spooled.point];
      ranked_.lacks_point = ranked_.lacks_point || cell.point == TagSort::none;
      if (!ranked_.lacks_point) add(form_, cell, ranked_.records);
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
        ranked_.hash += form_.append(cell, ranked_.records);
      else
        format::for_each_tetrahedron(cell.triangles, cell.apex,
                                     [&](const auto& corners) { add_part(corners, numbers, cell.point); });
    }
  }

  // The corners of `cell` come in any order.
  void add(const CellForm& form, RankedCell& cell, std::vector<CellWord>& records) {
    const auto corners = cell.ranks;
    const auto ranks = std::span(cell.ranks).first(format::corners_of(form.shape()));
    cell.permutation = format::permutation_of(std::span<const std::uint64_t>(ranks));
    if (cell.permutation != 0) format::sort_corners(ranks);
    if (std::ranges::adjacent_find(ranks) != ranks.end()) return add_parts(form.shape(), corners, cell);
    ranked_.hash += hash_of(form, cell);
    form.append(cell, records);
  }

  // Adds the tetrahedra that have four corners.
  void add_parts(format::CellShape shape, std::span<const std::uint64_t> corners, const RankedCell& cell) {
    if (shape == format::CellShape::tetrahedron) {
      ++ranked_.collapsed;
      return;
    }
    for (const auto& tetrahedron : format::tetrahedra_of(shape, cell.split)) add_part(tetrahedron, corners, cell.point);
  }

  void add_part(const std::array<std::uint8_t, 4>& tetrahedron, std::span<const std::uint64_t> corners,
                std::uint64_t point) {
    RankedCell part{.point = point};
    for (std::size_t k = 0; k < tetrahedron.size(); ++k) part.ranks[k] = corners[tetrahedron[k]];
    add(of_tetrahedra_, part, ranked_.tetrahedra);
  }

  const CellBlock& block_;
  std::span<const std::uint64_t> corners_, ranks_;
  CellForm form_, of_tetrahedra_;
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
  SPLATVOL_TRY(number_corners());
  SPLATVOL_TRY(start_sorts(spool_.counts()));
  const auto add = [&](format::CellShape shape, std::span<const CellWord> records) {
    return add_records(shape, records);
  };
  SPLATVOL_TRY(translate(add));
  SPLATVOL_TRY(add_joined_to(add));
  return finish_sorts();
}

Status MeshCells::hash_only() {
  SPLATVOL_TRY(number_corners());
  const auto drop = [](format::CellShape, std::span<const CellWord>) { return Status(); };
  SPLATVOL_TRY(translate(drop));
  return add_joined_to(drop);
}

Status MeshCells::number_corners() {
  SPLATVOL_TRY(tags_.finish());
  if (!vertices_) return {};
  SPLATVOL_TRY(vertices_->sort());
  rank_end_ = std::max(rank_end_, vertices_->count());
  return {};
}

Status MeshCells::translate(const TakeRecords& take) {
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
Status MeshCells::start_sorts(const CellSpool::Counts& counts) {
  using format::CellShape;
  constexpr std::array all = {CellShape::tetrahedron, CellShape::pyramid, CellShape::wedge, CellShape::hexahedron,
                              CellShape::polyhedron};
  const format::CellField field = vertices_ ? format::CellField::constant : format::CellField::corners;
  const auto bytes_of = [&](const CellForm& form) {
    const std::uint64_t joined = form.shape() == CellShape::tetrahedron ? joined_.count() : 0;
    const std::uint64_t records = form.is_of_polyhedra() ? 3 : 1;  // of a cell, about
    return (counts[static_cast<std::size_t>(form.shape())] + joined) * records * form.words();
  };
  std::uint64_t bytes = 0;
  for (const CellShape shape : all) bytes += bytes_of(CellForm(shape, field, rank_end_));
  for (const CellShape shape : all) {
    // Tetrahedra may come of the others.
    const CellForm form(shape, field, rank_end_);
    const std::uint64_t own = bytes_of(form);
    if (own == 0 && shape != CellShape::tetrahedron) continue;
    const auto share = static_cast<double>(own) / static_cast<double>(std::max<std::uint64_t>(bytes, 1));
    const auto memory = static_cast<std::uint64_t>(share * static_cast<double>(memory_));
    SPLATVOL_TRY_ASSIGN(sort, CellSort::create(form, memory, folder_));
    shapes_.push_back(std::unique_ptr<OfShape>(new OfShape{std::move(sort), NumberQueue(folder_), 0, {}}));
  }
  return {};
}

CellSort* MeshCells::sort_of(format::CellShape shape) {
  const auto found =
      std::ranges::find_if(shapes_, [&](const auto& of_shape) { return of_shape->sort.form().shape() == shape; });
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
                    [&](std::size_t b) { BlockRanker(blocks[b], corners, ranks_, rank_end_, ranked[b]).run(); });
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
  const CellForm form(format::CellShape::tetrahedron, format::CellField::corners, rank_end_);
  const auto add = [&](std::span<const std::span<const std::byte>> blocks) -> Status {
    std::vector<RankedBlock> ranked(blocks.size());
    tbb::parallel_for(std::size_t{0}, blocks.size(), [&](std::size_t b) { rank_joined(blocks[b], form, ranked[b]); });
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
  while (of_shape.sort.has_room(of_shape.leaf_cells)) {
    SPLATVOL_TRY_ASSIGN(rank, of_shape.sort.next_rank());
    if (!rank) return {};
    while (*rank >= of_shape.leaf_end) {
      if (of_shape.leaf_cells.cells > 0) return {};
      SPLATVOL_TRY_ASSIGN(points, of_shape.leaves.next());
      if (!points) return fail(ErrorCode::invalid_data, "a cell has a corner that is in no leaf of the index");
      of_shape.leaf_end += *points;
    }
    of_shape.sort.take(of_shape.leaf_end, of_shape.leaf_cells);
  }
  return {};
}

Result<bool> MeshCells::next_chunk(OfShape& of_shape, SortedCells& cells) {
  cells = {.form = &of_shape.sort.form()};
  SortedCells& leaf = of_shape.leaf_cells;
  for (;;) {
    if (leaf.cells == 0) SPLATVOL_TRY(gather_leaf(of_shape));
    if (leaf.cells == 0) return cells.cells > 0;
    if (cells.cells > 0 &&
        (cells.cells + leaf.cells > joined_cells || cells.corners + leaf.corners > format::max_chunk_corners))
      return true;
    cells.records.insert(cells.records.end(), leaf.records.begin(), leaf.records.end());
    cells.cells += leaf.cells;
    cells.corners += leaf.corners;
    leaf = {};
    if (cells.cells >= joined_cells) return true;
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
