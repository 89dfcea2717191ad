// Mixes splats of the kernel moments in slabs of a tile: the sums that a slab's pixels gather. Included once for each
// instruction set.
#if defined(SPLATVOL_RENDERER_CPU_SLAB_MIXING_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATVOL_RENDERER_CPU_SLAB_MIXING_INL_H
#undef SPLATVOL_RENDERER_CPU_SLAB_MIXING_INL_H
#else
#define SPLATVOL_RENDERER_CPU_SLAB_MIXING_INL_H
#endif

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include "renderer/cpu/blend-inl.h"
#include "renderer/cpu/near-inl.h"
#include "renderer/cpu/vector-inl.h"
#include "splat/constants.h"

HWY_BEFORE_NAMESPACE();
namespace splatvol::tiles::HWY_NAMESPACE {

/// Pixels of a tile that are sampled, every 1st, 2nd, 4th ... in each direction. The last sample of a coarser grid lies
/// behind the tile. Vectors may begin at any sample.
struct SampleGrid {
  int spacing;
  int first_row;  // in a plane
};

constexpr int grid_rows(int spacing) { return tile_size / spacing + (spacing > 1 ? 1 : 0); }
constexpr std::array<SampleGrid, 4> sample_grids{
    {{1, 0}, {2, grid_rows(1)}, {4, grid_rows(1) + grid_rows(2)}, {8, grid_rows(1) + grid_rows(2) + grid_rows(4)}}};
static_assert(sample_grids.back().spacing == coarsest_samples);

constexpr int row_stride = TilePixels::row_stride;
constexpr int plane = (sample_grids.back().first_row + grid_rows(sample_grids.back().spacing)) * row_stride;

/// What the pixels of a slab gather. Lengths are depths: a ray is longer by its own factor.
struct SlabPlanes {
  static constexpr int count = 9;

  float* mass = nullptr;      // density times length
  float* value = nullptr;     // times mass
  float* residual = nullptr;  // times mass
  float* light = nullptr;     // times mass
  float* opacity = nullptr;   // factor on the extinction, times mass
  // Of the boundaries in the slab: the density that ends (leave) or begins (enter) there, and times its distance to the
  // slab's front.
  float *leave = nullptr, *leave_at = nullptr, *enter = nullptr, *enter_at = nullptr;

  SlabPlanes() = default;
  explicit SlabPlanes(float* first)
      : mass(first),
        value(first + plane),
        residual(first + 2 * plane),
        light(first + 3 * plane),
        opacity(first + 4 * plane),
        leave(first + 5 * plane),
        leave_at(first + 6 * plane),
        enter(first + 7 * plane),
        enter_at(first + 8 * plane) {}
};

template <bool paired>
HWY_INLINE void add(Float a, float* to) {
  store_pixels<paired>(load_pixels<paired>(to) + a, to);
}

/// The density (1 - u^2)^(3/2) along a chord, whose integral from -1 to 1 is 1: its integral from 0 to u, and that of
/// u times it from -1 to u.
struct ChordSums {
  Float mass, moment;
};

HWY_INLINE ChordSums chord_sums(Float u) {
  const Float square = u * u;
  Float odd = fma(square, drawing::share_7, drawing::share_5);
  odd = fnma(square, odd, drawing::share_3);
  odd = u * fnma(square, odd, drawing::share_1);
  const Float w = max(Float(1.0F) - square, 1e-8F);  // a smaller one has denormal products, which take long
  return {odd, w * w * w * rough_inverse_sqrt(w) * -0.169765273F};
}

/// Returns that density.
HWY_INLINE Float chord_density(Float u) {
  const Float w = max(fnma(u, u, 1.0F), 0.0F);
  return w * sqrt(w) * 0.848826363F;
}

/// A splat's chords through some pixels. `whole`: nothing cuts them off (is_whole).
template <bool whole>
struct Chords {
  Float middle, half, inverse_half;  // depths
  Float begin, end;                  // of the part that counts, in u; not set if `whole`
  Float mass;                        // density times depth, of the whole chord; 0 in lanes without a chord
  Float value, slope;                // in the middle; per u
  Float cut;                         // of the boundary, in u; not set if `whole`
  Mask enters;                       // at the boundary; likewise

