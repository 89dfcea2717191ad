#include "renderer/depth_pyramid.h"

#include <algorithm>
#include <bit>
#include <utility>

#include "base/parallel.h"

namespace splatvol {
namespace {

constexpr int cell_shift = 2;  // cells of level 0 have 4 x 4 pixels
constexpr int cell_size = 1 << cell_shift;
constexpr int row_margin = 64;  // more than a tile, and than a vector

constexpr float infinity = std::numeric_limits<float>::infinity();

float in_drawing_units(float depth, double unit) {
  if (depth > 0) return static_cast<float>(depth / unit);
  return depth <= 0 ? 0 : infinity;
}

int cells_along(int pixels) {
  return static_cast<int>(std::bit_ceil(static_cast<unsigned>((pixels + cell_size - 1) / cell_size)));
}

}  // namespace

DepthPyramid::DepthPyramid(const SurfaceDepths& depths, double unit)
    : width_(depths.width),
      height_(depths.height),
      row_stride_(depths.width + row_margin),
      // Vectors of two rows may begin at the last one.
      depths_(static_cast<std::size_t>(row_stride_) * (static_cast<std::size_t>(height_) + 1), infinity) {
  add_rows_of_cells(depths, unit);
  add_coarser_levels();
}

void DepthPyramid::add_rows_of_cells(const SurfaceDepths& depths, double unit) {
  Level& level = levels_.emplace_back(Level{cells_along(width_), cells_along(height_), {}});
  level.ranges.resize(static_cast<std::size_t>(level.columns) * level.rows);
  parallel_for(0, (height_ + cell_size - 1) / cell_size, [&](int row) {
    DepthRange* ranges = level.ranges.data() + static_cast<std::ptrdiff_t>(row) * level.columns;
    for (int y = row * cell_size; y < std::min((row + 1) * cell_size, height_); ++y) {
      const float* from = depths.depths.data() + static_cast<std::ptrdiff_t>(height_ - 1 - y) * width_;
      float* to = depths_.data() + static_cast<std::ptrdiff_t>(y) * row_stride_;
      for (int x = 0; x < width_; ++x) {
        to[x] = in_drawing_units(from[x], unit);
        ranges[x >> cell_shift].include({to[x], to[x]});
      }
    }
  });
}

void DepthPyramid::add_coarser_levels() {
  while (levels_.back().ranges.size() > 1) {
    const Level& fine = levels_.back();
    Level coarse{std::max(fine.columns / 2, 1), std::max(fine.rows / 2, 1), {}};
    coarse.ranges.resize(static_cast<std::size_t>(coarse.columns) * coarse.rows);
    for (int y = 0; y < fine.rows; ++y)
      for (int x = 0; x < fine.columns; ++x) {
        const int row = std::min(y / 2, coarse.rows - 1), column = std::min(x / 2, coarse.columns - 1);
        coarse.ranges[static_cast<std::size_t>(row) * coarse.columns + column].include(
            fine.ranges[static_cast<std::size_t>(y) * fine.columns + x]);
      }
    levels_.push_back(std::move(coarse));
  }
}

DepthRange DepthPyramid::range(int left, int bottom, int right, int top) const {
  right = std::min(right, width_);
  top = std::min(top, height_);
  if (left >= right || bottom >= top) return {};
  // Cells as large as the pixels' extent: at most two of them along an axis.
  const auto extent = static_cast<unsigned>(std::max(right - left, top - bottom));
  const int doublings = std::max(static_cast<int>(std::bit_width(extent - 1)) - cell_shift, 0);
  const auto number = std::min(static_cast<std::size_t>(doublings), levels_.size() - 1);
  const int shift = cell_shift + static_cast<int>(number);
  const Level& level = levels_[number];
  DepthRange range;
  for (int row = bottom >> shift; row <= (top - 1) >> shift; ++row)
    for (int column = left >> shift; column <= (right - 1) >> shift; ++column)
      range.include(level.ranges[static_cast<std::size_t>(row) * level.columns + column]);
  return range;
}

std::uint64_t DepthPyramid::memory_bytes() const {
  std::uint64_t bytes = sizeof(float) * depths_.capacity();
  for (const Level& level : levels_) bytes += sizeof(DepthRange) * level.ranges.capacity();
  return bytes;
}

Status check_surface_depths(const SurfaceDepths& depths) {
  if (depths.width >= 1 && depths.height >= 1 &&
      depths.depths.size() == static_cast<std::size_t>(depths.width) * static_cast<std::size_t>(depths.height))
    return {};
  return fail(ErrorCode::invalid_argument, "{} depths of surfaces for {} x {} pixels", depths.depths.size(),
              depths.width, depths.height);
}

Status check_size(const SurfaceDepths& depths, const View& view) {
  if (depths.width == view.width && depths.height == view.height) return {};
  return fail(ErrorCode::invalid_argument, "depths of surfaces for {} x {} pixels, but the picture has {} x {}",
              depths.width, depths.height, view.width, view.height);
}

}  // namespace splatvol
