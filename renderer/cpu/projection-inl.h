// Parts that the projections of both kernels share. Included once for each instruction set.
#if defined(SPLATVOL_RENDERER_CPU_PROJECTION_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATVOL_RENDERER_CPU_PROJECTION_INL_H
#undef SPLATVOL_RENDERER_CPU_PROJECTION_INL_H
#else
#define SPLATVOL_RENDERER_CPU_PROJECTION_INL_H
#endif

#include <algorithm>
#include <cmath>
#include <cstring>

#include "renderer/cpu/blend-inl.h"
#include "renderer/cpu/vector-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatvol::tiles::HWY_NAMESPACE {

/// Properties that records have from their ranges; one record in each lane.
struct RangesInLanes {
  alignas(64) std::array<float, most_lanes> x, y, z, step, mass_scale, deviation_scale, value_deviation_scale;

  void set(int lane, const RangeInView& range) {
    x[lane] = range.x;
    y[lane] = range.y;
    z[lane] = range.z;
    step[lane] = range.step;
    mass_scale[lane] = range.mass_scale;
    deviation_scale[lane] = range.deviation_scale;
    value_deviation_scale[lane] = range.value_deviation_scale;
  }
};

HWY_INLINE Vector3 rotate_to_view(const FrameConstants& frame, Vector3 d) {
  const auto& r = frame.rotation;
  return {fma(d.x, r[0], fma(d.y, r[1], d.z * Float(r[2]))), fma(d.x, r[3], fma(d.y, r[4], d.z * Float(r[5]))),
          fma(d.x, r[6], fma(d.y, r[7], d.z * Float(r[8])))};
}

/// Returns a packed position in view coordinates.
HWY_INLINE Vector3 unpack_position(const FrameConstants& frame, Int low, Int high, const RangesInLanes& ranges) {
  const Int bias(1 << 20);
  const Vector3 offset{to_float(bits_of<0, 21>(low) - bias),
                       to_float((bits_of<21, 11>(low) | shift_left<11>(bits_of<0, 10>(high))) - bias),
                       to_float(bits_of<10, 21>(high) - bias)};
  return fma(rotate_to_view(frame, offset), load(ranges.step.data()),
             {load(ranges.x.data()), load(ranges.y.data()), load(ranges.z.data())});
}

/// Returns 2^((code - 65535) / 128), or 0 for 0 and for less than single precision holds.
HWY_INLINE Float log_number(Int code) {
  const Int octave = shift_right<7>(code);  // 0 to 511
  const Float f = to_float(code & Int(127)) * (1.0F / 128) - 0.4921875F;
  // 2^(f + 63/128 - 127/128): f lies in [-63/128, 1/2].
  Float p = fma(f, 0.00015453163F, 0.0013390863F);
  p = fma(f, p, 0.0096180826F);
  p = fma(f, p, 0.055503571F);
  p = fma(f, p, 0.24022651F);
  p = fma(f, p, 0.69314719F);
  p = fma(f, p, 1.0F) * 0.70710678F;
  const Int exponent = max(octave - Int(511 - 127), Int(0));
  return p * bits_as_float(shift_left<23>(exponent));
}

/// t of a stored value: axis_position of frame.glsl.
HWY_INLINE Float axis_position(const StoredAxis& axis, Float stored) {
  Float x = stored;
  if (axis.kind == 1) {
    x = x - axis.zero;
    const Mask positive = x > Float(0.0F);
    x = (natural_log(max(x, 1.2e-38F)) - axis.low) * axis.inverse_domain;
    return select(positive, x, -1.0F);
  }
  if (axis.kind == 2) {
    x = (x - axis.zero) * axis.unit;
    const Float size = abs(x);
    const Float sum = select(size > Float(1e4F), size + size, size + sqrt(fma(size, size, 1.0F)));
    // Near 0 the logarithm of 1 + size would lose its digits.
    const Float small = size * fnma(size * size, 1.0F / 6, 1.0F);
    const Float bent = select(size < Float(0.02F), small, natural_log(sum));
    x = hn::CopySign(bent.v, x.v);
  }
  return fma(x - axis.low, axis.inverse_domain, axis.start);
}

