#include "builder/cells/cell_spool.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <functional>

#include "builder/cells/packed_numbers.h"
#include "builder/cells/polyhedra.h"
#include "builder/mesh/ranked_tetrahedron.h"

namespace splatvol {
namespace {

constexpr std::size_t block_cells = 4096, block_polyhedra = 256;
constexpr std::size_t blocks_at_once = 16;

// In front of the cells of a block.
struct BlockHead {
  std::uint32_t piece, piece_points, piece_corners, bytes;
  format::CellShape shape;
  format::CellField field;
};

// The corners of a piece, and the cells that it has of them.
struct CellSource {
  std::span<const dvec3> corners;
  std::span<const Tetrahedron> tetrahedra;
  std::span<const WholeCell> whole;
  std::span<const std::uint32_t> points;  // [tetrahedron]: PointCells::points; empty: the corners are points
};

CellSource cells_of(const Piece& piece) {
  if (!piece.cells) return {piece.points, piece.tetrahedra, piece.whole_cells, {}};
  return {piece.cells->corners, piece.cells->tetrahedra, piece.whole_cells, piece.cells->points};
}

// `corners`: what the tetrahedra name, as numbers of source.corners.
template <class Corner>
int sign_of(const CellSource& source, std::span<const std::array<Corner, 4>> tetrahedra, const auto& corners) {
  int sign = 0;
  for (const auto& [a, b, c, d] : tetrahedra) {
    const auto corner = [&](Corner k) { return source.corners[corners(k)]; };
    const int present = sign_of_volume(corner(a), corner(b), corner(c), corner(d));
    if (present == 0 || present == -sign) return 0;
    sign = present;
  }
  return sign;
}

// Packs cells one by one.
class BlockPacker {
 public:
  BlockPacker(const CellSource& source, BlockHead head, std::vector<std::byte>& bytes)
      : source_(source), head_(head), bytes_(bytes) {
    bytes_.assign(sizeof(BlockHead), {});
  }

  void add(SpooledCell cell) {
    cell.sign = sign_of(source_, format::tetrahedra_of(head_.shape, cell.split),
                        [&](std::uint8_t k) { return cell.corners[k]; });
    put_difference(bytes_, cell.corners[0], before_);
    before_ = cell.corners[0];
    for (std::size_t k = 1; k < format::corners_of(head_.shape); ++k) put_difference(bytes_, cell.corners[k], before_);
    put_number(bytes_, static_cast<std::uint64_t>(cell.split * 3 + cell.sign + 1));
    if (head_.field != format::CellField::constant) return;
    put_difference(bytes_, cell.point, point_before_);
    point_before_ = cell.point;
  }

  // Returns false, and adds nothing, if a file cannot keep these tetrahedra as one cell.
  bool add_polyhedron(std::span<const Tetrahedron> tetrahedra, std::uint32_t point) {
    if (!join_tetrahedra(tetrahedra, polyhedron_)) return false;
    polyhedron_.sign = sign_of(source_, tetrahedra, std::identity());
    polyhedron_.point = point;
    return put_polyhedron(polyhedron_, bytes_);
  }

  void finish() {
    head_.bytes = static_cast<std::uint32_t>(bytes_.size() - sizeof(BlockHead));
    std::memcpy(bytes_.data(), &head_, sizeof(BlockHead));
  }

 private:
  const CellSource& source_;
  BlockHead head_;
  std::vector<std::byte>& bytes_;
  std::uint32_t before_ = 0, point_before_ = 0;
  Polyhedron polyhedron_;
};

// Calls visit(number) for the tetrahedra from `first` on, at most `count`, that no whole cell has.
template <class Visit>
void for_each_single(const CellSource& source, std::size_t first, std::size_t count, const Visit& visit) {
  auto whole = std::ranges::lower_bound(source.whole, first, {},
                                        [](const WholeCell& cell) { return std::size_t{cell.first} + cell.count - 1; });
  const std::size_t end = std::min(first + count, source.tetrahedra.size());
  for (std::size_t i = first; i < end; ++i) {
    while (whole != source.whole.end() && i >= std::size_t{whole->first} + whole->count) ++whole;
    if (whole == source.whole.end() || i < whole->first) visit(i);
  }
}

CellSpool::Counts count_shapes(const CellSource& source) {
  CellSpool::Counts counts{};
  std::uint64_t parts = 0;
  for (const WholeCell& cell : source.whole) {
    ++counts[static_cast<std::size_t>(cell.shape)];
    parts += cell.count;
  }
  counts[static_cast<std::size_t>(format::CellShape::tetrahedron)] = source.tetrahedra.size() - parts;
  return counts;
}

// Packs the cells of a piece, in blocks that do not depend on each other.
class PiecePacker {
 public:
  PiecePacker(const CellSource& source, const BlockHead& head) : source_(source), head_(head) {}

