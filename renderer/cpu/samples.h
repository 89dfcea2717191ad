// The picture between samples that are farther apart than pixels. Internal to the tiles.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "pictures/image.h"
#include "scene/tile_grid.h"

namespace splatvol::tiles {

/// Where the pixels of an axis are.
struct SampledAxis {
  /// Pixels between two neighbouring samples.
  struct Gap {
    std::array<int, 4> samples;  // the two around, and one more on each side; cut off at the ends
    int begin, end;              // pixels
  };
  std::vector<Gap> gaps;
  std::vector<float> places;  // [pixel]: from 0 at the sample before to 1 at the one behind

  [[nodiscard]] std::span<const float> places_of(const Gap& gap) const {
    return std::span(places).subspan(static_cast<std::size_t>(gap.begin),
                                     static_cast<std::size_t>(gap.end - gap.begin));
  }
};

/// Pixels by which samples lie left of those of the sampled_view, and above.
struct SampleShift {
  float left = 0, up = 0;
};

/// Makes a picture of this size from `samples`, a picture of its sampled_view: by cubics that do not overshoot, so that
/// thin bright lines keep their light, one axis after the other. `rows`: scratch memory. `shift`: at most half a pixel.
void interpolate(const Image& samples, int spacing, Image& rows, Image& picture, const SampleShift& shift = {});

/// The blocks of pixels between four samples that differ: there, pictures of samples show steps.
class DifferingBlocks {
 public:
  /// `samples`, `spacing`, `shift`: as those of interpolate, for a picture of this size. Lists the blocks whose samples
  /// differ by more than `most` in a channel.
  DifferingBlocks(const Image& samples, int spacing, const SampleShift& shift, int width, int height, float most);

  [[nodiscard]] bool is_empty() const { return sums_.back() == 0; }

  /// Returns whether the pixel in a row, counted from the upper one, is in such a block.
  [[nodiscard]] bool has(int x, int row) const {
    const int column = columns_[static_cast<std::size_t>(x)], line = lines_[static_cast<std::size_t>(row)];
    return count({column, column, line, line}) > 0;
  }

  /// Returns whether a rectangle of the picture has such a pixel.
  [[nodiscard]] bool meet(const PixelRectangle& pixels) const {
    const auto line = [&](int y) { return lines_[lines_.size() - 1 - static_cast<std::size_t>(y)]; };
    return count({columns_[static_cast<std::size_t>(pixels.x0)], columns_[static_cast<std::size_t>(pixels.x1)],
                  line(pixels.y1), line(pixels.y0)}) > 0;
  }

 private:
  [[nodiscard]] std::int32_t& sum(int column, int line) {
    return sums_[static_cast<std::size_t>(line) * stride_ + static_cast<std::size_t>(column)];
  }
  [[nodiscard]] std::int32_t sum(int column, int line) const {
    return sums_[static_cast<std::size_t>(line) * stride_ + static_cast<std::size_t>(column)];
  }
  // `blocks`: columns, and lines from the upper one.
  [[nodiscard]] std::int32_t count(const PixelRectangle& blocks) const {
    return sum(blocks.x1 + 1, blocks.y1 + 1) - sum(blocks.x0, blocks.y1 + 1) - sum(blocks.x1 + 1, blocks.y0) +
           sum(blocks.x0, blocks.y0);
  }

  std::vector<std::int32_t> columns_, lines_;  // [pixel], [row]: its block
  std::size_t stride_;                         // columns of blocks, and one
  std::vector<std::int32_t> sums_;             // [line][column]: how many blocks before both differ
};

}  // namespace splatvol::tiles
