#include "renderer/cpu/samples.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

namespace splatvol::tiles {
namespace {

/// Four neighbouring samples, cut off at the ends; their weights by Catmull and Rom; where the pixel is between the
/// second and the third.
struct Neighbours {
  std::array<int, 4> at;
  std::array<float, 4> weights;
  float f;
};

Neighbours neighbours_of(int pixel, int pixels, int samples, int spacing) {
  const float at =
      (static_cast<float>(pixel) + 0.5F - 0.5F * static_cast<float>(pixels)) / static_cast<float>(spacing) +
      0.5F * static_cast<float>(samples) - 0.5F;
  const float whole = std::floor(at), f = at - whole;
  Neighbours result;
  for (int k = 0; k < 4; ++k) result.at[k] = std::clamp(static_cast<int>(whole) + k - 1, 0, samples - 1);
  result.weights = {0.5F * f * (-1 + f * (2 - f)), 0.5F * (2 + f * f * (-5 + 3 * f)), 0.5F * f * (1 + f * (4 - 3 * f)),
                    0.5F * f * f * (f - 1)};
  result.f = f;
  return result;
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

Channels between(const std::array<Channels, 4>& s, const Neighbours& from, Interpolation interpolation) {
  if (interpolation == Interpolation::catmull_rom) {
    Channels sum{};
    for (std::size_t k = 0; k < 4; ++k) sum += from.weights[k] * s[k];
    return sum;
  }
  const Channels here = s[2] - s[1];
  const Channels first = slope_between(s[1] - s[0], here), last = slope_between(here, s[3] - s[2]);
  const float f = from.f;
  return s[1] + f * (first + f * (3.0F * here - 2.0F * first - last + f * (first + last - 2.0F * here)));
}

/// Colours stay between black and white of their alpha.
vec4 sound_pixel(const Channels& sum) {
  const float alpha = std::clamp(sum[3], 0.0F, 1.0F);
  const Channels zero{}, white = {alpha, alpha, alpha, alpha};
  const Channels above = sum < zero ? zero : sum;
  return std::bit_cast<vec4>(above > white ? white : above);
}

}  // namespace

View sampled_view(View view, int spacing) {
  const auto count = [spacing](int pixels) { return (pixels + spacing - 1) / spacing + 2; };
  if (spacing == 1) return view;
  view.width = count(view.width);
  view.height = count(view.height);
  view.focal /= spacing;
  return view;
}

void interpolate(const Image& samples, int spacing, Interpolation interpolation, Image& rows, Image& picture) {
  rows.width = samples.width;
  rows.height = picture.height;
  rows.pixels.resize(static_cast<std::size_t>(rows.width) * rows.height);
  tbb::parallel_for(0, rows.height, [&](int y) {
    // Pictures begin with the upper row, samples count from the lower left corner: the middle is common to both.
    const Neighbours from = neighbours_of(y, picture.height, samples.height, spacing);
    for (int x = 0; x < rows.width; ++x) {
      const auto sample = [&](int k) { return channels(samples.at(x, from.at[k])); };
      rows.at(x, y) = sound_pixel(between({sample(0), sample(1), sample(2), sample(3)}, from, interpolation));
    }
  });

  std::vector<Neighbours> columns;
  columns.reserve(static_cast<std::size_t>(picture.width));
  for (int x = 0; x < picture.width; ++x) columns.push_back(neighbours_of(x, picture.width, samples.width, spacing));
  tbb::parallel_for(0, picture.height, [&](int y) {
    for (int x = 0; x < picture.width; ++x) {
      const Neighbours& from = columns[static_cast<std::size_t>(x)];
      const auto sample = [&](int k) { return channels(rows.at(from.at[k], y)); };
      picture.at(x, y) = sound_pixel(between({sample(0), sample(1), sample(2), sample(3)}, from, interpolation));
    }
  });
}

}  // namespace splatvol::tiles
