#include "renderer/cpu/bins.h"

#include <algorithm>
#include <utility>

#include "base/parallel.h"

namespace splatvol::tiles {
namespace {

constexpr std::size_t slots_per_slice = std::size_t{1} << 12;
constexpr std::size_t most_slices = 16;

/// Calls visit(tile) for the tiles that the bounds touch.
template <class Visit>
void for_each_tile(const PixelBounds& bounds, std::size_t columns, const Visit& visit) {
  if (bounds.left == bounds.right) return;
  for (std::size_t y = bounds.bottom / tile_size; y <= (bounds.top - 1U) / tile_size; ++y)
    for (std::size_t x = bounds.left / tile_size; x <= (bounds.right - 1U) / tile_size; ++x) visit(y * columns + x);
}

}  // namespace

TileArea TileGrid::area(std::size_t tile) const {
  TileArea area;
  area.left = static_cast<int>(tile % static_cast<std::size_t>(columns())) * tile_size;
  area.bottom = static_cast<int>(tile / static_cast<std::size_t>(columns())) * tile_size;
  area.width = std::min(tile_size, width - area.left);
  area.height = std::min(tile_size, height - area.bottom);
  return area;
}

void Bins::fill(const TileGrid& grid, std::span<const PixelBounds> bounds, std::span<const std::uint8_t> closed) {
  const std::size_t tiles = grid.size(), columns = static_cast<std::size_t>(grid.columns());
  const std::size_t slices = std::clamp(bounds.size() / slots_per_slice, std::size_t{1}, most_slices);
  const auto for_each_slot = [&](std::size_t slice, const auto& visit) {
    for (std::size_t i = bounds.size() * slice / slices; i < bounds.size() * (slice + 1) / slices; ++i)
      for_each_tile(bounds[i], columns, [&](std::size_t tile) {
        if (closed[tile] == 0) visit(i, tile);
      });
  };
  counts_.assign(slices * tiles, 0);
  parallel_for(std::size_t{0}, slices, [&](std::size_t slice) {
    std::uint32_t* counts = counts_.data() + slice * tiles;
    for_each_slot(slice, [&](std::size_t, std::size_t tile) { ++counts[tile]; });
  });

  // Tile after tile, and slice after slice within: slots keep their order.
  begins_.resize(tiles + 1);
  std::uint32_t total = 0;
  for (std::size_t tile = 0; tile < tiles; ++tile) {
    begins_[tile] = total;
    for (std::size_t slice = 0; slice < slices; ++slice) total += std::exchange(counts_[slice * tiles + tile], total);
  }
  begins_[tiles] = total;

  if (slots_.size() < total) slots_.resize(total);
  parallel_for(std::size_t{0}, slices, [&](std::size_t slice) {
    std::uint32_t* next = counts_.data() + slice * tiles;
    for_each_slot(slice,
                  [&](std::size_t i, std::size_t tile) { slots_[next[tile]++] = static_cast<std::uint32_t>(i); });
  });
}

std::uint64_t Bins::memory_bytes() const {
  return sizeof(std::uint32_t) * (counts_.capacity() + begins_.capacity() + slots_.capacity());
}

}  // namespace splatvol::tiles
