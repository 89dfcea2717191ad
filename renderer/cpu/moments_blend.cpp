// Blends splats of the kernel moments into a tile: a pixel in each lane.
#include <algorithm>
#include <cmath>

#include "renderer/cpu/moments_kernel.h"
#include "splat/constants.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "renderer/cpu/moments_blend.cpp"
#include "renderer/cpu/targets.h"
// The order matters: this includes the file again, once for each instruction set.
#include <hwy/foreach_target.h>

#include "renderer/cpu/blend-inl.h"
#include "renderer/cpu/vector-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatvol::tiles::HWY_NAMESPACE {
namespace {

using namespace drawing;

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

/// Sets begin and end of the pixels in each row, and where t is 0 in it.
template <class Rows>
HWY_INLINE void set_spans(const Span& span, Float center, const Part& part, int row, Rows& rows) {
  const Float left(static_cast<float>(part.left)), right(static_cast<float>(part.right));
  store(center, rows.center.data() + row);
  store(truncate(hn::Ceil(clamp(center + span.low - 0.5F, left, right).v)), rows.begin.data() + row);
  store(truncate(hn::Ceil(clamp(center + span.high - 0.5F, left, right).v)), rows.end.data() + row);
}

HWY_INLINE Float row_centers(const EllipseOutline& outline, const TileArea& area, Float v) {
  return fma(v, outline.shear, outline.x - static_cast<float>(area.left));
}

/// The rows of pixels of a splat in a tile.
struct NearRows {
  alignas(64) std::array<float, tile_size + most_lanes> center;
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

template <class Height>
HWY_INLINE NearChord near_chord(const NearSplat& splat, Float t, Height v) {
  NearChord chord;
  const Vector3 n = vector_at(splat.moment, t, v);
  chord.direction = vector_at(splat.direction, t, v);
  chord.square = dot(chord.direction, chord.direction);
  chord.root = inverse_sqrt(chord.square);
  const Float r = chord.root * chord.root;
  chord.q = max(fnma(dot(n, n), r, 1.0F), 0.0F);
  chord.middle = cross(chord.direction, n) * r;
  return chord;
}

/// The rows of pixels of a splat in a tile, with the far form's polynomials of t in each.
struct FarRows {
  using Row = std::array<float, tile_size + most_lanes>;
  alignas(64) Row center;   // pixels from the tile's left edge
  alignas(64) Row ellipse;  // 1 - s^2 at t = 0
  alignas(64) Row depth, depth_slope;
  alignas(64) Row column, column_slope;
  alignas(64) Row cutting;
  alignas(64) Row low_column, high_column;                                  // bounds within the row
  alignas(64) std::array<std::int32_t, tile_size + most_lanes> begin, end;  // pixels of the tile
};

HWY_INLINE void set_rows(const FarSplat& splat, const std::array<float, 6>& c, const TileArea& area, const Part& part,
                         FarRows& rows) {
  const auto& d = splat.depth;
  for (int row = part.bottom; row < part.top; row += lane_count()) {
    const Float v = lane_numbers() + (static_cast<float>(area.bottom + row) + 0.5F - splat.outline.y);
    const Span span = span_of(splat.outline, v);
    set_spans(span, row_centers(splat.outline, area, v), part, row, rows);
    store(fma(v * v, -splat.outline.inverse_height2, 1.0F), rows.ellipse.data() + row);
    store(fma(v, fma(v, d[5], d[2]), d[0]), rows.depth.data() + row);
    store(fma(v, d[4], d[1]), rows.depth_slope.data() + row);
    store(fma(v, fma(v, c[5], c[2]), c[0]), rows.column.data() + row);
    store(fma(v, c[4], c[1]), rows.column_slope.data() + row);
    store(fma(v, splat.cutting[2], splat.cutting[0]), rows.cutting.data() + row);
  }
}

/// The part of a chord in front of u, for the density (1 - u^2)^(3/2): its share of the mass, and the mean of u there
/// (splat/constants.h).
struct ChordPart {
  Float share, mean;
};

HWY_INLINE ChordPart part_of_chord(Float u) {
  u = clamp(u, -1.0F, 1.0F);
  const Float square = u * u;
  Float odd = fma(square, share_7, share_5);
  odd = fnma(square, odd, share_3);
  odd = u * fnma(square, odd, share_1);
  Float mean = fma(u, mean_3, mean_2);
  mean = fnma(u, mean, mean_1);
  mean = fma(u, mean, mean_0);
  const Float rest = Float(1.0F) - u;
  return {max(odd + 0.5F, 0.0F), -(rest * rest * mean)};
}

/// Bounds of the columns of the table that a splat needs.
struct ColumnRange {
  float low, high;
};

HWY_INLINE ColumnRange column_range(const FarSplat& splat) {
  return {splat.column[0] - splat.column_reach, splat.column[0] + splat.column_reach};
}

/// The level of the table of which one window has all columns that a splat needs in a tile, and the window's first
/// column there. -1: no level is exact enough.
struct WindowChoice {
  int level;
  float scale;  // columns of the level for a column of level 0
  float first;
};

HWY_INLINE WindowChoice choose_window(const TableView& table, int row, const ColumnRange& range) {
  constexpr WindowChoice none{-1, 1, 0};
  if (!(range.low >= static_cast<float>(1 - table_margin)) ||
      !(range.high < static_cast<float>(table.columns + most_lanes)))
    return none;
  float scale = 1;
  for (int level = 0; level < TableView::level_count; ++level, scale *= 0.5F) {
    const float first = std::floor(range.low * scale);
    if (range.high * scale >= first + static_cast<float>(lane_count())) continue;
    if (level == 0) return {level, scale, first};
    const auto block_of = [&](float column) {
      return std::clamp(static_cast<int>(column) / TableView::columns_per_block, 0, table.blocks - 1);
    };
    const float* errors = table.errors + std::ptrdiff_t{row} * table.blocks * TableView::level_count;
    for (int block = block_of(range.low); block <= block_of(range.high); ++block)
      if (errors[block * TableView::level_count + level] > most_level_error) return none;
    return {level, scale, first};
  }
  return none;
}

/// Values of the far form at some pixels of a row.
struct FarSample {
  Float depth, column;
  Mask inside;
};

template <bool bounded>
HWY_INLINE FarSample sample_far(const FarSplat& splat, float column_bend, float along, const FarRows& rows, int row,
                                int x) {
  const Float t = lane_numbers() + (static_cast<float>(x) + 0.5F - rows.center[row]);
  const Float w = max(fma(t * t, -splat.outline.inverse_width2, rows.ellipse[row]), bounded ? 1e-12F : 0.0F);
  FarSample sample;
  sample.inside = lane_numbers() < Float(static_cast<float>(rows.end[row] - x));
  sample.depth = fma(t, fma(t, splat.depth[3], rows.depth_slope[row]), rows.depth[row]) * (w * w);
  sample.column = fma(t, fma(t, column_bend, rows.column_slope[row]), rows.column[row]);
  if constexpr (bounded) {
    const Float inverse_root = inverse_sqrt(w);
    const ChordPart chord = part_of_chord(fma(t, splat.cutting[1], rows.cutting[row]) * inverse_root);
    sample.depth = sample.depth * chord.share;
    sample.column = fma(w * inverse_root * along, chord.mean, sample.column);
  }
  return sample;
}

template <bool paired = false>
HWY_INLINE void blend_sample(const FarSample& sample, Float light, const Material& material, int row, int x,
                             TilePixels& pixels) {
  const Float alpha = only(sample.inside, opacity(max(sample.depth * material.extinction, 0.0F)));
  blend<paired>(alpha, light, material, pixels.values.data() + row * TilePixels::row_stride + x);
}

/// Returns the polynomial of columns, counted from the middle of the window's first two.
HWY_INLINE std::array<float, 6> columns_of(const FarSplat& splat, const WindowChoice& choice) {
  std::array<float, 6> columns = splat.column;
  if (choice.level < 0) return columns;
  for (float& c : columns) c *= choice.scale;
  columns[0] -= choice.first + 0.5F;
  return columns;
}

/// Blends a splat that no row of pixels has more of than a vector has lanes; if `paired`, than it has in a half. Rows
/// need no spans: outside of the ellipse nothing is drawn.
template <bool bounded, bool cut_off, bool one_window, bool paired>
HWY_INLINE void blend_small(const FrameConstants& frame, const FarSplat& splat, const TileArea& area, const Part& part,
                            const WindowChoice& choice, TilePixels& pixels) {
  const EllipseOutline& outline = splat.outline;
  const auto& d = splat.depth;
  const std::array<float, 6> c = columns_of(splat, choice);
  const float along = splat.along * choice.scale;
  const TableWindow window(frame.table.levels[one_window ? choice.level : 0], splat.row,
                           one_window ? static_cast<int>(choice.first) : 0);
  const LanePixels lanes = lane_pixels<paired>();
  const Float x = lanes.x + (static_cast<float>(area.left + part.left) + 0.5F - outline.x);
  const Mask in_row = lanes.x < Float(static_cast<float>(part.right - part.left));
  Float y = lanes.y + (static_cast<float>(area.bottom + part.bottom) + 0.5F - outline.y);
  for (int row = part.bottom; row < part.top; row += lanes.rows, y = y + static_cast<float>(lanes.rows)) {
    const Mask in_part = paired ? both(in_row, lanes.y < Float(static_cast<float>(part.top - row))) : in_row;
    const Float t = fma(y, -outline.shear, x);
    const Float ellipse = fma(t * t, -outline.inverse_width2, fma(y * y, -outline.inverse_height2, 1.0F));
    const Float w = max(ellipse, bounded ? 1e-12F : 0.0F);
    FarSample sample;
    sample.inside = in_part;
    if constexpr (cut_off) {
      const Float s_x = x * outline.by_width, s_y = fma(s_x, -outline.skew, y) * outline.by_height;
      sample.inside = both(in_part, max(abs(s_x), abs(s_y)) <= Float(outline.reach));
    }
    const Float slope = fma(y, d[4], d[1]), column_slope = fma(y, c[4], c[1]);
    sample.depth = fma(t, fma(t, d[3], slope), fma(y, fma(y, d[5], d[2]), d[0])) * (w * w);
    sample.column = fma(t, fma(t, c[3], column_slope), fma(y, fma(y, c[5], c[2]), c[0]));
    if constexpr (bounded) {
      const Float inverse_root = inverse_sqrt(w);
      const Float cutting = fma(t, splat.cutting[1], fma(y, splat.cutting[2], splat.cutting[0]));
      const ChordPart chord = part_of_chord(cutting * inverse_root);
      sample.depth = sample.depth * chord.share;
      sample.column = fma(w * inverse_root * along, chord.mean, sample.column);
    }
    const Material material =
        one_window ? window.look_up(sample.column)
                   : look_up_row(frame.table, splat.row, sample.column, both(sample.inside, ellipse > Float(0.0F)));
    blend_sample<paired>(sample, splat.light, material, row, part.left, pixels);
  }
}

template <bool bounded, bool one_window>
HWY_INLINE void blend_rows(const FrameConstants& frame, const FarSplat& splat, const TileArea& area, const Part& part,
                           const WindowChoice& choice, TilePixels& pixels) {
  const int lanes = lane_count();
  const std::array<float, 6> columns = columns_of(splat, choice);
  FarRows rows;
  set_rows(splat, columns, area, part, rows);
  const Float light(splat.light);
  const TableWindow window(frame.table.levels[one_window ? choice.level : 0], splat.row,
                           one_window ? static_cast<int>(choice.first) : 0);
  for (int row = part.bottom; row < part.top; ++row)
    for (int x = rows.begin[row]; x < rows.end[row]; x += lanes) {
      const FarSample sample = sample_far<bounded>(splat, columns[3], splat.along * choice.scale, rows, row, x);
      const Material material = one_window ? window.look_up(sample.column)
                                           : look_up_row(frame.table, splat.row, sample.column, sample.inside);
      blend_sample(sample, light, material, row, x, pixels);
    }
}

template <bool bounded, bool one_window, bool paired>
HWY_INLINE void blend_small_far(const FrameConstants& frame, const FarSplat& splat, const TileArea& area,
                                const Part& part, const WindowChoice& choice, TilePixels& pixels) {
  if (splat.outline.reach < 1)
    blend_small<bounded, true, one_window, paired>(frame, splat, area, part, choice, pixels);
  else
    blend_small<bounded, false, one_window, paired>(frame, splat, area, part, choice, pixels);
}

template <bool bounded, bool one_window>
HWY_INLINE void blend_far_by(const FrameConstants& frame, const FarSplat& splat, const TileArea& area, const Part& part,
                             const WindowChoice& choice, TilePixels& pixels) {
  const int width = part.right - part.left;
  if (width <= lane_count() / 2)
    blend_small_far<bounded, one_window, true>(frame, splat, area, part, choice, pixels);
  else if (width <= lane_count())
    blend_small_far<bounded, one_window, false>(frame, splat, area, part, choice, pixels);
  else
    blend_rows<bounded, one_window>(frame, splat, area, part, choice, pixels);
}

template <bool bounded>
HWY_INLINE void blend_far(const FrameConstants& frame, const FarSplat& splat, const TileArea& area, const Part& part,
                          TilePixels& pixels) {
  const WindowChoice choice = choose_window(frame.table, splat.row, column_range(splat));
  if (choice.level < 0)
    blend_far_by<bounded, false>(frame, splat, area, part, choice, pixels);
  else
    blend_far_by<bounded, true>(frame, splat, area, part, choice, pixels);
}

/// Returns the integrals of (1 - u^2)^(3/2) and of u (1 - u^2)^(3/2) from u to 1.
struct ChordRest {
  Float mass, moment;
};

HWY_INLINE ChordRest rest_of_chord(Float u) {
  // The part beyond |u| is x^(5/2) times a polynomial of x = 1 - |u|.
  constexpr float whole = 1.17809725F;  // 3 pi / 8
  const Float x = Float(1.0F) - abs(u);
  Float p = fma(x, 0.0012168689F, 0.0034301744F);
  p = fma(x, p, 0.059149728F);
  p = fma(x, p, -0.6061204F);
  p = fma(x, p, 1.13137143F);
  const Float beyond = p * x * x * sqrt(max(x, 0.0F));
  const Float w = max(x * (abs(u) + 1.0F), 0.0F);
  return {select(u < Float(0.0F), Float(whole) - beyond, beyond), w * w * sqrt(w) * 0.2F};
}

/// moments_near.frag: the splat's optical depth at an extinction of 1, and its value.
struct NearSample {
  Float depth, mean, spread, light;
};

/// A splat that lies in front of the eye's plane: an ellipse, with one spread and one light.
template <bool bounded>
HWY_INLINE NearSample sample_ellipse(const NearSplat& splat, Float t, float v, Float ray) {
  const NearChord chord = near_chord(splat, t, v);
  const Vector3 gradient = vector_of(splat.gradient);
  NearSample sample;
  sample.depth = ray * chord.root * chord.q * chord.q * splat.strength;
  sample.mean = dot(gradient, chord.middle) + splat.mean;
  if constexpr (bounded) {
    const Vector3 normal = vector_of(splat.normal);
    const Float half_chord = max(sqrt(chord.q), 1e-20F);
    const Float towards = dot(normal, chord.direction) * chord.root;
    const ChordPart part = part_of_chord(-dot(normal, chord.middle) / (half_chord * max(abs(towards), 1e-12F)));
    const Float along = dot(gradient, chord.direction) * chord.root * half_chord * part.mean;
    sample.depth = sample.depth * part.share;
    sample.mean = sample.mean + select(towards < Float(0.0F), -along, along);
  }
  return sample;
}

/// Sets depth and mean of a splat by the part of its chords that counts. `partial`: it is in front of `surface`.
template <bool partial>
HWY_INLINE void set_visible_part(const NearSplat& splat, const NearChord& at, Float t, float v, Float ray,
                                 Float surface, NearSample& sample) {
  const Vector3 d = at.direction, gradient = vector_of(splat.gradient), normal = vector_of(splat.normal);
  const Float d_along = fma(t, splat.along[1], splat.along[0] + v * splat.along[2]);

  // The chord runs from -1 to 1 in u. Its parts behind the eye, beyond the boundary or behind a surface do not count.
  const Float half_chord = sqrt(at.q), least_half = max(half_chord, 1e-20F);
  Float begin = clamp(d_along * at.root / least_half, -1.0F, 1.0F);
  Float end(1.0F);
  const Float normal_along = dot(normal, d);
  if (splat.stretch > 0) {
    const Float towards = normal_along * at.root;
    const Mask enters = towards < Float(0.0F);
    const Float size = select(enters, min(towards, -1e-12F), max(towards, 1e-12F));
    const Float cut = -dot(normal, at.middle) / (least_half * size);
    end = select(enters, 1.0F, max(min(cut, 1.0F), begin));
    begin = select(enters, max(begin, min(cut, 1.0F)), begin);
  }
  if constexpr (partial) {
    const Float cut = fma(surface * splat.inverse_depth, at.square, d_along) * at.root / least_half;
    end = max(min(end, cut), begin);
  }
  const ChordRest from = rest_of_chord(begin), to = rest_of_chord(end);
  const Float mass = max(from.mass - to.mass, 0.0F);
  const Float mean_u = (from.moment - to.moment) / max(mass, 1e-10F);

  constexpr float by_whole = 0.848826363F;  // 8 / (3 pi)
  const Float along = dot(gradient, d);
  sample.depth = ray * at.root * at.q * at.q * mass * (splat.strength * by_whole);
  sample.mean = fma(along * at.root * half_chord, clamp(mean_u, begin, end), dot(gradient, at.middle) + splat.mean);
}

/// Sets spread and light of a splat that the eye's plane cuts or almost touches.
HWY_INLINE void set_spread(const FrameConstants& frame, const NearSplat& splat, const NearChord& at, Float ray,
                           NearSample& sample) {
  const Vector3 gradient = vector_of(splat.gradient);
  const Float along = dot(gradient, at.direction);
  const Float stretch = dot(vector_of(splat.normal), at.direction) * splat.stretch;
  sample.spread =
      sqrt(fma(along, along / (fma(stretch, stretch, at.square) * (half_axis * half_axis)), splat.residual));
  sample.light = frame.ambient;
  if (frame.diffuse == 0) return;
  const Float cosine = splat.inverse_slope > 0 ? min(abs(along) * splat.inverse_slope / ray, 1.0F) : Float(1.0F);
  const Float scatter = scatter_of(Float(splat.residual * (half_axis * half_axis)), dot(gradient, gradient));
  sample.light = fma(mean_cosine(cosine, scatter), frame.diffuse, frame.ambient);
}

HWY_INLINE void blend_near_sample(const NearSample& sample, Float light, const Material& material, Mask inside,
                                  float* pixels) {
  const Float depth = sample.depth * material.extinction;
  const Mask sound = both(inside, is_finite(depth));
  blend(only(sound, opacity(max(depth, 0.0F))), select(sound, light, 0.0F), material, pixels);
}

HWY_INLINE Float column_of(const FrameConstants& frame, Float mean, Float columns) {
  return fma(mean - 0.5F, columns, 0.5F * static_cast<float>(frame.table.columns - 1));
}

/// Blends a vector of pixels for each call. `row` and `x`: of the tile.
struct EllipseBlender {
  const FrameConstants& frame;
  const NearSplat& splat;
  TableRow table;
  std::int32_t row;

