// The pixels of a splat in a tile, and the chords of their rays through it. Included once for each instruction set.
#if defined(SPLATVOL_RENDERER_CPU_NEAR_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATVOL_RENDERER_CPU_NEAR_INL_H
#undef SPLATVOL_RENDERER_CPU_NEAR_INL_H
#else
#define SPLATVOL_RENDERER_CPU_NEAR_INL_H
#endif

#include "renderer/cpu/vector-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatvol::tiles::HWY_NAMESPACE {

/// A splat's part of a tile, in pixels of the tile.
struct Part {
  int left, bottom, right, top;
};

HWY_INLINE Part part_of(const PixelBounds& bounds, const TileArea& area) {
  return {std::max(bounds.left - area.left, 0), std::max(bounds.bottom - area.bottom, 0),
          std::min(bounds.right - area.left, area.width), std::min(bounds.top - area.bottom, area.height)};
}

/// An interval of t in each of some rows.
struct Span {
  Float low, high;
};

/// Cuts a span off where |constant + slope t| > reach.
HWY_INLINE void cut(Float constant, float slope, float reach, Span& span) {
  if (slope == 0) return;
  const float inverse = 1 / slope, half = std::abs(reach * inverse);
  const Float middle = constant * -inverse;
  span.low = max(span.low, middle - half);
  span.high = min(span.high, middle + half);
}

/// Returns where the splat is drawn in rows of pixels.
HWY_INLINE Span span_of(const EllipseOutline& outline, Float v) {
  if (outline.reach < 0) return {-1e9F, 1e9F};
  const Float rest = max(fma(v * v, -outline.inverse_height2, 1.0F), 0.0F);
  const Float half = sqrt(rest * (1.0F / outline.inverse_width2));
  Span span{-half, half};
  if (outline.reach < 1) {
    const float by_width = outline.by_width, by_height = outline.by_height, turn = outline.skew * by_width;
    cut(v * (outline.shear * by_width), by_width, outline.reach, span);
    cut(v * ((1 - turn * outline.shear) * by_height), -turn * by_height, outline.reach, span);
  }
  return span;
}

/// Sets begin and end of the pixels in each row, and where t is 0 in it. If only each `spacing`th pixel is sampled,
/// from the tile's first on, they count samples.
template <class Rows>
HWY_INLINE void set_spans(const Span& span, Float centre, const Part& part, int row, Rows& rows, int spacing = 1) {
  const Float left(static_cast<float>(part.left)), right(static_cast<float>(part.right));
  const float inverse = 1.0F / static_cast<float>(spacing);
  store(centre, rows.centre.data() + row);
  store(truncate(hn::Ceil(clamp((centre + span.low - 0.5F) * inverse, left, right).v)), rows.begin.data() + row);
  store(truncate(hn::Ceil(clamp((centre + span.high - 0.5F) * inverse, left, right).v)), rows.end.data() + row);
}

HWY_INLINE Float row_centres(const EllipseOutline& outline, const TileArea& area, Float v) {
  return fma(v, outline.shear, outline.x - static_cast<float>(area.left));
}

/// The rows of pixels of a splat in a tile.
struct NearRows {
  alignas(64) std::array<float, tile_size + most_lanes> centre;
  alignas(64) std::array<std::int32_t, tile_size + most_lanes> begin, end;
};

/// `v`: a Float, or a float for all lanes.
template <class Height>
HWY_INLINE Vector3 vector_at(const LinearVector& linear, Float t, Height v) {
  return {fma(t, linear.by_t[0], v * linear.by_v[0] + linear.constant[0]),
          fma(t, linear.by_t[1], v * linear.by_v[1] + linear.constant[1]),
          fma(t, linear.by_t[2], v * linear.by_v[2] + linear.constant[2])};
}

HWY_INLINE Vector3 vector_of(const std::array<float, 3>& numbers) { return {numbers[0], numbers[1], numbers[2]}; }

/// The chord of a ray through a near splat, for all its forms.
struct NearChord {
  Vector3 direction, middle;
  Float square, root;  // of |d|, and its inverse
  Float q;             // squared half length of the chord, in the ball
};

template <bool fast = false, class Height>
HWY_INLINE NearChord near_chord(const NearSplat& splat, Float t, Height v) {
  NearChord chord;
  const Vector3 n = vector_at(splat.moment, t, v);
  chord.direction = vector_at(splat.direction, t, v);
  chord.square = dot(chord.direction, chord.direction);
  chord.root = fast ? fast_inverse_sqrt(chord.square) : inverse_sqrt(chord.square);
  const Float r = chord.root * chord.root;
  chord.q = max(fnma(dot(n, n), r, 1.0F), 0.0F);
  chord.middle = cross(chord.direction, n) * r;
  return chord;
}

}  // namespace splatvol::tiles::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