  // Tetrahedra that no whole cell has.
  void pack_single(std::size_t block, std::vector<std::byte>& bytes) const {
    BlockPacker packer(source_, head_, bytes);
    for_each_single(source_, block * block_cells, block_cells, [&](std::size_t i) { add_tetrahedron(i, packer); });
    packer.finish();
  }

  // Pyramids, wedges or hexahedra.
  void pack_whole(format::CellShape shape, std::size_t block, std::vector<std::byte>& bytes) const {
    BlockPacker packer(source_, head_of(shape), bytes);
    for (const WholeCell& whole : block_of(block, block_cells)) {
      SpooledCell cell{.corners = whole.corners, .split = whole.split};
      if (whole.shape == shape && set_point(whole.first, cell)) packer.add(cell);
    }
    packer.finish();
  }

  // Polyhedra; `others` receives those that a file cannot keep as such.
  void pack_polyhedra(std::size_t block, std::vector<std::byte>& bytes, std::vector<WholeCell>& others) const {
    BlockPacker packer(source_, head_of(format::CellShape::polyhedron), bytes);
    for (const WholeCell& whole : block_of(block, block_polyhedra)) {
      SpooledCell cell;
      if (whole.shape != format::CellShape::polyhedron || !set_point(whole.first, cell)) continue;
      if (!packer.add_polyhedron(source_.tetrahedra.subspan(whole.first, whole.count), cell.point))
        others.push_back(whole);
    }
    packer.finish();
  }

  // The tetrahedra of whole cells.
  void pack_tetrahedra(std::span<const WholeCell> cells, std::vector<std::byte>& bytes) const {
    BlockPacker packer(source_, head_, bytes);
    for (const WholeCell& whole : cells)
      for (std::size_t i = whole.first; i < std::size_t{whole.first} + whole.count; ++i) add_tetrahedron(i, packer);
    packer.finish();
  }

 private:
  [[nodiscard]] BlockHead head_of(format::CellShape shape) const {
    BlockHead head = head_;
    head.shape = shape;
    return head;
  }

  [[nodiscard]] std::span<const WholeCell> block_of(std::size_t block, std::size_t size) const {
    const auto cells = source_.whole.subspan(block * size);
    return cells.first(std::min(size, cells.size()));
  }

  // Sets the point of a cell, and returns whether it has one.
  bool set_point(std::size_t tetrahedron, SpooledCell& cell) const {
    if (!source_.points.empty()) cell.point = source_.points[tetrahedron];
    return source_.points.empty() || cell.point != PointCells::no_point;
  }

  void add_tetrahedron(std::size_t number, BlockPacker& packer) const {
    SpooledCell cell;
    std::ranges::copy(source_.tetrahedra[number], cell.corners.begin());
    if (set_point(number, cell)) packer.add(cell);
  }