  HWY_INLINE EllipseBlender(const FrameConstants& constants, const NearSplat& near)
      : frame(constants), splat(near), table(table_row(constants.table, near.spread)), row(first_lane(table.row)) {}

  template <bool bounded>
  HWY_INLINE void blend_vector(Float t, float v, Float ray, Mask inside, float* pixels) const {
    const NearSample sample = sample_ellipse<bounded>(splat, t, v, ray);
    const Float column = column_of(frame, sample.mean, table.columns);
    blend_near_sample(sample, splat.light, look_up_row(frame.table, row, column, inside), inside, pixels);
  }
  HWY_INLINE void operator()(Float t, float v, Float ray, Mask inside, int /*row*/, int /*x*/, float* pixels) const {
    if (splat.stretch > 0)
      blend_vector<true>(t, v, ray, inside, pixels);
    else
      blend_vector<false>(t, v, ray, inside, pixels);
  }
};

/// Blends an ellipse of which surfaces may hide a part.
struct PartialEllipseBlender {
  EllipseBlender whole;
  const TileArea& area;

  HWY_INLINE void operator()(Float t, float v, Float ray, Mask inside, int row, int x, float* pixels) const {
    const FrameConstants& frame = whole.frame;
    const NearSplat& splat = whole.splat;
    const Float surface = load(frame.surfaces->at(area.left + x, area.bottom + row));
    NearSample sample;
    set_visible_part<true>(splat, near_chord(splat, t, v), t, v, ray, surface, sample);
    const Float column = column_of(frame, sample.mean, whole.table.columns);
    blend_near_sample(sample, splat.light, look_up_row(frame.table, whole.row, column, inside), inside, pixels);
  }
};

template <bool partial>
struct BoxBlender {
  const FrameConstants& frame;
  const NearSplat& splat;
  const TileArea& area;

