#include "builder/cells/cell_spool.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <utility>

#include "builder/cells/packed_numbers.h"
#include "builder/mesh/tetrahedra.h"

namespace splatvol {
namespace {

constexpr std::size_t block_cells = 4096;
constexpr std::size_t blocks_at_once = 16;

// In front of the cells of a block.
struct BlockHead {
  std::uint32_t piece, piece_points, bytes;
  format::CellShape shape;
};

int sign_of(const Piece& piece, const SpooledCell& cell, format::CellShape shape) {
  int sign = 0;
  for (const auto& [a, b, c, d] : format::tetrahedra_of(shape, cell.split)) {
    const auto corner = [&](std::uint8_t k) { return piece.points[cell.corners[k]]; };
    const double volume = signed_volume_6(corner(a), corner(b), corner(c), corner(d));
    const int present = volume > 0 ? 1 : volume < 0 ? -1 : 0;
    if (present == 0 || present == -sign) return 0;
    sign = present;
  }
  return sign;
}

// Packs cells one by one.
class BlockPacker {
 public:
  BlockPacker(const Piece& piece, BlockHead head, std::vector<std::byte>& bytes)
      : piece_(piece), head_(head), bytes_(bytes) {
    bytes_.assign(sizeof(BlockHead), {});
  }

  void add(SpooledCell cell) {
    cell.sign = sign_of(piece_, cell, head_.shape);
    put_difference(bytes_, cell.corners[0], before_);
    before_ = cell.corners[0];
    for (std::size_t k = 1; k < format::corners_of(head_.shape); ++k) put_difference(bytes_, cell.corners[k], before_);
    put_number(bytes_, static_cast<std::uint64_t>(cell.split * 3 + cell.sign + 1));
  }

  void finish() {
    head_.bytes = static_cast<std::uint32_t>(bytes_.size() - sizeof(BlockHead));
    std::memcpy(bytes_.data(), &head_, sizeof(BlockHead));
  }

 private:
  const Piece& piece_;
  BlockHead head_;
  std::vector<std::byte>& bytes_;
  std::uint32_t before_ = 0;
};

// Calls visit(tetrahedron) for those of `tetrahedra` from `first` on, at most `count`, that no whole cell has.
template <class Visit>
void for_each_single(const Piece& piece, std::size_t first, std::size_t count, const Visit& visit) {
  auto whole = std::ranges::lower_bound(piece.whole_cells, first, {},
                                        [](const WholeCell& cell) { return std::size_t{cell.first} + cell.count - 1; });
  const std::size_t end = std::min(first + count, piece.tetrahedra.size());
  for (std::size_t i = first; i < end; ++i) {
    while (whole != piece.whole_cells.end() && i >= std::size_t{whole->first} + whole->count) ++whole;
    if (whole == piece.whole_cells.end() || i < whole->first) visit(piece.tetrahedra[i]);
  }
}

}  // namespace

void unpack(const CellBlock& block, std::vector<SpooledCell>& cells) {
  std::span<const std::byte> bytes = block.bytes;
  cells.clear();
  std::uint32_t before = 0;
  while (!bytes.empty()) {
    SpooledCell& cell = cells.emplace_back();
    cell.corners[0] = before = static_cast<std::uint32_t>(get_difference(bytes, before));
    for (std::size_t k = 1; k < format::corners_of(block.shape); ++k)
      cell.corners[k] = static_cast<std::uint32_t>(get_difference(bytes, before));
    const std::uint64_t code = get_number(bytes);
    cell.split = static_cast<format::CellSplit>(code / 3);
    cell.sign = static_cast<int>(code % 3) - 1;
  }
}

Status CellSpool::add(const Piece& piece) {
  using format::CellShape;
  const auto blocks_of = [](std::size_t cells) { return (cells + block_cells - 1) / block_cells; };
  std::uint64_t parts = 0;
  for (const WholeCell& cell : piece.whole_cells) {
    ++counts_[static_cast<std::size_t>(cell.shape)];
    parts += cell.count;
  }
  counts_[static_cast<std::size_t>(CellShape::tetrahedron)] += piece.tetrahedra.size() - parts;
  const BlockHead head{pieces_++, static_cast<std::uint32_t>(piece.points.size()), 0, CellShape::tetrahedron};
  const auto pack_single = [&](std::size_t block, std::vector<std::byte>& bytes) {
    BlockPacker packer(piece, head, bytes);
    for_each_single(piece, block * block_cells, block_cells, [&](const Tetrahedron& corners) {
      SpooledCell cell;
      std::ranges::copy(corners, cell.corners.begin());
      packer.add(cell);
    });
    packer.finish();
  };
  SPLATVOL_TRY(append_blocks(blocks_of(piece.tetrahedra.size()), pack_single));
  for (const CellShape shape : {CellShape::pyramid, CellShape::wedge, CellShape::hexahedron}) {
    BlockHead of_shape = head;
    of_shape.shape = shape;
    const auto pack = [&](std::size_t block, std::vector<std::byte>& bytes) {
      BlockPacker packer(piece, of_shape, bytes);
      const auto cells = std::span(piece.whole_cells).subspan(block * block_cells);
      for (const WholeCell& cell : cells.first(std::min(block_cells, cells.size())))
        if (cell.shape == shape) packer.add({cell.corners, cell.split});
      packer.finish();
    };
    SPLATVOL_TRY(append_blocks(blocks_of(piece.whole_cells.size()), pack));
  }
  return {};
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
        blocks.push_back({head.piece, head.piece_points, head.shape, bytes.subspan(sizeof(head), head.bytes)});
        bytes = bytes.subspan(sizeof(head) + head.bytes);
      }
      SPLATVOL_TRY(visit(blocks));
    }
    return {};
  };
  return spool_.read(visit_blocks);
}

}  // namespace splatvol
