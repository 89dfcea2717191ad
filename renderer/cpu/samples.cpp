#include "renderer/cpu/samples.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "renderer/cpu/samples.cpp"
#include "renderer/cpu/targets.h"
// The order matters: this includes the file again, once for each instruction set.
#include <hwy/foreach_target.h>

#include "renderer/cpu/vector-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatvol::tiles::HWY_NAMESPACE {
namespace {

constexpr std::size_t channels = 4;
using PixelTag = hn::CappedTag<float, channels>;

/// The slope at a sample between two differences: their mean, but none at a peak, and no more than three times the
/// smaller difference. So the cubic does not overshoot.
template <class Tag, class Vector = hn::Vec<Tag>>
HWY_INLINE Vector slope_between(Tag tag, Vector before, Vector after) {
  const Vector zero = hn::Zero(tag), three = hn::Set(tag, 3.0F);
  const Vector mean = hn::Mul(hn::Set(tag, 0.5F), hn::Add(before, after));
  const Vector rise = hn::Min(mean, hn::Mul(three, hn::Min(before, after))),
               fall = hn::Max(mean, hn::Mul(three, hn::Max(before, after)));
  return hn::IfThenElseZero(hn::Gt(hn::Mul(before, after), zero), hn::IfThenElse(hn::Gt(before, zero), rise, fall));
}

/// Colours stay between black and white of their alpha: each channel has a cubic of its own.
template <class Tag, class Vector = hn::Vec<Tag>>
HWY_INLINE Vector sound_pixels(Tag tag, Vector pixels) {
  const Vector inside = hn::Min(hn::Max(pixels, hn::Zero(tag)), hn::Set(tag, 1.0F));
  return hn::Min(inside, hn::Broadcast<3>(inside));
}

/// Fills as many pixels as there are lanes for at each place between the second and the third of four samples. The
/// pixels of the next place are `stride` numbers behind.
template <class Tag>
HWY_INLINE void fill_lanes(Tag tag, const std::array<const float*, 4>& samples, std::span<const float> places,
                           float* pixels, std::size_t stride) {
  const auto first = hn::LoadU(tag, samples[1]), last = hn::LoadU(tag, samples[2]), here = hn::Sub(last, first);
  const auto slope = slope_between(tag, hn::Sub(first, hn::LoadU(tag, samples[0])), here),
             last_slope = slope_between(tag, here, hn::Sub(hn::LoadU(tag, samples[3]), last));
  // The factors of the powers of the place.
  const auto square = hn::Sub(hn::MulSub(hn::Set(tag, 3.0F), here, hn::Add(slope, slope)), last_slope),
             cube = hn::NegMulAdd(hn::Set(tag, 2.0F), here, hn::Add(slope, last_slope));
  for (const float place : places) {
    const auto f = hn::Set(tag, place);
    const auto between = hn::MulAdd(f, hn::MulAdd(f, hn::MulAdd(f, cube, square), slope), first);
    hn::StoreU(sound_pixels(tag, between), tag, pixels);
    pixels += stride;
  }
}

void fill_along_row(const vec4* samples, const SampledAxis& axis, vec4* pixels) {
  for (const SampledAxis::Gap& gap : axis.gaps) {
    const auto at = [&](std::size_t k) { return &samples[gap.samples[k]].x; };
    fill_lanes(PixelTag(), {at(0), at(1), at(2), at(3)}, axis.places_of(gap), &pixels[gap.begin].x, channels);
  }
}

void fill_rows(const std::array<const vec4*, 4>& samples, std::span<const float> places, vec4* pixels,
               std::size_t width) {
  const std::size_t lanes = hn::Lanes(FloatTag());
  const auto from = [&](std::size_t i) {
    return std::array{&samples[0]->x + i, &samples[1]->x + i, &samples[2]->x + i, &samples[3]->x + i};
  };
  const std::size_t numbers = channels * width;
  std::size_t i = 0;
  for (; i + lanes <= numbers; i += lanes) fill_lanes(FloatTag(), from(i), places, &pixels->x + i, numbers);
  for (; i < numbers; i += channels) fill_lanes(PixelTag(), from(i), places, &pixels->x + i, numbers);
}

}  // namespace
}  // namespace splatvol::tiles::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatvol::tiles {
HWY_EXPORT(fill_along_row);
HWY_EXPORT(fill_rows);

namespace {

SampledAxis axis_of(int pixels, int samples, int spacing) {
  SampledAxis axis;
  int last = -2;
  for (int pixel = 0; pixel < pixels; ++pixel) {
    const float at =
        (static_cast<float>(pixel) + 0.5F - 0.5F * static_cast<float>(pixels)) / static_cast<float>(spacing) +
        0.5F * static_cast<float>(samples) - 0.5F;
    const float before = std::floor(at);
    axis.places.push_back(at - before);
    if (const int sample = static_cast<int>(before); std::exchange(last, sample) != sample) {
      SampledAxis::Gap& gap = axis.gaps.emplace_back(SampledAxis::Gap{{}, pixel, pixel});
      for (int k = 0; k < 4; ++k) gap.samples[k] = std::clamp(sample + k - 1, 0, samples - 1);
    }
    ++axis.gaps.back().end;
  }
  return axis;
}

}  // namespace

void interpolate(const Image& samples, int spacing, Image& rows, Image& picture) {
  rows.width = picture.width;
  rows.height = samples.height;
  rows.pixels.resize(static_cast<std::size_t>(rows.width) * static_cast<std::size_t>(rows.height));
  // Pictures begin with the upper row, samples count from the lower left corner: the middle is common to both.
  const SampledAxis across = axis_of(picture.width, samples.width, spacing);
  tbb::parallel_for(0, samples.height, [&](int y) {
    HWY_DYNAMIC_DISPATCH(fill_along_row)(&samples.at(0, y), across, &rows.at(0, y));
  });
  const SampledAxis up = axis_of(picture.height, samples.height, spacing);
  tbb::parallel_for(std::size_t{0}, up.gaps.size(), [&](std::size_t i) {
    const SampledAxis::Gap& gap = up.gaps[i];
    const auto at = [&](std::size_t k) { return &std::as_const(rows).at(0, gap.samples[k]); };
    HWY_DYNAMIC_DISPATCH(fill_rows)
    ({at(0), at(1), at(2), at(3)}, up.places_of(gap), &picture.at(0, gap.begin),
     static_cast<std::size_t>(picture.width));
  });
}

}  // namespace splatvol::tiles
#endif
