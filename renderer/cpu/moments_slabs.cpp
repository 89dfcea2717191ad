// Mixes splats of the kernel moments in slabs of a tile, and classifies the mixture: a pixel in each lane.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

#include "renderer/cpu/moments_kernel.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "renderer/cpu/moments_slabs.cpp"
#include "renderer/cpu/targets.h"
// The order matters: this includes the file again, once for each instruction set.
#include <hwy/foreach_target.h>

#include "renderer/cpu/blend-inl.h"
#include "renderer/cpu/near-inl.h"
#include "renderer/cpu/vector-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatvol::tiles::HWY_NAMESPACE {
namespace {

/// Pixels of a tile that are sampled, every 1st, 2nd, 4th ... in each direction. The last sample of a coarser grid lies
/// behind the tile. Vectors may begin at any sample.
struct SampleGrid {
  int spacing;
  int first_row;  // in a plane
};

constexpr int grid_rows(int spacing) { return tile_size / spacing + (spacing > 1 ? 1 : 0); }
constexpr std::array<SampleGrid, 4> sample_grids{{{1, 0},
                                                  {2, grid_rows(1)},
                                                  {4, grid_rows(1) + grid_rows(2)},
                                                  {8, grid_rows(1) + grid_rows(2) + grid_rows(4)}}};
static_assert(sample_grids.back().spacing == coarsest_samples);

constexpr int row_stride = TilePixels::row_stride;
constexpr int plane = (sample_grids.back().first_row + grid_rows(sample_grids.back().spacing)) * row_stride;

/// What the pixels of a slab gather. Lengths are depths: a ray is longer by its own factor.
struct SlabPlanes {
  static constexpr int count = 8;

  float* mass = nullptr;      // density times length
  float* value = nullptr;     // times mass
  float* residual = nullptr;  // times mass
  float* light = nullptr;     // times mass
  // Of the boundaries in the slab: the density that ends (leave) or begins (enter) there, and times its distance to the
  // slab's front.
  float *leave = nullptr, *leave_at = nullptr, *enter = nullptr, *enter_at = nullptr;

  SlabPlanes() = default;
  explicit SlabPlanes(float* first)
      : mass(first),
        value(first + plane),
        residual(first + 2 * plane),
        light(first + 3 * plane),
        leave(first + 4 * plane),
        leave_at(first + 5 * plane),
        enter(first + 6 * plane),
        enter_at(first + 7 * plane) {}
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
  Float odd = fma(square, 0.02572878F, 0.04308751F);
  odd = fnma(square, odd, 0.41694202F);
  odd = u * fnma(square, odd, 0.84812573F);
  const Float w = max(Float(1.0F) - square, 1e-8F);
  // Above, w is so large that no product of it is denormal, which takes long.
  return {odd, w * w * w * rough_inverse_sqrt(w) * -0.169765273F};
}

/// Returns that density.
HWY_INLINE Float chord_density(Float u) {
  const Float w = max(fnma(u, u, 1.0F), 0.0F);
  return w * sqrt(w) * 0.848826363F;
}

/// A splat's chords through some pixels. `whole`: neither the eye nor a boundary cuts them off.
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

/// A splat in a tile, and the slabs that it touches.
struct SplatPart {
  const NearSplat& splat;
  const SlabSplat& slab;
  const TileArea& area;
  const SampleGrid& grid;
  Part part;  // in samples
  bool lit;
  std::span<const Slab> slabs;
  std::span<const SlabPlanes> planes;
};

template <bool whole, class Height>
HWY_INLINE Chords<whole> chords_of(const SplatPart& at, Float t, Height v, Mask inside) {
  const NearSplat& splat = at.splat;
  const NearChord chord = near_chord<true>(splat, t, v);
  const Float inverse_root_q = fast_inverse_sqrt(max(chord.q, 1e-30F)), root_q = chord.q * inverse_root_q;
  const Float along = fma(t, splat.along[1], v * splat.along[2] + splat.along[0]);
  const Vector3 gradient = vector_of(splat.gradient);
  Chords<whole> chords;
  chords.middle = along * chord.root * chord.root * -at.slab.depth;
  chords.half = root_q * chord.root * at.slab.depth;
  chords.inverse_half = inverse_root_q * chord.square * chord.root * at.slab.inverse_depth;
  chords.mass = only(both(inside, chord.q > Float(0.0F)), chord.root * chord.q * chord.q * splat.strength);
  chords.value = dot(gradient, chord.middle) + splat.mean;
  chords.slope = dot(gradient, chord.direction) * chord.root * root_q;
  if constexpr (whole) return chords;

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
  return chords;
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

template <bool whole>
HWY_INLINE void find_slabs(std::span<const Slab> slabs, PlacedChords<whole>& placed) {
  const Mask inside = placed.chords.mass > Float(0.0F);
  const Float front = placed.chords.front(), back = placed.chords.back();
  placed.first = 0;
  placed.end = 1;
  for (std::size_t j = 1; j < slabs.size(); ++j) {
    const Float edge(slabs[j].front);
    placed.first += any(both(inside, front < edge)) ? 0 : 1;
    placed.end += any(both(inside, back > edge)) ? 1 : 0;
  }
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
    if constexpr (!whole)
      if (at.slab.stretch > 0) add_boundaries<paired>(chords, slab, planes, placed.sample);
  }
}

/// Mixes a splat. If `paired`, no row has more of its pixels than half a vector, and a vector has two rows.
///
/// First all chords, and then all sums: how many slabs chords touch is known long before it is needed, and a processor
/// that guessed it wrong loses little.
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
    placed[count].chords = chords_of<whole>(at, t, v, inside);
    placed[count].sample = (at.grid.first_row + row) * row_stride + column;
    find_slabs(at.slabs, placed[count]);
    ++count;
  };
  if constexpr (paired) {
    // Rows need no spans: outside of the ellipse nothing is mixed.
    const LanePixels lanes = lane_pixels<true>();
    const Float x = fma(lanes.x + static_cast<float>(part.left), spacing, static_cast<float>(at.area.left) + 0.5F - outline.x);
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
  const bool whole = at.slab.front > 0 && !(at.slab.stretch > 0);
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
    return static_cast<float>(edge) == last ? size / spacing + 1 : std::min((edge - tile) / spacing, size / spacing + 1);
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
  for (int y = 0; y < fine_rows; ++y) add_row(from + y / 2 * row_stride, from + (y + 1) / 2 * row_stride, to + y * row_stride);
}

