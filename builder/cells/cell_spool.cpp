#include "builder/cells/cell_spool.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <utility>

#include "builder/mesh/tetrahedra.h"
#include "format/payload.h"

namespace splatvol {
namespace {

constexpr std::size_t block_cells = 4096;
constexpr std::size_t blocks_at_once = 16;

// LEB128: corners of cells are mostly near each other.
void put_number(std::vector<std::byte>& bytes, std::uint64_t number) {
  for (; number >= 0x80; number >>= 7) bytes.push_back(static_cast<std::byte>(number | 0x80));
  bytes.push_back(static_cast<std::byte>(number));
}

std::uint64_t get_number(std::span<const std::byte>& bytes) {
  std::uint64_t number = 0;
  for (int shift = 0;; shift += 7) {
    const auto byte = std::to_integer<std::uint64_t>(bytes.front());
    bytes = bytes.subspan(1);
    number |= (byte & 0x7f) << shift;
    if (byte < 0x80) return number;
  }
}

void put_difference(std::vector<std::byte>& bytes, std::uint32_t number, std::uint32_t from) {
  put_number(bytes, format::zigzag(std::int64_t{number} - std::int64_t{from}));
}

std::uint32_t get_difference(std::span<const std::byte>& bytes, std::uint32_t from) {
  return static_cast<std::uint32_t>(from + format::unzigzag(get_number(bytes)));
}

// In front of the cells of a block.
struct BlockHead {
  std::uint32_t piece, piece_points, bytes;
};

void pack_block(std::span<const Tetrahedron> cells, BlockHead head, const Piece& piece, std::vector<std::byte>& bytes) {
  bytes.assign(sizeof(head), {});
  std::uint32_t before = 0;
  for (auto [a, b, c, d] : cells) {
    const double volume = signed_volume_6(piece.points[a], piece.points[b], piece.points[c], piece.points[d]);
    if (volume < 0) std::swap(c, d);
    put_difference(bytes, a, before);
    for (const std::uint32_t corner : {b, c, d}) put_difference(bytes, corner, a);
    bytes.push_back(volume == 0 ? std::byte{1} : std::byte{0});
    before = a;
  }
  head.bytes = static_cast<std::uint32_t>(bytes.size() - sizeof(head));
  std::memcpy(bytes.data(), &head, sizeof(head));
}

}  // namespace

void unpack(const CellBlock& block, std::vector<SpooledCell>& cells) {
  std::span<const std::byte> bytes = block.bytes;
  cells.clear();
  std::uint32_t before = 0;
  while (!bytes.empty()) {
    SpooledCell& cell = cells.emplace_back();
    cell.corners[0] = before = get_difference(bytes, before);
    for (std::size_t k = 1; k < cell.corners.size(); ++k) cell.corners[k] = get_difference(bytes, before);
    cell.is_flat = bytes.front() != std::byte{0};
    bytes = bytes.subspan(1);
  }
}

Status CellSpool::add(const Piece& piece) {
  const std::span<const Tetrahedron> all = piece.tetrahedra;
  const BlockHead head{pieces_, static_cast<std::uint32_t>(piece.points.size()), 0};
  std::array<std::vector<std::byte>, blocks_at_once> blocks;
  for (std::size_t first = 0; first < all.size(); first += block_cells * blocks.size()) {
    tbb::parallel_for(std::size_t{0}, blocks.size(), [&](std::size_t b) {
      const std::size_t begin = std::min(first + b * block_cells, all.size());
      const auto cells = all.subspan(begin, std::min(block_cells, all.size() - begin));
      blocks[b].clear();
      if (!cells.empty()) pack_block(cells, head, piece, blocks[b]);
    });
    for (const std::vector<std::byte>& block : blocks)
      if (!block.empty()) SPLATVOL_TRY(spool_.append(block));
  }
  count_ += all.size();
  ++pieces_;
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
        blocks.push_back({head.piece, head.piece_points, bytes.subspan(sizeof(head), head.bytes)});
        bytes = bytes.subspan(sizeof(head) + head.bytes);
      }
      SPLATVOL_TRY(visit(blocks));
    }
    return {};
  };
  return spool_.read(visit_blocks);
}

}  // namespace splatvol