struct Moments {
  Float mean, deviation;
};

/// Mean and deviation of t of normally distributed stored values: axis_moments of frame.glsl.
HWY_INLINE Moments axis_moments(const StoredAxis& axis, Float mean, Float deviation) {
  const Float inverse_domain(axis.inverse_domain);
  if (axis.kind == 0) {
    const Float from_low = mean - axis.low;
    const Float factor = min(inverse_domain, Float(largest_t_deviation) / deviation);
    return {clamp(from_low * factor, -farthest_t, farthest_t) + axis.start, deviation * factor};
  }
  const Float t = axis_position(axis, mean);
  if (axis.kind == 1) {
    const Float x = mean - axis.zero;
    const Mask positive = x > Float(0.0F);
    const Float share = min(deviation / max(x, 1.2e-38F), 1e9F);
    const Float square = share * share;
    const Float variance = select(share < Float(0.01F), square, natural_log(square + 1.0F));
    return {select(positive, t - variance * inverse_domain * 0.5F, -1.0F),
            only(positive, sqrt(variance) * inverse_domain)};
  }
  const Float low = axis_position(axis, fnma(deviation, 1.73205081F, mean));
  const Float high = axis_position(axis, fma(deviation, 1.73205081F, mean));
  const Float average = (low + t * 4.0F + high) * (1.0F / 6);
  const Float a = low - average, b = t - average, c = high - average;
  return {average, sqrt(fma(a, a, fma(b * 4.0F, b, c * c)) * (1.0F / 6))};
}

/// The opacity values of splats; one in each lane.
struct OpacityInLanes {
  alignas(64) std::array<float, most_lanes> mean, deviation_scale;
  alignas(64) std::array<std::int32_t, most_lanes> codes;  // of the deviation, and the coverage above it

  void set(int lane, const RangeInView& range, std::uint32_t index) {
    if (!range.opacities) return;
    const OpacityValue& value = range.opacities[index];
    mean[lane] = value.mean;
    codes[lane] = value.deviation | value.coverage << 16;
    deviation_scale[lane] = range.opacity_deviation_scale;
  }
};

/// Returns the factors on the extinction. Requires a frame with an opacity.
HWY_INLINE Float opacity_factor(const FrameConstants& frame, const OpacityInLanes& values) {
  const OpacityView& opacity = frame.opacity;
  const Float mean = load(values.mean.data());
  const Int codes = load(values.codes.data());
  const Float deviation = log_number(bits_of<0, 16>(codes)) * load(values.deviation_scale.data());
  const Moments t = axis_moments(opacity.axis, mean, only(deviation > Float(0.0F), deviation));
  const TableRow row = table_row(opacity, t.deviation);
  const TableColumn at = column_at(opacity, fma(clamp(t.mean, -farthest_t, farthest_t) - 0.5F, row.columns,
                                                0.5F * static_cast<float>(opacity.columns - 1)));
  const Int index = row.row * Int(opacity.columns) + at.left;
  const Float left = gather(opacity.factors, index);
  const Float factor = fma(gather(opacity.factors + 1, index) - left, at.share, left);
  return only(is_finite(mean), clamp(factor, 0.0F, 1.0F) * to_float(bits_of<16, 8>(codes)) * (1.0F / 255));
}

/// Returns sqrt(a^2 + b^2). In double precision, squares of floats are exact and have room.
HWY_INLINE float hypotenuse(double a, double b) { return static_cast<float>(std::sqrt(a * a + b * b)); }

