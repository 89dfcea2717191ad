// Lists of the splats that touch each tile. Internal to the tiles.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "renderer/cpu/frame.h"

namespace splatvol::tiles {

/// The tiles of a picture, row after row from the lower left corner.
struct TileGrid {
  int width = 0, height = 0;  // of the picture, in pixels

  [[nodiscard]] int columns() const { return (width + tile_size - 1) / tile_size; }
  [[nodiscard]] int rows() const { return (height + tile_size - 1) / tile_size; }
  [[nodiscard]] std::size_t size() const { return static_cast<std::size_t>(columns()) * rows(); }
  [[nodiscard]] TileArea area(std::size_t tile) const;
};

/// Keeps its memory between calls. Not thread-safe.
class Bins {
 public:
  /// Lists the slots whose bounds touch a tile, rising. Works in parallel; the result does not depend on threads.
  /// `closed`: of each tile, whether its list stays empty.
  void fill(const TileGrid& grid, std::span<const PixelBounds> bounds, std::span<const std::uint8_t> closed);

  /// Returns the slots of a tile; valid until the next call.
  [[nodiscard]] std::span<const std::uint32_t> slots(std::size_t tile) const {
    return std::span(slots_).subspan(begins_[tile], begins_[tile + 1] - begins_[tile]);
  }

  [[nodiscard]] std::uint64_t memory_bytes() const;

 private:
  std::vector<std::uint32_t> counts_;  // [slice][tile]: of its slots; then where the next of them goes
  std::vector<std::uint32_t> begins_;
  std::vector<std::uint32_t> slots_;
};

}  // namespace splatvol::tiles
