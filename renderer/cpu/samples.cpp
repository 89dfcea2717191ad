#include "renderer/cpu/samples.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <utility>
#include <vector>

namespace splatvol::tiles {
namespace {

/// Pixels between two neighbouring samples.
struct Gap {
  std::array<int, 4> samples;  // the two around, and one more on each side; cut off at the ends
  int begin, end;              // pixels
};

/// Where the pixels of an axis are.
struct Axis {
  std::vector<Gap> gaps;
  std::vector<float> places;  // [pixel]: from 0 at the sample before to 1 at the one behind
};

Axis axis_of(int pixels, int samples, int spacing) {
  Axis axis;
  int last = -2;
  for (int pixel = 0; pixel < pixels; ++pixel) {
    const float at =
        (static_cast<float>(pixel) + 0.5F - 0.5F * static_cast<float>(pixels)) / static_cast<float>(spacing) +
        0.5F * static_cast<float>(samples) - 0.5F;
    const float before = std::floor(at);
    axis.places.push_back(at - before);
    if (const int sample = static_cast<int>(before); std::exchange(last, sample) != sample) {
      Gap& gap = axis.gaps.emplace_back(Gap{{}, pixel, pixel});
      for (int k = 0; k < 4; ++k) gap.samples[k] = std::clamp(sample + k - 1, 0, samples - 1);
    }
    ++axis.gaps.back().end;
  }
  return axis;
}

// The channels of a pixel side by side.
using Channels [[gnu::vector_size(sizeof(vec4))]] = float;

Channels channels(const vec4& pixel) { return std::bit_cast<Channels>(pixel); }

Channels smaller(const Channels& a, const Channels& b) { return a < b ? a : b; }
Channels larger(const Channels& a, const Channels& b) { return a < b ? b : a; }

/// The slope at a sample between two differences: their mean, but none at a peak, and no more than three times the
/// smaller difference. So the cubic does not overshoot.
Channels slope_between(const Channels& before, const Channels& after) {
  const Channels zero{}, three = {3, 3, 3, 3}, half = {0.5F, 0.5F, 0.5F, 0.5F};
  const Channels mean = half * (before + after);
  const Channels rise = smaller(mean, three * smaller(before, after)),
                 fall = larger(mean, three * larger(before, after));
  return before * after > zero ? (before > zero ? rise : fall) : zero;
}

/// The cubic between the second and the third of four samples.
struct Cubic {
  std::array<Channels, 4> factors;  // of the powers of the place

  explicit Cubic(const std::array<Channels, 4>& s) {
    const Channels here = s[2] - s[1];
    const Channels first = slope_between(s[1] - s[0], here), last = slope_between(here, s[3] - s[2]);
    factors = {s[1], first, 3.0F * here - 2.0F * first - last, first + last - 2.0F * here};
  }
  [[nodiscard]] Channels operator()(float f) const {
    return factors[0] + f * (factors[1] + f * (factors[2] + f * factors[3]));
  }
};

/// Calls set(pixel, channels) for all pixels of an axis. `sample`: returns the channels of one.
template <class Sample, class Set>
void interpolate_along(const Axis& axis, const Sample& sample, const Set& set) {
  for (const Gap& gap : axis.gaps) {
    const Cubic cubic({sample(gap.samples[0]), sample(gap.samples[1]), sample(gap.samples[2]), sample(gap.samples[3])});
    for (int pixel = gap.begin; pixel < gap.end; ++pixel)
      set(pixel, cubic(axis.places[static_cast<std::size_t>(pixel)]));
  }
}

/// Colours stay between black and white of their alpha: each channel has a cubic of its own.
vec4 sound_pixel(const Channels& pixel) {
  const Channels zero{}, one = {1, 1, 1, 1};
  const Channels inside = smaller(larger(pixel, zero), one);
  return std::bit_cast<vec4>(smaller(inside, Channels{inside[3], inside[3], inside[3], inside[3]}));
}

}  // namespace

void interpolate(const Image& samples, int spacing, Image& rows, Image& picture) {
  rows.width = samples.width;
  rows.height = picture.height;
  rows.pixels.resize(static_cast<std::size_t>(rows.width) * static_cast<std::size_t>(rows.height));
  // Pictures begin with the upper row, samples count from the lower left corner: the middle is common to both.
  const Axis up = axis_of(picture.height, samples.height, spacing);
  tbb::parallel_for(0, samples.width, [&](int x) {
    interpolate_along(
        up, [&](int y) { return channels(samples.at(x, y)); },
        [&](int y, const Channels& pixel) { rows.at(x, y) = std::bit_cast<vec4>(pixel); });
  });
  const Axis across = axis_of(picture.width, samples.width, spacing);
  tbb::parallel_for(0, picture.height, [&](int y) {
    interpolate_along(
        across, [&](int x) { return channels(rows.at(x, y)); },
        [&](int x, const Channels& pixel) { picture.at(x, y) = sound_pixel(pixel); });
  });
}

}  // namespace splatvol::tiles