/// A slab, and those that touch it.
struct Neighbours {
  const SlabPlanes *before, *slab, *after;  // null: there is none
  float before_thickness, thickness, after_thickness;
};

/// Returns the length of material in a slab, at some pixels. `bounded`: it may have boundaries.
HWY_INLINE Float length_of(const Neighbours& n, bool bounded, Float mass, int at) {
  constexpr float least_density = 0.25F;  // of a boundary that counts; at twice of it, it decides
  const Float thickness(n.thickness);
  Float within = thickness;
  if (bounded) {
    const SlabPlanes& p = *n.slab;
    const Float leave = load(p.leave + at), enter = load(p.enter + at);
    const Float leaves = clamp(fma(leave, 1.0F / least_density, -1.0F), 0.0F, 1.0F);
    const Float enters = clamp(fma(enter, 1.0F / least_density, -1.0F), 0.0F, 1.0F);
    const Mask leaving = leaves > Float(0.0F), entering = enters > Float(0.0F);
    const Float end = select(leaving, load(p.leave_at + at) / max(leave, 1e-30F), thickness);
    const Float begin = select(entering, load(p.enter_at + at) / max(enter, 1e-30F), 0.0F);
    // With both there is a layer between them, or a gap. The mass tells.
    const Float layer = end - begin, rest = layer + thickness;
    const Mask is_layer = either(hn::Not(both(leaving, entering)), abs(layer - mass) < abs(rest - mass));
    const Float between = select(is_layer, layer, rest);
    within = max(fma(max(leaves, enters), between - thickness, thickness), n.thickness * 1e-6F);
  }
  // Inside, the sum of densities only ripples. Where material ends without a boundary, it falls from 1 to 0.
  return within * clamp(fma(mass / within, 1.5F, -0.25F), 0.0F, 1.0F);
}

/// The mean value in a slab, and where there is one.
struct MeanValue {
  Float value;
  Mask known;
};

HWY_INLINE MeanValue mean_value(const SlabPlanes& slab, float thickness, int at) {
  const Float mass = load(slab.mass + at);
  const Mask known = mass > Float(thickness * 1e-6F);
  return {load(slab.value + at) / select(known, mass, 1.0F), known};
}

