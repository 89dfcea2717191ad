#include "builder/cells/ranked_spool.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cstring>

#include "builder/cells/packed_numbers.h"

namespace splatvol {
namespace {

constexpr std::size_t block_tetrahedra = 4096;
constexpr std::size_t blocks_at_once = 16;

using BlockBytes = std::uint32_t;  // in front of each block

void pack(std::span<const RankedTetrahedron> tetrahedra, std::vector<std::byte>& bytes) {
  bytes.assign(sizeof(BlockBytes), {});
  std::uint64_t before = 0;
  for (const RankedTetrahedron& tetrahedron : tetrahedra) {
    const auto& [a, b, c, d] = tetrahedron.corners;
    put_difference(bytes, a, before);
    put_number(bytes, b - a);
    put_number(bytes, c - b);
    put_number(bytes, (d - c) * 3 + static_cast<std::uint64_t>(tetrahedron.sign + 1));
    before = a;
  }
  const auto count = static_cast<BlockBytes>(bytes.size() - sizeof(BlockBytes));
  std::memcpy(bytes.data(), &count, sizeof(count));
}

}  // namespace

void RankedSpool::unpack(std::span<const std::byte> block, std::vector<RankedTetrahedron>& tetrahedra) {
  tetrahedra.clear();
  std::uint64_t before = 0;
  while (!block.empty()) {
    RankedTetrahedron& tetrahedron = tetrahedra.emplace_back();
    auto& [a, b, c, d] = tetrahedron.corners;
    before = a = get_difference(block, before);
    b = a + get_number(block);
    c = b + get_number(block);
    const std::uint64_t code = get_number(block);
    d = c + code / 3;
    tetrahedron.sign = static_cast<std::int8_t>(static_cast<int>(code % 3) - 1);
  }
}

Status RankedSpool::add(std::span<const RankedTetrahedron> tetrahedra) {
  count_ += tetrahedra.size();
  std::array<std::vector<std::byte>, blocks_at_once> blocks;
  while (!tetrahedra.empty()) {
    const auto some = tetrahedra.first(std::min(tetrahedra.size(), blocks_at_once * block_tetrahedra));
    const std::size_t count = (some.size() + block_tetrahedra - 1) / block_tetrahedra;
    tbb::parallel_for(std::size_t{0}, count, [&](std::size_t b) {
      const auto from = some.subspan(b * block_tetrahedra);
      pack(from.first(std::min(from.size(), block_tetrahedra)), blocks[b]);
    });
    for (const std::vector<std::byte>& block : std::span(blocks).first(count)) SPLATVOL_TRY(spool_.append(block));
    tetrahedra = tetrahedra.subspan(some.size());
  }
  return {};
}

Status RankedSpool::read(const std::function<Status(std::span<const std::span<const std::byte>>)>& visit) {
  std::vector<std::span<const std::byte>> blocks;
  return spool_.read([&](std::span<const std::byte> bytes) -> Status {
    blocks.clear();
    while (!bytes.empty()) {
      BlockBytes count = 0;
      std::memcpy(&count, bytes.data(), sizeof(count));
      blocks.push_back(bytes.subspan(sizeof(count), count));
      bytes = bytes.subspan(sizeof(count) + count);
    }
    return visit(blocks);
  });
}

}  // namespace splatvol
