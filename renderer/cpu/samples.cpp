#include "renderer/cpu/samples.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "renderer/cpu/samples.cpp"
#include "base/parallel.h"
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

/// The cubic from one sample to the next, with its slopes there.
template <class Tag, class Vector = hn::Vec<Tag>>
struct Cubic {
  Vector first, slope, square, cube;  // the factors of the powers of the place

  /// `rise`: from the first sample to the last.
  HWY_INLINE Cubic(Tag tag, Vector first_sample, Vector rise, Vector first_slope, Vector last_slope)
      : first(first_sample),
        slope(first_slope),
        square(hn::Sub(hn::MulSub(hn::Set(tag, 3.0F), rise, hn::Add(first_slope, first_slope)), last_slope)),
        cube(hn::NegMulAdd(hn::Set(tag, 2.0F), rise, hn::Add(first_slope, last_slope))) {}

  [[nodiscard]] HWY_INLINE Vector at(Tag tag, float place) const {
    const Vector f = hn::Set(tag, place);
    return hn::MulAdd(f, hn::MulAdd(f, hn::MulAdd(f, cube, square), slope), first);
  }
};

void fill_along_row(const vec4* samples, const SampledAxis& axis, vec4* pixels) {
  const PixelTag tag;
  const auto load_sample = [&](int i) HWY_ATTR { return hn::LoadU(tag, &samples[i].x); };
  // What a gap shares with the one before.
  const SampledAxis::Gap& left = axis.gaps.front();
  auto first = load_sample(left.samples[1]), rise = hn::Sub(load_sample(left.samples[2]), first);
  auto slope = slope_between(tag, hn::Sub(first, load_sample(left.samples[0])), rise);
  for (const SampledAxis::Gap& gap : axis.gaps) {
    const auto last = load_sample(gap.samples[2]), next_rise = hn::Sub(load_sample(gap.samples[3]), last);
    const auto last_slope = slope_between(tag, rise, next_rise);
    const Cubic cubic(tag, first, rise, slope, last_slope);
    for (int pixel = gap.begin; pixel < gap.end; ++pixel)
      hn::StoreU(cubic.at(tag, axis.places[static_cast<std::size_t>(pixel)]), tag, &pixels[pixel].x);
    first = last;
    rise = next_rise;
    slope = last_slope;
  }
}

/// Fills as many pixels as there are lanes for each place between the second and the third of four rows.
template <class Tag>
HWY_INLINE void fill_lanes(Tag tag, const std::array<const float*, 4>& rows, std::span<const float> places,
                           float* pixels, std::size_t row_length) {
  const auto first = hn::LoadU(tag, rows[1]), last = hn::LoadU(tag, rows[2]), rise = hn::Sub(last, first);
  const Cubic cubic(tag, first, rise, slope_between(tag, hn::Sub(first, hn::LoadU(tag, rows[0])), rise),
                    slope_between(tag, rise, hn::Sub(hn::LoadU(tag, rows[3]), last)));
  for (const float place : places) {
    hn::StoreU(sound_pixels(tag, cubic.at(tag, place)), tag, pixels);
    pixels += row_length;
  }
}

void fill_rows(const std::array<const vec4*, 4>& rows, std::span<const float> places, vec4* pixels, std::size_t width) {
  const std::size_t lanes = hn::Lanes(FloatTag()), row_length = channels * width;
  const auto rows_from = [&](std::size_t i) {
    return std::array{&rows[0]->x + i, &rows[1]->x + i, &rows[2]->x + i, &rows[3]->x + i};
  };
  std::size_t i = 0;
  for (; i + lanes <= row_length; i += lanes) fill_lanes(FloatTag(), rows_from(i), places, &pixels->x + i, row_length);
  for (; i < row_length; i += channels) fill_lanes(PixelTag(), rows_from(i), places, &pixels->x + i, row_length);
}

}  // namespace
}  // namespace splatvol::tiles::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatvol::tiles {
HWY_EXPORT(fill_along_row);
HWY_EXPORT(fill_rows);