/// Half of the difference of the values at a slab's back and front.
HWY_INLINE Float half_range(const Neighbours& n, Float value, Float length, int at) {
  const auto step = [&](const SlabPlanes* other, float thickness) HWY_ATTR {
    if (!other) return Float(0.0F);
    const MeanValue mean = mean_value(*other, thickness, at);
    return only(mean.known, (mean.value - value) * (n.thickness / (n.thickness + thickness)));
  };
  const Float to_front = step(n.before, n.before_thickness), to_back = step(n.after, n.after_thickness);
  // Without one of the neighbours, the value goes on as towards the other one.
  const Mask whole = both(abs(to_front) > Float(0.0F), abs(to_back) > Float(0.0F));
  return (to_back - to_front) * select(whole, 0.5F, length * (1.0F / n.thickness));
}

/// Looks up the material of some values with their spreads.
HWY_INLINE Material material_of(const FrameConstants& frame, Float value, Float spread, Mask filled) {
  TableRow table = table_row(frame.table, spread);
  // Most often, a row serves all lanes: neighbouring rows differ little.
  const Int low = smallest_of(select_int(filled, table.row, std::numeric_limits<std::int32_t>::max()));
  const Int high = largest_of(select_int(filled, table.row, 0));
  const bool alike = first_lane(high) - first_lane(low) <= 1;
  if (alike) table = row_of(frame.table, spread, high);
  const Float column = fma(value - 0.5F, table.columns, 0.5F * static_cast<float>(frame.table.columns - 1));
  return alike ? look_up_row(frame.table, first_lane(high), column, filled)
               : look_up_rows(frame.table, table.row, column, filled);
}

void classify(const FrameConstants& frame, const TileArea& area, const Neighbours& n, bool bounded,
              TilePixels& pixels) {
  constexpr float residual_share = 0.25F;  // what splats mixed do not tell of each other's residual
  const float by_focal = frame.orthographic ? 0.0F : 1.0F / frame.focal;
  for (int row = 0; row < area.height; ++row) {
    const float tangent_y = (static_cast<float>(area.bottom + row) + 0.5F - 0.5F * frame.height) * by_focal;
    for (int x = 0; x < area.width; x += lane_count()) {
      const int at = row * row_stride + x;
      const MeanValue mean = mean_value(*n.slab, n.thickness, at);
      if (!any(mean.known)) continue;
      const Float mass = load(n.slab->mass + at), by_mass = only(mean.known, Float(1.0F) / mass);
      const Float length = length_of(n, bounded, mass, at);
      const Mask filled = both(mean.known, length > Float(0.0F));
      if (!any(filled)) continue;
      const Float half = half_range(n, mean.value, length, at);
      const Float residual = load(n.slab->residual + at) * by_mass;
      const Float spread = sqrt(max(fma(half * half, 1.0F / 3, residual * residual_share), 0.0F));
      const Material material = material_of(frame, mean.value, spread, filled);
      const float centre = static_cast<float>(x + area.left) + 0.5F - 0.5F * frame.width;
      const Float tangent_x = (lane_numbers() + centre) * by_focal;
      const Float ray = sqrt(fma(tangent_x, tangent_x, tangent_y * tangent_y + 1.0F));
      const Float depth = length * ray * material.extinction;
      const Mask sound = both(filled, is_finite(depth));
      const Float light = frame.diffuse != 0 ? load(n.slab->light + at) * by_mass : Float(frame.ambient);
      blend(only(sound, opacity(max(depth, 0.0F))), select(sound, light, 0.0F), material, pixels.values.data() + at);
    }
  }
}

constexpr std::size_t slabs_at_once = 8;

/// Sorts the splats of a tile by their fronts.
void sort_splats(const ScreenSplats& screen, std::span<const std::uint32_t> slots, SlabWorkspace& work) {
  work.keys.clear();
  for (const std::uint32_t slot : slots) {
    // Positive numbers have the order of their bits.
    const float front = std::max(screen.slab[slot].front, 0.0F);
    work.keys.push_back(std::uint64_t{std::bit_cast<std::uint32_t>(front)} << 32 | slot);
  }
  std::ranges::sort(work.keys);
  work.splats.clear();
  for (const std::uint64_t key : work.keys) {
    const auto slot = static_cast<std::uint32_t>(key);
    const SlabSplat& splat = screen.slab[slot];
    const auto spacing = static_cast<unsigned>(splat.spacing);
    work.splats.push_back({splat.front, splat.back, splat.weight, splat.weight / splat.chord, slot,
                           static_cast<std::uint8_t>(std::countr_zero(spacing)), splat.stretch > 0});
  }
}

/// Sums of what is at a depth: optical depths, and optical depths over chords.
struct Crowd {
  double weight = 0, by_chord = 0;

