// A picture cut into square tiles, which are drawn one by one.
#pragma once

#include <algorithm>
#include <cstddef>

namespace splatvol {

/// A range of pixels, both ends included; columns from the left, rows from the bottom.
struct PixelRectangle {
  int x0, x1, y0, y1;

  [[nodiscard]] bool is_empty() const { return x0 > x1 || y0 > y1; }
};

/// The tiles of a picture, row after row. Those at its right and upper edge may be smaller.
class TileGrid {
 public:
  /// All in pixels, and at least 1.
  TileGrid(int side, int width, int height)
      : side_(side), width_(width), height_(height), across_((width + side - 1) / side) {}

  /// Returns the number of tiles.
  [[nodiscard]] std::size_t count() const {
    return static_cast<std::size_t>(across_) * static_cast<std::size_t>((height_ + side_ - 1) / side_);
  }

  /// Returns the pixels of a tile.
  [[nodiscard]] PixelRectangle tile(std::size_t number) const {
    const int row = static_cast<int>(number / static_cast<std::size_t>(across_));
    const int column = static_cast<int>(number % static_cast<std::size_t>(across_));
    return {column * side_, std::min((column + 1) * side_, width_) - 1, row * side_,
            std::min((row + 1) * side_, height_) - 1};
  }

  /// Calls `visit` with the number of each tile that shares pixels with a rectangle of the picture.
  template <class Visit>
  void visit_tiles(const PixelRectangle& bounds, const Visit& visit) const {
    if (bounds.is_empty()) return;
    for (int y = bounds.y0 / side_; y <= bounds.y1 / side_; ++y)
      for (int x = bounds.x0 / side_; x <= bounds.x1 / side_; ++x)
        visit(static_cast<std::size_t>(y) * static_cast<std::size_t>(across_) + static_cast<std::size_t>(x));
  }

 private:
  int side_, width_, height_, across_;
};

}  // namespace splatvol
