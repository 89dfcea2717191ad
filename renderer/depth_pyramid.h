// Depths of surfaces as rasterizers read them. Internal to the renderer.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "base/error.h"
#include "scene/scene.h"
#include "splatvol/surface_depths.h"

namespace splatvol {

/// The nearest and the farthest surface in some pixels.
struct DepthRange {
  float nearest = std::numeric_limits<float>::infinity();
  float farthest = -std::numeric_limits<float>::infinity();

  void include(const DepthRange& other) {
    nearest = other.nearest < nearest ? other.nearest : nearest;
    farthest = other.farthest > farthest ? other.farthest : farthest;
  }
};

/// Surfaces of a picture, in drawing units. Pixels count from the lower left corner. No depth is negative or NaN.
/// Besides, the range of the depths in each cell of 4 x 4 pixels, and in cells of twice the edge, again and again.
class DepthPyramid {
 public:
  /// The ranges of cells with one size, row after row. The numbers of rows and columns are powers of two; cells beyond
  /// the picture have no range.
  struct Level {
    int columns = 0, rows = 0;
    std::vector<DepthRange> ranges;
  };

  /// `unit`: a drawing unit, in world units. Requires depths that pass `check_surface_depths`. Works in parallel.
  DepthPyramid(const SurfaceDepths& depths, double unit);

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  /// Returns how many numbers lie from one row to the next: enough to read a vector or a tile from any pixel on.
  [[nodiscard]] int row_stride() const { return row_stride_; }
  [[nodiscard]] const float* at(int x, int y) const {
    return depths_.data() + static_cast<std::ptrdiff_t>(y) * row_stride_ + x;
  }

  /// Returns a range that holds the depths in pixels [left, right) x [bottom, top): that of some cells round them.
  [[nodiscard]] DepthRange range(int left, int bottom, int right, int top) const;

  /// Returns the levels, the smallest cells first. The last one has a single cell.
  [[nodiscard]] const std::vector<Level>& levels() const { return levels_; }

  [[nodiscard]] std::uint64_t memory_bytes() const;

 private:
  void add_rows_of_cells(const SurfaceDepths& depths, double unit);
  void add_coarser_levels();

  int width_, height_, row_stride_;
  std::vector<float> depths_;
  std::vector<Level> levels_;
};

/// Fails with ErrorCode::invalid_argument unless there is a depth for each pixel.
[[nodiscard]] Status check_surface_depths(const SurfaceDepths& depths);

/// Fails with ErrorCode::invalid_argument unless the depths are those of a picture of the view.
[[nodiscard]] Status check_size(const SurfaceDepths& depths, const View& view);

}  // namespace splatvol