namespace {

// `shift`: pixels by which samples lie before those of the sampled_view.
SampledAxis axis_of(int pixels, int samples, int spacing, float shift) {
  SampledAxis axis;
  int last = -2;
  for (int pixel = 0; pixel < pixels; ++pixel) {
    const float at =
        (static_cast<float>(pixel) + 0.5F - 0.5F * static_cast<float>(pixels) + shift) / static_cast<float>(spacing) +
        0.5F * static_cast<float>(samples) - 0.5F;
    const float before = std::floor(at);
    axis.places.push_back(at - before);
    // Every sample between pixels has a gap, as samples are no denser than pixels.
    if (const int sample = static_cast<int>(before); std::exchange(last, sample) != sample) {
      SampledAxis::Gap& gap = axis.gaps.emplace_back(SampledAxis::Gap{{}, pixel, pixel});
      for (int k = 0; k < 4; ++k) gap.samples[k] = std::clamp(sample + k - 1, 0, samples - 1);
    }
    ++axis.gaps.back().end;
  }
  return axis;
}

std::vector<std::int32_t> blocks_of(const SampledAxis& axis) {
  std::vector<std::int32_t> blocks;
  for (std::size_t i = 0; i < axis.gaps.size(); ++i)
    blocks.insert(blocks.end(), static_cast<std::size_t>(axis.gaps[i].end - axis.gaps[i].begin),
                  static_cast<std::int32_t>(i));
  return blocks;
}

bool differ(const std::array<vec4, 4>& corners, float most) {
  const auto& [a, b, c, d] = corners;
  const vec4 change = glm::max(glm::max(a, b), glm::max(c, d)) - glm::min(glm::min(a, b), glm::min(c, d));
  return std::max({change.r, change.g, change.b, change.a}) > most;
}

}  // namespace

DifferingBlocks::DifferingBlocks(const Image& samples, int spacing, const SampleShift& shift, int width, int height,
                                 float most) {
  const SampledAxis across = axis_of(width, samples.width, spacing, shift.left);
  const SampledAxis down = axis_of(height, samples.height, spacing, shift.up);
  columns_ = blocks_of(across);
  lines_ = blocks_of(down);
  stride_ = across.gaps.size() + 1;
  sums_.assign(stride_ * (down.gaps.size() + 1), 0);
  for (std::size_t j = 0; j < down.gaps.size(); ++j)
    for (std::size_t i = 0; i < across.gaps.size(); ++i) {
      const auto at = [&](std::size_t right, std::size_t below) {
        return samples.at(across.gaps[i].samples[1 + right], down.gaps[j].samples[1 + below]);
      };
      const int column = static_cast<int>(i), line = static_cast<int>(j);
      sum(column + 1, line + 1) = sum(column, line + 1) + sum(column + 1, line) - sum(column, line) +
                                  (differ({at(0, 0), at(1, 0), at(0, 1), at(1, 1)}, most) ? 1 : 0);
    }
}

void interpolate(const Image& samples, int spacing, Image& rows, Image& picture, const SampleShift& shift) {
  rows.width = picture.width;
  rows.height = samples.height;
  rows.pixels.resize(static_cast<std::size_t>(rows.width) * static_cast<std::size_t>(rows.height));
  // Pictures begin with the upper row, samples count from the lower left corner: the middle is common to both.
  const SampledAxis across = axis_of(picture.width, samples.width, spacing, shift.left);
  parallel_for(0, samples.height, [&](int y) {
    HWY_DYNAMIC_DISPATCH(fill_along_row)(&samples.at(0, y), across, &rows.at(0, y));
  });
  const SampledAxis up = axis_of(picture.height, samples.height, spacing, shift.up);
  parallel_for(std::size_t{0}, up.gaps.size(), [&](std::size_t i) {
    const SampledAxis::Gap& gap = up.gaps[i];
    const auto at = [&](std::size_t k) { return &std::as_const(rows).at(0, gap.samples[k]); };
    HWY_DYNAMIC_DISPATCH(fill_rows)
    ({at(0), at(1), at(2), at(3)}, up.places_of(gap), &picture.at(0, gap.begin),
     static_cast<std::size_t>(picture.width));
  });
}

}  // namespace splatvol::tiles
#endif
