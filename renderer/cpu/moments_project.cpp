// Projects splats of the kernel moments: a splat in each lane.
#include <cmath>
#include <cstddef>
#include <cstring>

#include "renderer/cpu/moments_kernel.h"
#include "splat/constants.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "renderer/cpu/moments_project.cpp"
#include "renderer/cpu/targets.h"
// The order matters: this includes the file again, once for each instruction set.
#include <hwy/foreach_target.h>

#include "renderer/cpu/projection-inl.h"
#include "renderer/cpu/vector-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatvol::tiles::HWY_NAMESPACE {
namespace {

using namespace drawing;

constexpr int shape_words = sizeof(MomentsShape) / 4, value_words = sizeof(MomentsValue) / 4;

/// The words of records, and what their ranges have in the view; one in each lane.
struct Records {
  alignas(64) std::array<std::array<std::int32_t, most_lanes>, shape_words + value_words> words;
  RangesInLanes ranges;
  OpacityInLanes opacities;

  void set_shape(int lane, const MomentsShape& shape) {
    std::array<std::int32_t, shape_words> copy;
    std::memcpy(copy.data(), &shape, sizeof(shape));
    for (int i = 0; i < shape_words; ++i) words[i][lane] = copy[i];
  }
  void set_value(int lane, const MomentsValue& value) {
    std::array<std::int32_t, value_words> copy;
    std::memcpy(copy.data(), &value, sizeof(value));
    for (int i = 0; i < value_words; ++i) words[shape_words + i][lane] = copy[i];
  }
  void set(int lane, const RangeInView& range, std::uint32_t index) {
    set_shape(lane, range.shapes[index]);
    set_value(lane, range.values[index]);
    ranges.set(lane, range);
    opacities.set(lane, range, index);
  }
  [[nodiscard]] HWY_INLINE Int word(int i) const { return load(words[i].data()); }
};

HWY_INLINE Vector3 position_in_view(const FrameConstants& frame, const Records& records) {
  return unpack_position(frame, records.word(0), records.word(1), records.ranges);
}

HWY_INLINE Vector3 boundary_foot(const Records& records) {
  const Int packed = records.word(6);
  return Vector3{to_float(signed_bits_of<0, 10>(packed)), to_float(signed_bits_of<10, 10>(packed)),
                 to_float(signed_bits_of<20, 10>(packed))} *
         Float(1.0F / 128);
}

/// The principal axes in view coordinates.
struct Axes {
  Vector3 first, second, third;
};

HWY_INLINE Axes principal_axes(const FrameConstants& frame, const Records& records) {
  const Int low = records.word(2), high = records.word(3);
  constexpr float largest = 0.70710678F, middle = 524287.0F;
  const Float scale(largest / middle);
  const Float a = fma(to_float(bits_of<2, 20>(low)), scale, -largest);
  const Float b = fma(to_float(bits_of<22, 10>(low) | shift_left<10>(bits_of<0, 10>(high))), scale, -largest);
  const Float c = fma(to_float(bits_of<10, 20>(high)), scale, -largest);
  const Float d = sqrt(max(Float(1.0F) - fma(a, a, fma(b, b, c * c)), 0.0F));
  const Int left_out = low & Int(3);
  const Mask is_0 = is_zero(left_out), is_1 = is_zero(left_out - Int(1)), is_2 = is_zero(left_out - Int(2)),
             is_3 = is_zero(left_out - Int(3));
  const Float qx = select(is_0, d, a);
  const Float qy = select(is_0, a, select(is_1, d, b));
  const Float qz = select(is_3, c, select(is_2, d, b));
  const Float qw = select(is_3, d, c);
  const Float two(2.0F), one(1.0F);
  const Vector3 x{one - two * fma(qy, qy, qz * qz), two * fma(qx, qy, qz * qw), two * fnma(qy, qw, qx * qz)};
  const Vector3 y{two * fnma(qz, qw, qx * qy), one - two * fma(qx, qx, qz * qz), two * fma(qy, qz, qx * qw)};
  const Vector3 e_1 = rotate_to_view(frame, x), e_2 = rotate_to_view(frame, y);
  return {e_1, e_2, rotate_to_view(frame, cross(x, y))};
}

/// The ellipsoid. Lengths are in pixels, of the size that they have in the middle of its visible part.
struct Body {
  Float pixel_size;       // drawing units
  Vector3 center;         // view coordinates
  Vector3 l_x, l_y, l_z;  // rows of L
  Vector3 u, v, w;        // columns of L^-1
  Float volume;           // determinant of L
  Float longest;          // bound on the half axes
  Mask near;              // the eye's plane cuts it or almost touches it
  Vector3 normal;         // of the boundary in the ball's coordinates, outwards; 0: no boundary
  Float stretch;          // along the normal the ball is sqrt(1 + stretch^2) times as long as without a boundary
};

/// The value in the ball's coordinates, in units of the domain.
struct Value {
  Float mean;  // at the centre
  Vector3 gradient;
  Float residual;  // variance that the linear field leaves
  Float slope;     // length of the gradient in view coordinates
  Float scatter;   // scatter_of
};

/// The outline on the screen: k = middle + e_1 s.x + e_2 s.y; tangents (perspective) or pixels (orthographic).
struct Outline {
  Vector2 middle, e_1, e_2;
  Vector2 anchor;       // k of a point of the ellipsoid
  Float anchor_z;       // its depth
  Vector3 from_center;  // its position in the ball
};

/// The rays as linear functions of s: d' = scale L^-1 d, n = o' x d' and o' . d'.
struct Rays {
  Float scale;
  Vector3 d_0, d_1, d_2;
  Vector3 n_0, n_1, n_2;
  Vector3 along;
  Float kappa;  // 1 - b^2 = (1 - s^2) kappa / |d'|^2, unless near
};

/// Sets the boundary. `foot`: of the perpendicular from the centroid, becomes that from the centre.
HWY_INLINE void set_boundary(Vector3 kept, Vector3& foot, Body& body) {
  const Vector3 across{foot.x / max(kept.x, 1e-3F), foot.y / max(kept.y, 1e-3F), foot.z / max(kept.z, 1e-3F)};
  const Float square = dot(across, across);
  const Mask bounded = square > Float(0.0F);
  const Float factor = only(bounded, dot(foot, foot) / square);
  foot = select(bounded, across * factor, Vector3{0.0F, 0.0F, 0.0F});
  body.stretch = length(foot);
  body.normal = foot * (Float(1.0F) / max(body.stretch, 1e-10F));
}

HWY_INLINE void stretch_row(Vector3 stretched, Vector3 normal, Vector3& row) {
  row = fma(stretched, dot(normal, row), row);
}

HWY_INLINE void set_axes(Vector3 axis_x, Vector3 axis_y, Vector3 axis_z, Vector3 half_axes, Float stretch, Body& body) {
  const Vector3 inverse{Float(1.0F) / half_axes.x, Float(1.0F) / half_axes.y, Float(1.0F) / half_axes.z};
  body.l_x = axis_x * half_axes;
  body.l_y = axis_y * half_axes;
  body.l_z = axis_z * half_axes;
  body.u = axis_x * inverse;
  body.v = axis_y * inverse;
  body.w = axis_z * inverse;
  const Vector3 stretched = body.normal * (stretch - 1.0F);
  stretch_row(stretched, body.normal, body.l_x);
  stretch_row(stretched, body.normal, body.l_y);
  stretch_row(stretched, body.normal, body.l_z);
  const Vector3 shrunk = body.normal * (Float(1.0F) / stretch - 1.0F);
  stretch_row(shrunk, body.normal, body.u);
  stretch_row(shrunk, body.normal, body.v);
  stretch_row(shrunk, body.normal, body.w);
  body.volume = half_axes.x * half_axes.y * half_axes.z * stretch;
  body.longest = max(max(half_axes.x, half_axes.y), half_axes.z) * stretch;
}

HWY_INLINE Vector3 correlations_of(const Records& records) {
  const Int second = records.word(8), third = records.word(9);
  return Vector3{to_float(signed_bits_of<24, 8>(second)), to_float(signed_bits_of<0, 8>(third)),
                 to_float(signed_bits_of<8, 8>(third))} *
         Float(1.0F / 127);
}

/// Sets mean, gradient and residual of a value round the centroid; the gradient without the boundary's stretch.
HWY_INLINE Value value_of(const FrameConstants& frame, const Records& records, Vector3 kept, Vector3 widened) {
  const Vector3 correlations = correlations_of(records);
  const Float deviation =
      log_number(bits_of<0, 16>(records.word(8))) * load(records.ranges.value_deviation_scale.data());
  const Moments t = axis_moments(frame.axis, bits_as_float(records.word(7)), only(deviation > Float(0.0F), deviation));
  const Vector3 squares = correlations * correlations;
  const Float rest = max(Float(1.0F) - (squares.x + squares.y + squares.z), 0.0F);
  const Float smoothed = fma(squares.x, fnma(kept.x, kept.x, 1.0F),
                             fma(squares.y, fnma(kept.y, kept.y, 1.0F), squares.z * fnma(kept.z, kept.z, 1.0F)));
  Value value;
  value.mean = t.mean;
  value.gradient = correlations * kept * (t.deviation * half_axis);
  value.residual = t.deviation * t.deviation * (rest + smoothed);
  const Vector3 by_length{value.gradient.x / widened.x, value.gradient.y / widened.y, value.gradient.z / widened.z};
  value.slope = length(by_length) * (1.0F / half_axis);
  value.scatter = only(t.deviation > Float(0.0F), scatter_of(rest, Float(1.0F) - rest));
  return value;
}

HWY_INLINE Vector3 deviations_of(const Records& records) {
  const Int first = records.word(4), second = records.word(5);
  const Float scale = load(records.ranges.deviation_scale.data());
  const auto number = [&](Int code) HWY_ATTR {
    return only(mask_of(hn::Gt(code.v, hn::Zero(IntTag()))), log_number(code) * scale);
  };
  return {number(bits_of<16, 16>(first)), number(bits_of<0, 16>(second)), number(bits_of<16, 16>(second))};
}

/// Makes the ellipsoid and its values. Returns where a part of it is in front of the eye.
HWY_INLINE Mask make_body(const FrameConstants& frame, const Records& records, Vector3 center, Body& body,
                          Value& value) {
  const Axes axes = principal_axes(frame, records);
  const Vector3 axis_x{axes.first.x, axes.second.x, axes.third.x};
  const Vector3 axis_y{axes.first.y, axes.second.y, axes.third.y};
  const Vector3 axis_z{axes.first.z, axes.second.z, axes.third.z};
  Vector3 deviations = deviations_of(records);
  Vector3 foot = boundary_foot(records);
  const Float bound_z = length(axis_z * deviations) * half_axis * fma(length(foot), 1.1F, 1.0F);
  const Mask in_front = center.z + bound_z > Float(0.0F);
  const Float middle_z = frame.orthographic ? Float(1.0F) : max(center.z, (center.z + bound_z) * 0.5F);
  body.pixel_size = max(middle_z * (1.0F / frame.focal), smallest_pixel);
  const Float pixels = Float(1.0F) / body.pixel_size;
  deviations = deviations * pixels;
  const Vector3 widened{sqrt(fma(deviations.x, deviations.x, low_pass)),
                        sqrt(fma(deviations.y, deviations.y, low_pass)),
                        sqrt(fma(deviations.z, deviations.z, low_pass))};
  const Vector3 kept{deviations.x / widened.x, deviations.y / widened.y, deviations.z / widened.z};
  value = value_of(frame, records, kept, widened);

  set_boundary(kept, foot, body);
  const Float stretch = sqrt(fma(body.stretch, body.stretch, 1.0F));
  const Vector3 shift = widened * foot;
  body.center = center * pixels + axes.first * shift.x + axes.second * shift.y + axes.third * shift.z;
  value.mean = fma(dot(value.gradient, foot), 1.0F / half_axis, value.mean);
  value.gradient = fma(body.normal, (stretch - 1.0F) * dot(body.normal, value.gradient), value.gradient);

  set_axes(axis_x, axis_y, axis_z, widened * Float(half_axis), stretch, body);
  const Float reach_z = length(body.l_z);
  body.near = body.center.z < reach_z * nearest_distance;
  return both(in_front, body.center.z + reach_z > Float(0.0F));
}

/// Returns the largest extinction of the values in [low, high], which are in units of the domain.
HWY_INLINE Float peak_extinction(const FrameConstants& frame, Float low, Float high) {
  const auto entry = [](Float t) HWY_ATTR {
    const Int i = truncate(clamp(t, 0.0F, 1.0F) * static_cast<float>(peak_entries));
    return max(min(i, Int(peak_entries - 1)), Int(0));
  };
  const Int first = entry(low), end = entry(high);
  // The number of bits of end - first: two entries of this level hold the whole range.
  const Int level = max(shift_right<23>(bits_as_int(to_float(end - first))) - Int(126), Int(0));
  const Int offset = Int(2 * peak_entries) - Int(hn::Shr(hn::Set(IntTag(), 2 * peak_entries), level.v));
  return max(gather(frame.peaks, offset + Int(hn::Shr(first.v, level.v))),
             gather(frame.peaks, offset + Int(hn::Shr(end.v, level.v))));
}

/// Returns the two k for which x = k z touches the ellipsoid's part in front of the eye; -1e30 or 1e30 for a side
/// without such a tangent. x, l_x and z, l_z: the centre's coordinates and rows of L.
HWY_INLINE Vector2 tangents(Float x, Vector3 l_x, Float z, Vector3 l_z) {
  // Roots of a k^2 - 2 b k + c.
  const Float square_z = dot(l_z, l_z), mixed = dot(l_x, l_z);
  const Float a = fma(z, z, -square_z);
  const Float b = fma(x, z, -mixed);
  const Float c = fma(x, x, -dot(l_x, l_x));
  const Float discriminant = fma(b, b, -(a * c));
  const Float root = sqrt(max(discriminant, 0.0F));
  const Float sum = select(b < Float(0.0F), b - root, b + root);
  const Float k_1 = sum / a, k_2 = c / sum;
  Vector2 k{min(k_1, k_2), max(k_1, k_2)};
  // The eye's plane cuts it: there is no tangent in front on the side of the section.
  const Mask to_right = x * square_z > mixed * z;
  const Vector2 open{select(to_right, k.y, -1e30F), select(to_right, Float(1e30F), k.x)};
  k = select(a > Float(0.0F), k, open);
  // Without roots the eye is inside the projection along the other axis.
  return select(discriminant > Float(0.0F), k, Vector2{-1e30F, 1e30F});
}

/// Makes an outline of the bounding box, cut off at the picture's edges.
HWY_INLINE Outline make_box(const FrameConstants& frame, const Body& body, Vector2 half_image) {
  Outline outline;
  Vector2 x, y;
  if (frame.orthographic) {
    const Float reach_x = length(body.l_x), reach_y = length(body.l_y);
    x = {body.center.x - reach_x, body.center.x + reach_x};
    y = {body.center.y - reach_y, body.center.y + reach_y};
    outline.anchor = {body.center.x, body.center.y};
    outline.anchor_z = body.center.z;
    outline.from_center = {0.0F, 0.0F, 0.0F};
  } else {
    x = tangents(body.center.x, body.l_x, body.center.z, body.l_z);
    y = tangents(body.center.y, body.l_y, body.center.z, body.l_z);
    const Float reach_z = length(body.l_z);
    outline.from_center = body.l_z * (Float(1.0F) / reach_z);
    outline.anchor_z = body.center.z + reach_z;
    outline.anchor = {(body.center.x + dot(body.l_x, body.l_z) / reach_z) / outline.anchor_z,
                      (body.center.y + dot(body.l_y, body.l_z) / reach_z) / outline.anchor_z};
  }
  const Vector2 low{max(x.x, -half_image.x), max(y.x, -half_image.y)};
  const Vector2 high{min(x.y, half_image.x), min(y.y, half_image.y)};
  outline.middle = (low + high) * 0.5F;
  outline.e_1 = {(high.x - low.x) * 0.5F, 0.0F};
  outline.e_2 = {0.0F, (high.y - low.y) * 0.5F};
  return outline;
}

HWY_INLINE Outline make_ellipse(const FrameConstants& frame, const Body& body) {
  Outline outline;
  outline.anchor_z = body.center.z;
  outline.from_center = {0.0F, 0.0F, 0.0F};
  outline.anchor = {body.center.x, body.center.y};
  Vector3 x = body.l_x, y = body.l_y;
  Vector2 q{0.0F, 0.0F};
  Float a(1.0F);
  if (!frame.orthographic) {
    outline.anchor = outline.anchor * (Float(1.0F) / body.center.z);
    x = fma(body.l_z, -outline.anchor.x, x);
    y = fma(body.l_z, -outline.anchor.y, y);
    q = {dot(x, body.l_z), dot(y, body.l_z)};
    const Float reach_z = length(body.l_z);
    a = (body.center.z - reach_z) * (body.center.z + reach_z);
  }
  const Float inverse_a = Float(1.0F) / a;
  const Vector3 minors = cross(x, y);
  const Vector3 skew = y * q.x - x * q.y;
  const Float xx = fma(q.x * q.x, inverse_a, dot(x, x));
  const Float xy = fma(q.x * q.y, inverse_a, dot(x, y));
  const Float determinant = fma(dot(skew, skew), inverse_a, dot(minors, minors));
  const Float root = inverse_sqrt(xx * a);
  outline.e_1 = {xx * root, xy * root};
  outline.e_2 = {0.0F, sqrt(determinant) * root};
  outline.middle = outline.anchor - q * inverse_a;
  return outline;
}

HWY_INLINE Outline select(Mask mask, const Outline& yes, const Outline& no) {
  return {select(mask, yes.middle, no.middle),     select(mask, yes.e_1, no.e_1),
          select(mask, yes.e_2, no.e_2),           select(mask, yes.anchor, no.anchor),
          select(mask, yes.anchor_z, no.anchor_z), select(mask, yes.from_center, no.from_center)};
}

/// Makes the outline: an ellipse, or a bounding box if the eye's plane cuts the ellipsoid or the ellipse is too large.
/// Returns where it lies in the picture.
HWY_INLINE Mask make_outline(const FrameConstants& frame, Vector2 half_image, Body& body, Outline& outline) {
  outline = make_ellipse(frame, body);
  Vector2 reach{outline.e_1.x, abs(outline.e_1.y) + outline.e_2.y};
  constexpr float limit = 2.0F * largest_outline;
  body.near =
      either(body.near,
             hn::Not(both(hn::Le(reach.x.v, (half_image.x * limit).v), hn::Le(reach.y.v, (half_image.y * limit).v))));
  if (any(body.near)) {
    outline = select(body.near, make_box(frame, body, half_image), outline);
    reach = select(body.near, Vector2{outline.e_1.x, outline.e_2.y}, reach);  // not positive if the box is empty
  }
  const Vector2 low = outline.middle - reach, high = outline.middle + reach;
  const Mask inside =
      both(both(low.x < half_image.x, low.y < half_image.y), both(high.x > -half_image.x, high.y > -half_image.y));
  return both(inside, both(reach.x > Float(0.0F), reach.y > Float(0.0F)));
}

/// Computes the rays relative to the anchor, from which they differ little: this way o' x (direction) does not cancel.
HWY_INLINE Rays make_rays(const FrameConstants& frame, const Body& body, const Outline& outline) {
  Rays rays;
  const Vector2 shift = outline.middle - outline.anchor;
  Vector3 to_shift = fma(body.u, shift.x, body.v * shift.y);
  const Vector3 to_1 = fma(body.u, outline.e_1.x, body.v * outline.e_1.y);
  const Vector3 to_2 = fma(body.u, outline.e_2.x, body.v * outline.e_2.y);
  if (frame.orthographic) {
    const Vector3 zero{0.0F, 0.0F, 0.0F};
    rays = {1.0F, body.w, zero, zero, cross(to_shift, body.w), cross(to_1, body.w), cross(to_2, body.w), zero, 1.0F};
    rays.along = {dot(fma(body.w, -body.center.z, to_shift), body.w), dot(to_1, body.w), dot(to_2, body.w)};
    rays.kappa = dot(body.w, body.w);
    return rays;
  }
  const Vector3 o = fma(body.u, -body.center.x, fma(body.v, -body.center.y, body.w * -body.center.z));
  rays.scale = outline.anchor_z;
  to_shift = to_shift * rays.scale;
  rays.d_0 = outline.from_center - o + to_shift;
  rays.d_1 = to_1 * rays.scale;
  rays.d_2 = to_2 * rays.scale;
  rays.n_0 = cross(o, outline.from_center + to_shift);
  rays.n_1 = cross(o, rays.d_1);
  rays.n_2 = cross(o, rays.d_2);
  rays.along = {dot(o, rays.d_0), dot(o, rays.d_1), dot(o, rays.d_2)};
  const Float aside = Float(1.0F) - dot(o, to_shift);
  rays.kappa = fma(dot(o, o) - 1.0F, Float(1.0F) - dot(to_shift, to_shift), aside * aside);
  return rays;
}

/// A polynomial of s: the coefficients of 1; of x and y; of x^2, x y and y^2.
struct Polynomial {
  Float constant;
  Vector2 slope;
  Vector3 bend;
};

HWY_INLINE Polynomial scaled(const Polynomial& p, Float factor) {
  return {p.constant * factor, p.slope * factor, p.bend * factor};
}

/// Returns the second-order coefficients of the product of two linear forms without constants.
HWY_INLINE Vector3 product(Vector2 a, Vector2 b) { return {a.x * b.x, fma(a.x, b.y, a.y * b.x), a.y * b.y}; }

/// Returns the product up to the second order.
HWY_INLINE Polynomial product(const Polynomial& a, const Polynomial& b) {
  return {a.constant * b.constant, b.slope * a.constant + a.slope * b.constant,
          b.bend * a.constant + a.bend * b.constant + product(a.slope, b.slope)};
}

/// Returns (1 + p)^exponent up to the second order, for p without a constant.
HWY_INLINE Polynomial power(const Polynomial& p, float exponent) {
  return {1.0F, p.slope * Float(exponent),
          p.bend * Float(exponent) + product(p.slope, p.slope) * Float(0.5F * exponent * (exponent - 1.0F))};
}

/// Returns axis . (d' x n) = n . (axis x d').
HWY_INLINE Polynomial chord_middle(Vector3 axis, const Rays& rays) {
  const Vector3 a_0 = cross(axis, rays.d_0), a_1 = cross(axis, rays.d_1), a_2 = cross(axis, rays.d_2);
  return {dot(rays.n_0, a_0),
          {dot(rays.n_0, a_1) + dot(rays.n_1, a_0), dot(rays.n_0, a_2) + dot(rays.n_2, a_0)},
          {dot(rays.n_1, a_1), dot(rays.n_1, a_2) + dot(rays.n_2, a_1), dot(rays.n_2, a_2)}};
}

/// Returns about the largest change within the outline.
HWY_INLINE Float size_of(const Polynomial& change) { return length(change.slope) + change.bend.x + change.bend.z; }

/// The terms of the far form. With g = |d'|^2 / kappa, 1 - b^2 = (1 - s^2) / g.
struct Terms {
  Float g, ray;                     // g and |d| in the middle
  Polynomial g_change, ray_change;  // relative change of g and |d|^2 from the middle
  Float depth;                      // optical depth at an extinction, |d|, g and 1 - s^2 of 1
};

HWY_INLINE Terms make_terms(const FrameConstants& frame, const Outline& outline, const Rays& rays, Float strength) {
  Terms terms;
  const Float square = dot(rays.d_0, rays.d_0), inverse = Float(1.0F) / square;
  terms.g = square / rays.kappa;
  terms.g_change = scaled({0.0F,
                           {dot(rays.d_0, rays.d_1) * 2.0F, dot(rays.d_0, rays.d_2) * 2.0F},
                           {dot(rays.d_1, rays.d_1), dot(rays.d_1, rays.d_2) * 2.0F, dot(rays.d_2, rays.d_2)}},
                          inverse);
  terms.ray = 1.0F;
  terms.ray_change = {0.0F, {0.0F, 0.0F}, {0.0F, 0.0F, 0.0F}};
  if (!frame.orthographic) {
    const Vector2 m = outline.middle, e_1 = outline.e_1, e_2 = outline.e_2;
    const Float ray_square = dot(m, m) + 1.0F;
    terms.ray = sqrt(ray_square);
    terms.ray_change =
        scaled({0.0F, {dot(m, e_1) * 2.0F, dot(m, e_2) * 2.0F}, {dot(e_1, e_1), dot(e_1, e_2) * 2.0F, dot(e_2, e_2)}},
               Float(1.0F) / ray_square);
  }
  terms.depth = strength * inverse_sqrt(rays.kappa);
  return terms;
}

/// From s to (t, v) of EllipseOutline: s.x = x_t t + x_v v, s.y = y_t t + y_v v.
struct ToPixels {
  Float x_t, x_v, y_t, y_v;
};

HWY_INLINE Polynomial in_pixels(const Polynomial& p, const ToPixels& m) {
  const Vector3 b = p.bend;
  return {p.constant,
          {fma(p.slope.x, m.x_t, p.slope.y * m.y_t), fma(p.slope.x, m.x_v, p.slope.y * m.y_v)},
          {fma(b.x * m.x_t, m.x_t, fma(b.y * m.x_t, m.y_t, b.z * m.y_t * m.y_t)),
           fma(b.x * m.x_t * 2.0F, m.x_v, fma(b.y, fma(m.x_t, m.y_v, m.x_v * m.y_t), b.z * m.y_t * m.y_v * 2.0F)),
           fma(b.x * m.x_v, m.x_v, fma(b.y * m.x_v, m.y_v, b.z * m.y_v * m.y_v))}};
}

/// Fields of the splats on the screen, one splat in each lane.
template <int count>
struct Fields {
  alignas(64) std::array<std::array<float, most_lanes>, count> numbers;
  int used = 0;