  void add(const SlabWorkspace::Splat& splat) {
    weight += splat.weight;
    by_chord += splat.by_chord;
  }
};

/// Cuts the depths of a tile into slabs. A slab is half as thick as chords are long: the harmonic mean of those in it,
/// weighted by their optical depths.
void make_slabs(const Slab& depths, SlabWorkspace& work) {
  constexpr double chords_thick = 0.5, least_thickness = 1e-5;  // the latter as a share of the depth
  const std::span<const SlabWorkspace::Splat> splats = work.splats;
  work.slabs.clear();
  work.active.clear();
  std::size_t entered = 0;
  float depth = std::max(splats[0].front, depths.front);
  while (depth < depths.back) {
    for (; entered < splats.size() && splats[entered].front <= depth; ++entered)
      work.active.push_back(static_cast<std::uint32_t>(entered));
    Crowd crowd;
    std::erase_if(work.active, [&](std::uint32_t i) {
      if (splats[i].back <= depth) return true;
      crowd.add(splats[i]);
      return false;
    });
    if (work.active.empty()) {
      if (entered == splats.size()) return;
      depth = splats[entered].front;
      continue;
    }
    const auto back_of = [&](const Crowd& mixed) {
      const double thickness = std::max(chords_thick * mixed.weight / mixed.by_chord, least_thickness * depth);
      return std::min(static_cast<float>(depth + thickness), depths.back);
    };
    // Those that begin in the slab count too: many small splats may follow a large one.
    float back = back_of(crowd);
    for (std::size_t i = entered; i < splats.size() && splats[i].front < back; ++i) {
      crowd.add(splats[i]);
      back = std::min(back, std::max(back_of(crowd), splats[i].front));
    }
    if (!(back > depth)) return;
    work.slabs.push_back({depth, back});
    depth = back;
  }
}

/// The slabs of a tile, one after the other. Planes of those that are at work lie in a ring.
class SlabSequence {
 public:
  SlabSequence(const FrameConstants& frame, const ScreenSplats& screen, const TileArea& area, SlabWorkspace& work)
      : frame_(frame), screen_(screen), area_(area), work_(work), slabs_(work.slabs), lit_(frame.diffuse != 0) {
    constexpr std::size_t numbers_each = std::size_t{SlabPlanes::count} * plane + row_stride;
    work.planes.resize(numbers_each * ring_.size());
    for (std::size_t i = 0; i < ring_.size(); ++i) ring_[i] = SlabPlanes(work.planes.data() + i * numbers_each);
    work.active.clear();
  }

  void blend(TilePixels& pixels) {
    std::size_t blended = 0;
    for (std::size_t end = 0; end < slabs_.size() && !is_opaque(area_, pixels);) {
      const std::size_t first = std::exchange(end, std::min(end + slabs_at_once, slabs_.size()));
      mix(first, end);
      // The last one waits for the slab behind it.
      const std::size_t known = end < slabs_.size() ? end - 1 : end;
      for (; blended < known; ++blended) classify_slab(blended, pixels);
    }
  }

 private:
  [[nodiscard]] const SlabPlanes& planes_of(std::size_t slab) const { return ring_[slab % ring_.size()]; }
  [[nodiscard]] float thickness(std::size_t slab) const { return slabs_[slab].back - slabs_[slab].front; }
  [[nodiscard]] bool touches_next(std::size_t slab) const {
    return slab + 1 < slabs_.size() && slabs_[slab].back == slabs_[slab + 1].front;
  }