  const CellSource& source_;
  BlockHead head_;  // of tetrahedra
};

std::size_t blocks_of(std::size_t cells, std::size_t size) { return (cells + size - 1) / size; }

}  // namespace

void unpack(const CellBlock& block, std::vector<SpooledCell>& cells) {
  std::span<const std::byte> bytes = block.bytes;
  cells.clear();
  cells.reserve(block_cells);
  std::uint32_t before = 0, point_before = 0;
  while (!bytes.empty()) {
    SpooledCell& cell = cells.emplace_back();
    cell.corners[0] = before = static_cast<std::uint32_t>(get_difference(bytes, before));
    for (std::size_t k = 1; k < format::corners_of(block.shape); ++k)
      cell.corners[k] = static_cast<std::uint32_t>(get_difference(bytes, before));
    const std::uint64_t code = get_number(bytes);
    cell.split = static_cast<format::CellSplit>(code / 3);
    cell.sign = static_cast<int>(code % 3) - 1;
    if (block.field == format::CellField::constant) cell.point = point_before = get_difference(bytes, point_before);
  }
}

Status CellSpool::add(const Piece& piece) {
  using format::CellShape;
  using Bytes = std::vector<std::byte>;
  const CellSource source = cells_of(piece);
  const Counts of_piece = count_shapes(source);
  for (std::size_t shape = 0; shape < counts_.size(); ++shape) counts_[shape] += of_piece[shape];
  const PiecePacker packer(source, {.piece = pieces_++,
                                    .piece_points = static_cast<std::uint32_t>(piece.points.size()),
                                    .piece_corners = static_cast<std::uint32_t>(source.corners.size()),
                                    .bytes = 0,
                                    .shape = CellShape::tetrahedron,
                                    .field = piece.cells ? format::CellField::constant : format::CellField::corners});
  SPLATVOL_TRY(append_blocks(blocks_of(source.tetrahedra.size(), block_cells),
                             [&](std::size_t block, Bytes& bytes) { packer.pack_single(block, bytes); }));
  for (const CellShape shape : {CellShape::pyramid, CellShape::wedge, CellShape::hexahedron})
    SPLATVOL_TRY(append_blocks(blocks_of(source.whole.size(), block_cells),
                               [&](std::size_t block, Bytes& bytes) { packer.pack_whole(shape, block, bytes); }));
  if (of_piece[static_cast<std::size_t>(CellShape::polyhedron)] == 0) return {};

  // Tetrahedra of those that a file cannot keep as polyhedra follow.
  std::vector<std::vector<WholeCell>> others(blocks_of(source.whole.size(), block_polyhedra));
  SPLATVOL_TRY(append_blocks(
      others.size(), [&](std::size_t block, Bytes& bytes) { packer.pack_polyhedra(block, bytes, others[block]); }));
  for (const std::vector<WholeCell>& of_block : others)
    for (const WholeCell& whole : of_block) {
      --counts_[static_cast<std::size_t>(CellShape::polyhedron)];
      counts_[static_cast<std::size_t>(CellShape::tetrahedron)] += whole.count;
    }
  return append_blocks(others.size(),
                       [&](std::size_t block, Bytes& bytes) { packer.pack_tetrahedra(others[block], bytes); });
}

// Packs blocks on several threads, and appends those that have cells in order.
Status CellSpool::append_blocks(std::size_t count,
                                const std::function<void(std::size_t, std::vector<std::byte>&)>& pack) {
  std::array<std::vector<std::byte>, blocks_at_once> blocks;
  for (std::size_t first = 0; first < count; first += blocks.size()) {
    const std::size_t some = std::min(blocks.size(), count - first);
    tbb::parallel_for(std::size_t{0}, some, [&](std::size_t b) { pack(first + b, blocks[b]); });
    for (const std::vector<std::byte>& block : std::span(blocks).first(some))
      if (block.size() > sizeof(BlockHead)) SPLATVOL_TRY(spool_.append(block));
  }
  return {};
}

Status CellSpool::read(const std::function<Status(std::span<const CellBlock>)>& visit) {
  std::vector<CellBlock> blocks;
  const auto visit_blocks = [&](std::span<const std::byte> bytes) -> Status {
    while (!bytes.empty()) {
      blocks.clear();
      while (!bytes.empty()) {
        BlockHead head{};
        std::memcpy(&head, bytes.data(), sizeof(head));
        if (!blocks.empty() && blocks.back().piece != head.piece) break;
        blocks.push_back({head.piece, head.piece_points, head.piece_corners, head.shape, head.field,
                          bytes.subspan(sizeof(head), head.bytes)});
        bytes = bytes.subspan(sizeof(head) + head.bytes);
      }
      SPLATVOL_TRY(visit(blocks));
    }
    return {};
  };
  return spool_.read(visit_blocks);
}

}  // namespace splatvol