/// Returns where a ball round a point surely has no pixel. Side planes of the picture go through the eye; the raster
/// widens splats by less than 1.6 pixels.
HWY_INLINE Mask is_outside(const FrameConstants& frame, Vector3 center, Float radius) {
  const float half_width = 0.5F * frame.width + 1.6F, half_height = 0.5F * frame.height + 1.6F;
  if (frame.orthographic)
    return either(center.z + radius <= Float(0.0F),
                  either((abs(center.x) - radius) * frame.focal > Float(half_width),
                         (abs(center.y) - radius) * frame.focal > Float(half_height)));
  const float length_x = hypotenuse(frame.focal, half_width), length_y = hypotenuse(frame.focal, half_height);
  const Float beside_x = abs(center.x) * frame.focal - center.z * half_width;
  const Float beside_y = abs(center.y) * frame.focal - center.z * half_height;
  return either(center.z + radius <= Float(0.0F), either(beside_x > radius * length_x, beside_y > radius * length_y));
}

/// Returns the key of a splat: it falls with the distance.
HWY_INLINE Int key_of(Float distance) {
  const Int bits = bits_as_int(distance);
  return select_int(mask_of(hn::Lt(bits.v, hn::Zero(IntTag()))), bits, hn::Xor(bits.v, Int(0x7fffffff).v));
}

/// Where the records of a vector of splats are. Lanes beyond the last splat repeat it.
struct RecordPlaces {
  std::array<const RangeInView*, most_lanes> ranges;
  std::array<std::uint32_t, most_lanes> indices;

  /// Finds them, and asks for their cache lines: in drawing order, records are far apart in memory.
  void find(const SplatNumbers& splats, std::span<const std::uint32_t> numbers) {
    for (std::size_t lane = 0; lane < static_cast<std::size_t>(lane_count()); ++lane) {
      const std::uint32_t number = numbers[std::min(lane, numbers.size() - 1)];
      const RangeInView& range = splats.range_of(number);
      ranges[lane] = &range;
      indices[lane] = number - range.first;
      if (range.shapes) {
        hwy::Prefetch(&range.shapes[indices[lane]].position);
        hwy::Prefetch(&range.shapes[indices[lane]].boundary);
        hwy::Prefetch(&range.values[indices[lane]]);
      } else {
        hwy::Prefetch(&range.octants[indices[lane]]);
        hwy::Prefetch(&range.octant_values[indices[lane]]);
      }
      if (range.opacities) hwy::Prefetch(&range.opacities[indices[lane]]);
    }
  }
};

/// Sets records for vector after vector of splats, and calls visit(first, count) for each.
template <class Records, class Visit>
HWY_INLINE void for_each_group(const SplatNumbers& splats, std::span<const std::uint32_t> numbers, Records& records,
                               const Visit& visit) {
  const auto lanes = static_cast<std::size_t>(lane_count());
  if (numbers.empty()) return;
  RecordPlaces places, next;
  next.find(splats, numbers);
  for (std::size_t first = 0; first < numbers.size(); first += lanes) {
    places = next;
    if (first + lanes < numbers.size()) next.find(splats, numbers.subspan(first + lanes));
    for (std::size_t lane = 0; lane < lanes; ++lane)
      records.set(static_cast<int>(lane), *places.ranges[lane], places.indices[lane]);
    visit(first, std::min(lanes, numbers.size() - first));
  }
}

/// The same for splats with successive numbers, from `begin` on. `make` returns their keys.
template <class Records, class Make>
HWY_INLINE void make_keys(const SplatNumbers& splats, std::uint32_t begin, std::span<std::uint32_t> keys,
                          Records& records, const Make& make) {
  const auto lanes = static_cast<std::size_t>(lane_count());
  alignas(64) std::array<std::int32_t, most_lanes> group{};
  const RangeInView* range = keys.empty() ? nullptr : &splats.range_of(begin);
  for (std::size_t first = 0; first < keys.size(); first += lanes) {
    const std::size_t count = std::min(lanes, keys.size() - first);
    for (std::size_t lane = 0; lane < lanes; ++lane) {
      const std::uint32_t number = begin + static_cast<std::uint32_t>(first + std::min(lane, count - 1));
      while (number - range->first >= range->count) ++range;
      records.set(static_cast<int>(lane), *range, number - range->first);
    }
    store(make(), group.data());
    std::memcpy(&keys[first], group.data(), count * sizeof(std::uint32_t));
  }
}

}  // namespace splatvol::tiles::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