  /// Mixes the splats in slabs [first, end).
  void mix(std::size_t first, std::size_t end) {
    const std::span<const Slab> slabs = slabs_.subspan(first, end - first);
    const std::span<const SlabWorkspace::Splat> splats = work_.splats;
    for (; entered_ < splats.size() && splats[entered_].front < slabs.back().back; ++entered_)
      work_.active.push_back(static_cast<std::uint32_t>(entered_));
    std::size_t coarsest = 0;
    bool bounded = false;
    std::erase_if(work_.active, [&](std::uint32_t i) {
      if (splats[i].back <= slabs.front().front) return true;
      coarsest = std::max<std::size_t>(coarsest, splats[i].grid);
      bounded |= splats[i].bounded;
      return false;
    });
    std::array<SlabPlanes, slabs_at_once> planes;
    for (std::size_t i = first; i < end; ++i) {
      planes[i - first] = planes_of(i);
      bounded_[i % ring_.size()] = bounded;
      clear(planes_of(i), coarsest, bounded);
    }
    for (std::size_t i = 0; i < work_.active.size(); ++i) {
      constexpr std::size_t ahead = 4;
      if (i + ahead < work_.active.size()) prefetch(splats[work_.active[i + ahead]].slot);
      const SlabWorkspace::Splat& splat = splats[work_.active[i]];
      std::size_t begin = 0, back = slabs.size();
      while (slabs[begin].back <= splat.front) ++begin;
      while (slabs[back - 1].front >= splat.back) --back;
      const SampleGrid& grid = sample_grids[splat.grid];
      const Part part = samples_of(frame_, screen_.bounds[splat.slot], area_, grid.spacing);
      if (part.left >= part.right || part.bottom >= part.top) continue;
      mix_splat({screen_.near[splat.slot], screen_.slab[splat.slot], area_, grid, part, lit_,
                 slabs.subspan(begin, back - begin), std::span(planes).subspan(begin, back - begin)});
    }
    for (std::size_t i = first; i < end; ++i)
      for (std::size_t grid = coarsest; grid > 0; --grid)
        for (const auto sum : sums(false))
          add_between(sample_grids[grid], sample_grids[grid - 1], planes_of(i).*sum);
  }

  /// What slabs gather.
  [[nodiscard]] std::span<float* SlabPlanes::* const> sums(bool bounded) const {
    using Sum = float* SlabPlanes::*;
    static constexpr std::array<Sum, 8> all{&SlabPlanes::leave,    &SlabPlanes::leave_at, &SlabPlanes::enter,
                                            &SlabPlanes::enter_at, &SlabPlanes::mass,     &SlabPlanes::value,
                                            &SlabPlanes::residual, &SlabPlanes::light};
    const std::size_t begin = bounded ? 0 : 4;
    return std::span(all).subspan(begin, (lit_ ? 8 : 7) - begin);
  }

  void clear(const SlabPlanes& planes, std::size_t coarsest, bool bounded) const {
    const int rows = sample_grids[coarsest].first_row + grid_rows(sample_grids[coarsest].spacing);
    for (const auto sum : sums(bounded)) std::fill_n(planes.*sum, rows * row_stride, 0.0F);
  }

  void classify_slab(std::size_t i, TilePixels& pixels) const {
    Neighbours n{nullptr, &planes_of(i), nullptr, 0, thickness(i), 0};
    if (i > 0 && touches_next(i - 1)) {
      n.before = &planes_of(i - 1);
      n.before_thickness = thickness(i - 1);
    }
    if (touches_next(i)) {
      n.after = &planes_of(i + 1);
      n.after_thickness = thickness(i + 1);
    }
    classify(frame_, area_, n, bounded_[i % ring_.size()], pixels);
  }

  /// Splats of a tile are far apart in memory.
  void prefetch(std::uint32_t slot) const {
    hwy::Prefetch(&screen_.slab[slot]);
    hwy::Prefetch(&screen_.bounds[slot]);
    for (std::size_t byte = 0; byte < sizeof(NearSplat); byte += 64)
      hwy::Prefetch(reinterpret_cast<const char*>(&screen_.near[slot]) + byte);
  }

  const FrameConstants& frame_;
  const ScreenSplats& screen_;
  const TileArea& area_;
  SlabWorkspace& work_;
  std::span<const Slab> slabs_;
  std::array<SlabPlanes, slabs_at_once + 2> ring_;
  std::array<bool, slabs_at_once + 2> bounded_{};  // whether a slab of the ring may have boundaries
  std::size_t entered_ = 0;
  bool lit_;
};

bool blend_in_slabs(const FrameConstants& frame, const ScreenSplats& screen, std::span<const std::uint32_t> slots,
                    const Slab& depths, const TileArea& area, SlabWorkspace& work, TilePixels& pixels) {
  sort_splats(screen, slots, work);
  make_slabs(depths, work);
  SlabSequence(frame, screen, area, work).blend(pixels);
  return is_opaque(area, pixels);
}

}  // namespace
}  // namespace splatvol::tiles::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatvol::tiles {

HWY_EXPORT(blend_in_slabs);

bool blend_slabs(const FrameConstants& frame, const ScreenSplats& screen, std::span<const std::uint32_t> slots,
                 const Slab& depths, const TileArea& area, SlabWorkspace& workspace, TilePixels& pixels) {
  return HWY_DYNAMIC_DISPATCH(blend_in_slabs)(frame, screen, slots, depths, area, workspace, pixels);
}

}  // namespace splatvol::tiles
#endif