  [[nodiscard]] HWY_INLINE Float depth_at(Float u) const { return fma(u, half, middle); }
  [[nodiscard]] HWY_INLINE Float front() const { return whole ? middle - half : depth_at(begin); }
  [[nodiscard]] HWY_INLINE Float back() const { return whole ? middle + half : depth_at(end); }
  /// `depth`: where sums of the part that counts end.
  [[nodiscard]] HWY_INLINE ChordSums sums_to(float depth) const {
    const Float u = (Float(depth) - middle) * inverse_half;
    return chord_sums(whole ? clamp(u, -1.0F, 1.0F) : clamp(u, begin, end));
  }
};

/// Reads depths of surfaces at a vector of pixels, as load_pixels.
template <bool paired>
HWY_INLINE Float load_depths(const float* depths, int row_stride_of_depths) {
  if constexpr (!paired) return load(depths);
  const auto lower = hn::LoadU(HalfTag(), depths);
  return hn::Combine(FloatTag(), hn::LoadU(HalfTag(), depths + row_stride_of_depths), lower);
}

/// A splat in a tile, and the slabs that it touches.
struct SplatPart {
  const NearSplat& splat;
  const SlabSplat& slab;
  const TileArea& area;
  const SampleGrid& grid;
  Part part;        // in samples
  bool lit, fades;  // by the light; by an opacity
  std::span<const Slab> slabs;
  const float* fronts;  // of the slabs, and of what follows in the group; then infinity
  std::span<const SlabPlanes> planes;
  const Surfaces* surfaces;  // null: no surface hides a part of the splat
};

/// Returns whether neither the eye, a boundary nor a surface cuts the splat's chords off.
HWY_INLINE bool is_whole(const SplatPart& at) { return at.slab.front > 0 && !(at.slab.stretch > 0) && !at.surfaces; }

template <bool whole, class Height>
HWY_INLINE void set_chords(const SplatPart& at, Float t, Height v, Mask inside, Chords<whole>& chords) {
  const NearSplat& splat = at.splat;
  const NearChord chord = near_chord<true>(splat, t, v);
  const Float inverse_root_q = fast_inverse_sqrt(max(chord.q, 1e-30F)), root_q = chord.q * inverse_root_q;
  const Float along = fma(t, splat.along[1], v * splat.along[2] + splat.along[0]);
  const Vector3 gradient = vector_of(splat.gradient);
  chords.middle = along * chord.root * chord.root * -at.slab.depth;
  chords.half = root_q * chord.root * at.slab.depth;
  chords.inverse_half = inverse_root_q * chord.square * chord.root * splat.inverse_depth;
  chords.mass = only(both(inside, chord.q > Float(0.0F)), chord.root * chord.q * chord.q * splat.strength);
  chords.value = dot(gradient, chord.middle) + splat.mean;
  chords.slope = dot(gradient, chord.direction) * chord.root * root_q;
  if constexpr (whole) return;

  chords.begin = clamp(chords.middle * chords.inverse_half * -1.0F, -1.0F, 1.0F);  // the eye
  chords.end = 1.0F;
  chords.cut = 2.0F;
  chords.enters = Float(0.0F) > Float(0.0F);
  if (splat.stretch > 0) {
    const Vector3 normal = vector_of(splat.normal);
    const Float towards = dot(normal, chord.direction) * chord.root;
    chords.enters = towards < Float(0.0F);
    const Float size = select(chords.enters, min(towards, -1e-12F), max(towards, 1e-12F));
    chords.cut = dot(normal, chord.middle) * inverse_root_q / -size;
    chords.end = select(chords.enters, 1.0F, max(min(chords.cut, 1.0F), chords.begin));
    chords.begin = select(chords.enters, max(chords.begin, min(chords.cut, 1.0F)), chords.begin);
  }
}

/// Ends chords at surfaces. A boundary behind them is none.
HWY_INLINE void end_at(Float surface, Chords<false>& chords) {
  const Float cut = (surface - chords.middle) * chords.inverse_half;
  chords.end = max(min(chords.end, cut), chords.begin);
  chords.cut = select(chords.cut > cut, 2.0F, chords.cut);
}

/// Adds the boundaries that chords meet in a slab.
template <bool paired>
HWY_INLINE void add_boundaries(const Chords<false>& chords, const Slab& slab, const SlabPlanes& planes, int from) {
  const Float cut = chords.depth_at(chords.cut);
  const Mask here = both(both(abs(chords.cut) < Float(1.0F), cut > Float(0.0F)),
                         both(cut >= Float(slab.front), cut < Float(slab.back)));
  if (!any(here)) return;
  const Float density = only(here, chords.mass * chords.inverse_half * chord_density(chords.cut));
  const Float moved = only(here, density * (cut - slab.front));
  add<paired>(only(chords.enters, density), planes.enter + from);
  add<paired>(only(chords.enters, moved), planes.enter_at + from);
  add<paired>(only(hn::Not(chords.enters), density), planes.leave + from);
  add<paired>(only(hn::Not(chords.enters), moved), planes.leave_at + from);
}

/// Chords, the slabs [first, end) that they touch of those that their splat touches, and their first sample in a plane.
template <bool whole>
struct PlacedChords {
  Chords<whole> chords;
  int first, end, sample;
};

/// Sets which slabs the chords touch.
template <bool whole>
HWY_INLINE void find_slabs(const SplatPart& at, PlacedChords<whole>& placed) {
  const int count = static_cast<int>(at.slabs.size());
  placed.first = 0;
  placed.end = count;
  if (count == 1) return;
  const Mask inside = placed.chords.mass > Float(0.0F);
  const Float front = hn::MinOfLanes(FloatTag(), select(inside, placed.chords.front(), 3e38F).v);
  const Float back = hn::MaxOfLanes(FloatTag(), select(inside, placed.chords.back(), -3e38F).v);
  placed.end = 1;
  for (int j = 1; j < count; j += lane_count()) {
    const Float fronts = load(at.fronts + j);
    placed.first += static_cast<int>(hn::CountTrue(FloatTag(), fronts <= front));
    placed.end += static_cast<int>(hn::CountTrue(FloatTag(), fronts < back));
  }
  placed.end = std::min(placed.end, count);  // in spite of rounding
  placed.first = std::min(placed.first, placed.end - 1);
}

template <bool whole, bool paired>
HWY_INLINE void add_chords(const SplatPart& at, const PlacedChords<whole>& placed) {
  const Chords<whole>& chords = placed.chords;
  const int last_slab = static_cast<int>(at.slabs.size()) - 1;
  ChordSums before{-0.5F, 0.0F};
  if (!whole || (placed.first == 0 && at.slabs[0].front > at.slab.front))
    before = chords.sums_to(at.slabs[static_cast<std::size_t>(placed.first)].front);
  for (int j = placed.first; j < placed.end; ++j) {
    const Slab& slab = at.slabs[static_cast<std::size_t>(j)];
    const SlabPlanes& planes = at.planes[static_cast<std::size_t>(j)];
    ChordSums after{0.5F, 0.0F};
    if (!whole || j + 1 < placed.end || (j == last_slab && slab.back < at.slab.back)) after = chords.sums_to(slab.back);
    const Float mass = chords.mass * (after.mass - before.mass), moment = chords.mass * (after.moment - before.moment);
    before = after;
    add<paired>(mass, planes.mass + placed.sample);
    add<paired>(fma(mass, chords.value, moment * chords.slope), planes.value + placed.sample);
    add<paired>(mass * at.splat.residual, planes.residual + placed.sample);
    if (at.lit) add<paired>(mass * at.splat.light, planes.light + placed.sample);
    if (at.fades) add<paired>(mass * at.splat.opacity, planes.opacity + placed.sample);
    if constexpr (!whole)
      if (at.slab.stretch > 0) add_boundaries<paired>(chords, slab, planes, placed.sample);
  }
}

/// Mixes a splat. If `paired`, no row has more of its pixels than half a vector, and a vector has two rows.
///
/// All chords come first, and then all sums: the number of slabs to add to is known long before it is needed, so that a
/// wrong guess costs the processor little.
template <bool whole, bool paired>
HWY_NOINLINE void mix(const SplatPart& at) {
  constexpr std::size_t most = std::size_t{tile_size} * tile_size / hn::MaxLanes(FloatTag());
  std::array<PlacedChords<whole>, most> placed;
  std::size_t count = 0;
  const Part& part = at.part;
  const EllipseOutline& outline = at.splat.outline;
  const auto spacing = static_cast<float>(at.grid.spacing);
  const float height = static_cast<float>(at.area.bottom) + 0.5F - outline.y;  // of the first row
  const auto place = [&](Float t, auto v, Mask inside, int row, int column) HWY_ATTR {
    set_chords<whole>(at, t, v, inside, placed[count].chords);
    if constexpr (!whole)
      if (at.surfaces) {  // its samples are pixels
        const float* depths = at.surfaces->at(at.area.left + column, at.area.bottom + row);
        end_at(load_depths<paired>(depths, at.surfaces->row_stride()), placed[count].chords);
      }
    placed[count].sample = (at.grid.first_row + row) * row_stride + column;
    find_slabs(at, placed[count]);
    ++count;
  };
  if constexpr (paired) {
    // Rows need no spans: outside of the ellipse nothing is mixed.
    const LanePixels lanes = lane_pixels<true>();
    const Float x =
        fma(lanes.x + static_cast<float>(part.left), spacing, static_cast<float>(at.area.left) + 0.5F - outline.x);
    const Mask in_row = lanes.x < Float(static_cast<float>(part.right - part.left));
    for (int row = part.bottom; row < part.top; row += lanes.rows) {
      const Float v = fma(lanes.y + static_cast<float>(row), spacing, height);
      const Mask inside = both(in_row, lanes.y < Float(static_cast<float>(part.top - row)));
      place(fma(v, -outline.shear, x), v, inside, row, part.left);
    }
  } else {
    NearRows rows;
    for (int row = part.bottom; row < part.top; row += lane_count()) {
      const Float v = fma(lane_numbers() + static_cast<float>(row), spacing, height);
      set_spans(span_of(outline, v), row_centres(outline, at.area, v), part, row, rows, at.grid.spacing);
    }
    for (int row = part.bottom; row < part.top; ++row) {
      const float v = static_cast<float>(row) * spacing + height;
      for (int column = rows.begin[row]; column < rows.end[row]; column += lane_count())
        place(fma(lane_numbers() + static_cast<float>(column), spacing, 0.5F - rows.centre[row]), v,
              lane_numbers() < Float(static_cast<float>(rows.end[row] - column)), row, column);
    }
  }
  for (std::size_t i = 0; i < count; ++i) add_chords<whole, paired>(at, placed[i]);
}

void mix_splat(const SplatPart& at) {
  const bool whole = is_whole(at);
  const bool paired = at.part.right - at.part.left <= lane_count() / 2;
  if (paired)
    whole ? mix<true, true>(at) : mix<false, true>(at);
  else
    whole ? mix<true, false>(at) : mix<false, false>(at);
}

/// Returns the samples of a splat in a tile. Its bounds have the pixels between its outermost samples and the next ones
/// besides, unless an edge of the picture cut them off.
HWY_INLINE Part samples_of(const FrameConstants& frame, const PixelBounds& bounds, const TileArea& area, int spacing) {
  if (spacing == 1) return part_of(bounds, area);
  const auto first = [spacing](int edge, int tile) {
    return edge == 0 ? 0 : std::max(edge - tile + 2 * (spacing - 1), 0) / spacing;
  };
  const auto end = [spacing](int edge, int tile, float last) {
    constexpr int size = tile_size;
    return static_cast<float>(edge) == last ? size / spacing + 1
                                            : std::min((edge - tile) / spacing, size / spacing + 1);
  };
  return {first(bounds.left, area.left), first(bounds.bottom, area.bottom), end(bounds.right, area.left, frame.width),
          end(bounds.top, area.bottom, frame.height)};
}

/// Adds the samples of a plane's coarser grid, and those between them, to those of the next finer grid.
HWY_INLINE void add_between(const SampleGrid& coarse, const SampleGrid& fine, float* numbers) {
  const int fine_rows = grid_rows(fine.spacing), columns = (fine_rows + 1) / 2;
  const float* from = numbers + coarse.first_row * row_stride;
  float* to = numbers + fine.first_row * row_stride;
  const auto add_row = [&](const float* one, const float* other, float* row) HWY_ATTR {
    for (int x = 0; x < columns; x += lane_count()) {
      const Float here = load(one + x) + load(other + x), next = load(one + x + 1) + load(other + x + 1);
      hn::Vec<FloatTag> even, odd;
      hn::LoadInterleaved2(FloatTag(), row + 2 * x, even, odd);
      hn::StoreInterleaved2(fma(here, 0.5F, even).v, fma(here + next, 0.25F, odd).v, FloatTag(), row + 2 * x);
    }
  };
  for (int y = 0; y < fine_rows; ++y)
    add_row(from + y / 2 * row_stride, from + (y + 1) / 2 * row_stride, to + y * row_stride);
}

}  // namespace splatvol::tiles::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