  HWY_INLINE void operator()(Float t, float v, Float ray, Mask inside, int row, int x, float* pixels) const {
    const NearChord chord = near_chord(splat, t, v);
    inside = both(inside, chord.q > Float(0.0F));
    if (!any(inside)) return;  // a box has many pixels beside its ellipsoid
    const Float surface = partial ? load(frame.surfaces->at(area.left + x, area.bottom + row)) : Float(0.0F);
    NearSample sample;
    set_visible_part<partial>(splat, chord, t, v, ray, surface, sample);
    set_spread(frame, splat, chord, ray, sample);
    const TableRow table = table_row(frame.table, sample.spread);
    const Float column = column_of(frame, sample.mean, table.columns);
    const Material material = look_up_rows(frame.table, table.row, column, inside);
    blend_near_sample(sample, sample.light, material, inside, pixels);
  }
};

template <class Blender>
HWY_INLINE void blend_near_rows(const FrameConstants& frame, const NearSplat& splat, const TileArea& area,
                                const Part& part, const NearRows& rows, const Blender& blender, TilePixels& pixels) {
  const float by_focal = frame.orthographic ? 0.0F : 1.0F / frame.focal;
  for (int row = part.bottom; row < part.top; ++row) {
    const float y = static_cast<float>(area.bottom + row) + 0.5F;
    const float v = y - splat.outline.y, tangent_y = (y - 0.5F * frame.height) * by_focal;
    for (int x = rows.begin[row]; x < rows.end[row]; x += lane_count()) {
      const Float at = lane_numbers() + (static_cast<float>(x) + 0.5F);
      const Mask inside = at < Float(static_cast<float>(rows.end[row]));
      const Float tangent_x = (at + (static_cast<float>(area.left) - 0.5F * frame.width)) * by_focal;
      const Float ray = sqrt(fma(tangent_x, tangent_x, tangent_y * tangent_y + 1.0F));
      blender(at - rows.center[row], v, ray, inside, row, x, pixels.values.data() + row * TilePixels::row_stride + x);
    }
  }
}

/// `partial`: surfaces may hide a part of the splat.
template <bool partial>
HWY_INLINE void blend_near(const FrameConstants& frame, const NearSplat& splat, const TileArea& area, const Part& part,
                           TilePixels& pixels) {
  NearRows rows;
  for (int row = part.bottom; row < part.top; row += lane_count()) {
    const Float v = lane_numbers() + (static_cast<float>(area.bottom + row) + 0.5F - splat.outline.y);
    set_spans(span_of(splat.outline, v), row_centers(splat.outline, area, v), part, row, rows);
  }
  if (!(splat.spread >= 0))
    blend_near_rows(frame, splat, area, part, rows, BoxBlender<partial>{frame, splat, area}, pixels);
  else if constexpr (partial)
    blend_near_rows(frame, splat, area, part, rows, PartialEllipseBlender{{frame, splat}, area}, pixels);
  else
    blend_near_rows(frame, splat, area, part, rows, EllipseBlender(frame, splat), pixels);
}

/// Splats of a tile are far apart in memory.
HWY_INLINE void prefetch(const ScreenSplats& screen, std::uint32_t slot) {
  hwy::Prefetch(&screen.bounds[slot]);
  hwy::Prefetch(&screen.forms[slot]);
  hwy::Prefetch(&screen.far[slot]);
  hwy::Prefetch(&screen.far[slot].light);
}

template <bool surfaces>
HWY_INLINE bool blend_slots(const FrameConstants& frame, const ScreenSplats& screen,
                            std::span<const std::uint32_t> slots, const TileArea& area, TilePixels& pixels) {
  constexpr std::size_t splats_per_check = 64, ahead = 8;
  for (std::size_t i = 0; i < slots.size(); ++i) {
    if (i % splats_per_check == 0 && is_opaque(area, pixels)) return true;
    const std::uint32_t slot = slots[i];
    if (i + ahead < slots.size()) prefetch(screen, slots[i + ahead]);
    const Part part = part_of(screen.bounds[slot], area);
    if (screen.forms[slot] == Form::near)
      blend_near<false>(frame, screen.near[slot], area, part, pixels);
    else if (surfaces && screen.forms[slot] == Form::partial)
      blend_near<true>(frame, screen.near[slot], area, part, pixels);
    else if (const FarSplat& splat = screen.far[slot]; splat.cutting[0] < 1e17F)
      blend_far<true>(frame, splat, area, part, pixels);
    else
      blend_far<false>(frame, splat, area, part, pixels);
  }
  return is_opaque(area, pixels);
}

bool blend_all(const FrameConstants& frame, const ScreenSplats& screen, std::span<const std::uint32_t> slots,
               const TileArea& area, TilePixels& pixels) {
  return blend_slots<false>(frame, screen, slots, area, pixels);
}

bool blend_with_surfaces(const FrameConstants& frame, const ScreenSplats& screen, std::span<const std::uint32_t> slots,
                         const TileArea& area, TilePixels& pixels) {
  return blend_slots<true>(frame, screen, slots, area, pixels);
}

}  // namespace
}  // namespace splatvol::tiles::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatvol::tiles {

HWY_EXPORT(blend_all);
HWY_EXPORT(blend_with_surfaces);

bool blend_moments(const FrameConstants& frame, const ScreenSplats& screen, std::span<const std::uint32_t> slots,
                   const TileArea& area, TilePixels& pixels) {
  if (frame.surfaces) return HWY_DYNAMIC_DISPATCH(blend_with_surfaces)(frame, screen, slots, area, pixels);
  return HWY_DYNAMIC_DISPATCH(blend_all)(frame, screen, slots, area, pixels);
}

}  // namespace splatvol::tiles
#endif
