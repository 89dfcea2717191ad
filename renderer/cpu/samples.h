// The picture between samples that are farther apart than pixels. Internal to the tiles.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "pictures/image.h"

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

}  // namespace splatvol::tiles