  HWY_INLINE void add(Float a) { store(a, numbers[used++].data()); }
  HWY_INLINE void add(Vector3 a) {
    add(a.x);
    add(a.y);
    add(a.z);
  }
  HWY_INLINE void add(const Polynomial& p) {
    add(p.constant);
    add(p.slope.x);
    add(p.slope.y);
    add(p.bend);
  }
  void copy(int lane, void* to) const {
    std::array<float, count> line;
    for (int i = 0; i < count; ++i) line[i] = numbers[i][lane];
    std::memcpy(to, line.data(), sizeof(line));
  }
};
using FarFields = Fields<(offsetof(FarSplat, column_reach) + sizeof(float)) / 4>;
using NearFields = Fields<sizeof(NearSplat) / 4>;

/// A splat between outline and fields.
struct Screen {
  Float x, y;        // centre, pixels
  Vector2 e_1, e_2;  // of the outline, pixels
  Float reach;
  Float height2;  // of the half height, squared
  ToPixels to_pixels;
};

HWY_INLINE Screen make_screen(const Outline& outline, Vector2 half_image, float focal) {
  Screen screen;
  screen.x = (outline.middle.x + half_image.x) * focal;
  screen.y = (outline.middle.y + half_image.y) * focal;
  screen.e_1 = outline.e_1 * focal;
  screen.e_2 = outline.e_2 * focal;
  screen.height2 = fma(screen.e_1.y, screen.e_1.y, screen.e_2.y * screen.e_2.y);
  const Float inverse_height2 = Float(1.0F) / screen.height2;
  const Float by_width = Float(1.0F) / screen.e_1.x;
  screen.to_pixels = {by_width, screen.e_1.y * inverse_height2, -(screen.e_1.y * by_width) / screen.e_2.y,
                      screen.e_2.y * inverse_height2};
  screen.reach = 1.0F;
  return screen;
}

template <int count>
HWY_INLINE void add_outline(const Screen& screen, Mask near, Fields<count>& fields) {
  const Float by_width = screen.to_pixels.x_t, by_height = Float(1.0F) / screen.e_2.y;
  const Float inverse_height2 = Float(1.0F) / screen.height2, by_area = by_width * by_height;
  fields.add(screen.x);
  fields.add(screen.y);
  fields.add(select(near, -1.0F, screen.reach));
  fields.add(screen.e_1.x * screen.e_1.y * inverse_height2);
  fields.add(select(near, 0.0F, screen.height2 * by_area * by_area));
  fields.add(select(near, 0.0F, inverse_height2));
  fields.add(by_width);
  fields.add(by_height);
  fields.add(screen.e_1.y);
}

/// Properties at the middle of an outline. They serve all of an ellipse.
struct Middle {
  Float along;  // gradient . d'
  Float spread, light;
};

HWY_INLINE Middle make_middle(const FrameConstants& frame, const Body& body, const Value& value, const Rays& rays,
                              const Terms& terms) {
  const Float square = dot(rays.d_0, rays.d_0), along = dot(value.gradient, rays.d_0);
  const Float stretched = body.stretch * dot(body.normal, rays.d_0);
  const Float spread =
      sqrt(fma(along, along / (fma(stretched, stretched, square) * (half_axis * half_axis)), value.residual));
  if (frame.diffuse == 0) return {along, spread, Float(frame.ambient)};
  const Float cosine =
      select(value.slope > Float(0.0F), min(abs(along) / (rays.scale * terms.ray * value.slope), 1.0F), 1.0F);
  return {along, spread, fma(mean_cosine(cosine, value.scatter), frame.diffuse, frame.ambient)};
}

/// Returns the most columns between the middle of an outline and any of its pixels. `end`: from the middle to the end
/// of a chord there.
HWY_INLINE Float reach_of(const Polynomial& column, Float end, const Screen& screen) {
  const Float width2 = screen.e_1.x * screen.e_1.x * screen.e_2.y * screen.e_2.y / screen.height2;
  const Float height2 = screen.height2;
  const Float linear = sqrt(fma(column.slope.x * column.slope.x, width2, column.slope.y * column.slope.y * height2));
  const Float bent = fma(abs(column.bend.x), width2, abs(column.bend.z) * height2);
  return linear + bent + fma(abs(column.bend.y) * 0.5F, sqrt(width2 * height2), abs(end));
}

/// Sets the far form: moments_project.glsl explains it.
HWY_INLINE void set_far_fields(const FrameConstants& frame, const Body& body, const Value& value, const Rays& rays,
                               const Terms& terms, const Middle& middle, const Screen& screen, FarFields& fields) {
  add_outline(screen, body.near, fields);
  const Float inverse_g = Float(1.0F) / terms.g;
  const TableRow row = table_row(frame.table, middle.spread);
  const Float center_column = fma(value.mean - 0.5F, row.columns, 0.5F * static_cast<float>(frame.table.columns - 1));
  const Polynomial shift = scaled(chord_middle(value.gradient, rays), row.columns / rays.kappa);
  Polynomial column = scaled(product(power(terms.g_change, -1.0F), shift), inverse_g);
  column.constant = column.constant + center_column;
  const Float root_g = sqrt(inverse_g);
  const Polynomial depth = scaled(product(power(terms.g_change, -2.5F), power(terms.ray_change, 0.5F)),
                                  terms.depth * terms.ray * inverse_g * inverse_g * root_g);
  fields.add(in_pixels(depth, screen.to_pixels));
  const Polynomial column_in_pixels = in_pixels(column, screen.to_pixels);
  fields.add(column_in_pixels);
  fields.add(middle.light);

  // The boundary.
  const Float root_kappa = inverse_sqrt(rays.kappa);
  const Mask bounded = body.stretch > Float(0.0F);
  const Polynomial cutting = scaled(chord_middle(body.normal, rays), -root_kappa);
  const Vector3 towards{dot(body.normal, rays.d_0), dot(body.normal, rays.d_1), dot(body.normal, rays.d_2)};
  const Float by_pixel_y = cutting.slope.y / screen.e_2.y;
  const Vector2 by_pixel{(cutting.slope.x - by_pixel_y * screen.e_1.y) / screen.e_1.x, by_pixel_y};
  const Float size = max(max(abs(towards.x), length(by_pixel) * 0.5F), 1e-6F);
  const Float turn = cutting.constant * towards.x / (size * size);
  const Float inverse_size = Float(1.0F) / size;
  const Vector2 slope{(cutting.slope.x - turn * towards.y) * inverse_size,
                      (cutting.slope.y - turn * towards.z) * inverse_size};
  const ToPixels& m = screen.to_pixels;
  const Float end = middle.along * row.columns * root_kappa * inverse_g;
  const Float signed_end = only(bounded, select(towards.x < Float(0.0F), -end, end));
  fields.add(signed_end);
  fields.add(select(bounded, cutting.constant * inverse_size, 1e18F));
  fields.add(only(bounded, fma(slope.x, m.x_t, slope.y * m.y_t)));
  fields.add(only(bounded, fma(slope.x, m.x_v, slope.y * m.y_v)));
  fields.add(bits_as_float(row.row));
  fields.add(reach_of(column_in_pixels, signed_end, screen));
}

HWY_INLINE void add_linear(Vector3 constant, Vector3 by_x, Vector3 by_y, const ToPixels& m, NearFields& fields) {
  fields.add(constant);
  fields.add(fma(by_x, m.x_t, by_y * m.y_t));
  fields.add(fma(by_x, m.x_v, by_y * m.y_v));
}

HWY_INLINE void set_near_fields(const Body& body, const Value& value, const Rays& rays, const Middle& middle,
                                Float strength, const Screen& screen, NearFields& fields) {
  add_outline(screen, body.near, fields);
  const ToPixels& m = screen.to_pixels;
  add_linear(rays.d_0, rays.d_1, rays.d_2, m, fields);
  fields.add(rays.along.x);
  fields.add(fma(rays.along.y, m.x_t, rays.along.z * m.y_t));
  fields.add(fma(rays.along.y, m.x_v, rays.along.z * m.y_v));
  add_linear(rays.n_0, rays.n_1, rays.n_2, m, fields);
  fields.add(strength);
  fields.add(value.mean);
  fields.add(value.residual);
  fields.add(value.gradient);
  fields.add(only(value.slope > Float(0.0F), Float(1.0F) / (rays.scale * value.slope)));
  fields.add(body.normal);
  fields.add(body.stretch);
  fields.add(select(body.near, -1.0F, middle.spread));
  fields.add(select(body.near, -1.0F, middle.light));
  fields.add(Float(1.0F) / (rays.scale * body.pixel_size));
}

/// Returns where single precision holds all of the splat: else it is so large or so near that it overflows.
HWY_INLINE Mask is_finite(const Body& body, const Value& value, const Rays& rays, Float strength) {
  const auto sum = [](Vector3 a) HWY_ATTR { return abs(a.x) + abs(a.y) + abs(a.z); };
  const Float all = sum(rays.d_0) + sum(rays.d_1) + sum(rays.d_2) + sum(rays.n_0) + sum(rays.n_1) + sum(rays.n_2) +
                    sum(rays.along) + sum(value.gradient) + sum(body.normal) + abs(strength) + abs(value.mean) +
                    abs(value.residual) + abs(body.stretch);
  return is_finite(all);
}

/// Cuts the faint rim. The rest takes over its light: the gain's divisor is the share of the integral of (1 - s^2)^2
/// that lies in the remaining square. Returns where something is left. `peak`: the largest extinction in the splat.
HWY_INLINE Mask cut_rim(const Body& body, const Rays& rays, Float peak, Float& strength, Terms& terms, Screen& screen) {
  const Float least_g = terms.g * max(Float(1.0F) - size_of(terms.g_change), 0.1F);
  const Float inverse = Float(1.0F) / least_g;
  const Float deepest =
      min(strength / rays.scale * body.longest, terms.depth * terms.ray * inverse * inverse * sqrt(inverse));
  const Float brightest = peak * deepest;
  const Float cut = min(sqrt(Float(faintest_depth) / brightest), widest_cut);
  screen.reach = sqrt(Float(1.0F) - cut);
  const Float lost = cut * cut * cut * sqrt(cut) * fma(cut, fma(cut, lost_2, lost_1), lost_0);
  const Float gain = Float(1.0F) / (Float(1.0F) - lost);
  terms.depth = terms.depth * gain;
  strength = strength * gain;
  return brightest > Float(least_depth);
}

/// The pixels whose centres lie in the outline's bounding box, as numbers.
struct Bounds {
  alignas(64) std::array<std::int32_t, most_lanes> left, bottom, right, top;
};

HWY_INLINE void set_bounds(const FrameConstants& frame, const Screen& screen, Mask near, Bounds& bounds) {
  const Float reach_x = screen.e_1.x * screen.reach;
  const Float half_height = sqrt(fma(screen.e_1.y, screen.e_1.y, screen.e_2.y * screen.e_2.y));
  const Float reach_y = select(near, screen.e_2.y, min(half_height, (abs(screen.e_1.y) + screen.e_2.y) * screen.reach));
  const auto pixel = [](Float at, float end)
                         HWY_ATTR { return max(truncate(hn::Ceil(clamp(at - 0.5F, 0.0F, end).v)), Int(0)); };
  store(pixel(screen.x - reach_x, frame.width), bounds.left.data());
  store(pixel(screen.x + reach_x, frame.width), bounds.right.data());
  store(pixel(screen.y - reach_y, frame.height), bounds.bottom.data());
  store(pixel(screen.y + reach_y, frame.height), bounds.top.data());
}

struct Projection {
  Bounds bounds;
  FarFields far;
  NearFields near;
  alignas(64) std::array<std::int32_t, most_lanes> forms;  // as Form
};

/// Returns the masses, and where they and the values are sound.
HWY_INLINE Mask masses_of(const Records& records, Float& mass) {
  const Int code = bits_of<0, 16>(records.word(4));
  mass = log_number(code) * load(records.ranges.mass_scale.data()) * to_float(bits_of<16, 8>(records.word(8)));
  const Mask positive = both(mass > Float(0.0F), mask_of(hn::Gt(code.v, hn::Zero(IntTag()))));
  return both(both(positive, is_finite(mass)), is_finite(bits_as_float(records.word(7))));
}

/// Depths between which a splat lies, in drawing units.
struct DepthExtent {
  Float reach, front, back;
};

HWY_INLINE DepthExtent depth_extent(const Body& body) {
  const Float reach = length(body.l_z) * body.pixel_size, middle = body.center.z * body.pixel_size;
  return {reach, middle - reach, middle + reach};
}

/// Where surfaces hide all of a splat, and where they may hide a part.
struct Hidden {
  Mask all, part;
};

HWY_INLINE Hidden hidden_by(const DepthPyramid& surfaces, const DepthExtent& extent, const Bounds& bounds) {
  alignas(64) std::array<float, most_lanes> nearest, farthest;
  for (int lane = 0; lane < lane_count(); ++lane) {
    const DepthRange range =
        surfaces.range(bounds.left[lane], bounds.bottom[lane], bounds.right[lane], bounds.top[lane]);
    nearest[lane] = range.nearest;
    farthest[lane] = range.farthest;
  }
  const Mask all = extent.front >= load(farthest.data());
  return {all, hn::AndNot(all, extent.back > load(nearest.data()))};
}

/// Projects a splat in each lane.
void project(const FrameConstants& frame, const Records& records, Projection& result) {
  Float mass;
  Mask drawn = masses_of(records, mass);
  if (frame.opacity.factors) {
    mass = mass * opacity_factor(frame, records.opacities);
    drawn = both(drawn, mass > Float(0.0F));
  }
  const Vector3 center = position_in_view(frame, records);
  drawn = both(drawn, is_finite(center.x + center.y + center.z));

  Body body;
  Value value;
  drawn = both(drawn, make_body(frame, records, center, body, value));
  const Float extent = fma(sqrt(value.residual), 4.0F, length(value.gradient));
  const Float peak = peak_extinction(frame, value.mean - extent, value.mean + extent);
  drawn = both(drawn, peak > Float(0.0F));

  const float focal = frame.orthographic ? 1.0F : frame.focal;
  const Vector2 half_image{0.5F * frame.width / focal, 0.5F * frame.height / focal};
  Outline outline;
  drawn = both(drawn, make_outline(frame, half_image, body, outline));
  if (!any(drawn)) {
    result.forms = {};
    return;
  }

  const Rays rays = make_rays(frame, body, outline);
  const Float share = select(body.stretch > Float(0.0F), 6.0F / pi, Float(3.0F / pi));
  Float strength = mass / (body.pixel_size * body.pixel_size) * share / body.volume * rays.scale;
  strength = min(strength, 1e18F);
  drawn = both(drawn, is_finite(body, value, rays, strength));

  Screen screen = make_screen(outline, half_image, focal);
  Terms terms = make_terms(frame, outline, rays, strength);
  Float cut_strength = strength;
  const Mask bright = cut_rim(body, rays, peak, cut_strength, terms, screen);
  const Mask bright_near = peak * strength / rays.scale * body.longest > Float(least_depth);
  drawn = both(drawn, either(both(body.near, bright_near), hn::AndNot(body.near, bright)));
  screen.reach = select(body.near, 1.0F, screen.reach);
  strength = select(body.near, strength, cut_strength);

  const Mask changing = max(size_of(terms.g_change), size_of(terms.ray_change)) > Float(most_change);
  set_bounds(frame, screen, body.near, result.bounds);
  Mask partial = Float(0.0F) > Float(0.0F);
  if (frame.surfaces) {
    const Hidden hidden = hidden_by(*frame.surfaces, depth_extent(body), result.bounds);
    drawn = hn::AndNot(hidden.all, drawn);
    partial = both(drawn, hidden.part);
  }
  const Mask near = both(drawn, either(partial, either(body.near, changing)));
  const Mask far = hn::AndNot(near, drawn);
  const Int near_form = select_int(partial, static_cast<int>(Form::partial), static_cast<int>(Form::near));
  store(select_int(near, near_form, select_int(far, static_cast<int>(Form::far), 0)), result.forms.data());
  const Middle middle = make_middle(frame, body, value, rays, terms);
  result.far.used = result.near.used = 0;
  if (any(far)) set_far_fields(frame, body, value, rays, terms, middle, screen, result.far);
  if (any(near)) set_near_fields(body, value, rays, middle, strength, screen, result.near);
}

void write_splat(const Projection& projection, int lane, const ScreenSplats& screen, std::size_t slot) {
  const auto form = static_cast<Form>(projection.forms[lane]);
  const auto edge = [lane](const auto& edges) { return static_cast<std::uint16_t>(edges[lane]); };
  const Bounds& bounds = projection.bounds;
  PixelBounds pixels{edge(bounds.left), edge(bounds.bottom), edge(bounds.right), edge(bounds.top)};
  if (form == Form::none || pixels.left >= pixels.right || pixels.bottom >= pixels.top) pixels = {};
  screen.bounds[slot] = pixels;
  screen.forms[slot] = pixels.left == pixels.right ? Form::none : form;
  if (screen.forms[slot] == Form::far) projection.far.copy(lane, &screen.far[slot]);
  if (screen.forms[slot] != Form::near && screen.forms[slot] != Form::partial) return;
  projection.near.copy(lane, &screen.near[slot]);
}

void project_all(const FrameConstants& frame, const SplatNumbers& splats, std::span<const std::uint32_t> numbers,
                 const ScreenSplats& screen) {
  Records records{};
  Projection projection{};
  for_each_group(splats, numbers, records, [&](std::size_t first, std::size_t count) HWY_ATTR {
    project(frame, records, projection);
    for (std::size_t lane = 0; lane < count; ++lane)
      write_splat(projection, static_cast<int>(lane), screen, first + lane);
  });
}

Int keys_of(const FrameConstants& frame, const Records& records, SortKey kind) {
  const Vector3 center = position_in_view(frame, records);
  if (kind == SortKey::depth) return key_of(center.z);
  const Int mass = bits_of<0, 16>(records.word(4)), coverage = bits_of<16, 8>(records.word(8));
  const Float longest = log_number(bits_of<16, 16>(records.word(4))) * load(records.ranges.deviation_scale.data());
  const Float foot = length(boundary_foot(records));
  const Float radius = longest * fma(fma(foot, 1.1F, 1.0F), half_axis, foot);
  Mask hidden = either(is_outside(frame, center, radius), either(is_zero(mass), is_zero(coverage)));
  hidden = either(hidden, hn::Not(is_finite(bits_as_float(records.word(7)))));
  Float distance = frame.orthographic ? center.z : length(center);
  return select_int(hidden, -1, key_of(max(distance, 0.0F)));
}

void keys_of_all(const FrameConstants& frame, const SplatNumbers& splats, std::uint32_t begin, SortKey kind,
                 std::span<std::uint32_t> keys) {
  Records records{};
  make_keys(splats, begin, keys, records, [&]() HWY_ATTR { return keys_of(frame, records, kind); });
}

const char* target_name() { return hwy::TargetName(HWY_TARGET); }

}  // namespace
}  // namespace splatvol::tiles::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatvol::tiles {

HWY_EXPORT(project_all);
HWY_EXPORT(keys_of_all);
HWY_EXPORT(target_name);

void moments_keys(const FrameConstants& frame, const SplatNumbers& splats, std::uint32_t begin, SortKey kind,
                  std::span<std::uint32_t> keys) {
  HWY_DYNAMIC_DISPATCH(keys_of_all)(frame, splats, begin, kind, keys);
}

void project_moments(const FrameConstants& frame, const SplatNumbers& splats, std::span<const std::uint32_t> numbers,
                     const ScreenSplats& screen) {
  HWY_DYNAMIC_DISPATCH(project_all)(frame, splats, numbers, screen);
}

const char* instruction_set() { return HWY_DYNAMIC_DISPATCH(target_name)(); }

}  // namespace splatvol::tiles
#endif
