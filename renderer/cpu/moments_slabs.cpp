// Cuts the depths of a tile into slabs, and classifies what splats of the kernel moments are together in each: a pixel
// in each lane.
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
#include "renderer/cpu/slab_mixing-inl.h"
#include "renderer/cpu/vector-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatvol::tiles::HWY_NAMESPACE {
namespace {

/// A slab, and those that touch it.
struct Neighbours {
  const SlabPlanes *before, *slab, *after;  // null: there is none
  float before_thickness, thickness, after_thickness;
  float kept;           // as of the slab
  float front;          // depth of the slab's front
  float least_density;  // that counts as material
};

/// How thick a slab and the one behind it are at some pixels: Number is a float where no surface ends them.
template <class Number>
struct Thickness {
  Number slab, after;
};

/// Surfaces end slabs where they hide a part of a splat in them. A slab that only whole splats are in stays as it is.
HWY_INLINE Thickness<Float> in_front_of(Float surface, const Neighbours& n) {
  const Float in_slab = clamp(surface - n.front, n.thickness * 1e-6F, n.thickness);
  return {in_slab, clamp(surface - (n.front + n.thickness), 0.0F, n.after_thickness)};
}

/// Returns the density of a slab that is full: 1, but less for what is thinner than pixels. It was widened, so that its
/// density falls: to that of the slab or its neighbours, whichever is densest.
template <class Number>
HWY_INLINE Float full_density(const Neighbours& n, Number thickness, Float mass, int at) {
  const float thick = std::min(2 * n.kept, 1.0F);
  if (thick == 1) return Float(1.0F);
  const auto density = [&](const SlabPlanes* slab, float whole)
                           HWY_ATTR { return slab ? load(slab->mass + at) * (1.0F / whole) : Float(0.0F); };
  const Float densest =
      max(mass * (1.0F / thickness), max(density(n.before, n.before_thickness), density(n.after, n.after_thickness)));
  return fma(clamp(densest * 1.25F, 1e-30F, 1.0F), 1 - thick, thick);
}

/// Returns the length of material in a slab, at some pixels. `bounded`: it may have boundaries.
template <class Number>
HWY_INLINE Float length_of(const Neighbours& n, Number slab_thickness, bool bounded, Float mass, int at) {
  constexpr float least_density = 0.25F;  // of a boundary that counts; at twice of it, it decides
  const Float thickness(slab_thickness);
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
  const Float full = full_density(n, slab_thickness, mass, at);
  const auto filled = [&](Float length, Float held) HWY_ATTR {
    return length * full * clamp(fma(held / (length * full), 1.5F, -0.25F), 0.0F, 1.0F);
  };
  if (!bounded) return filled(within, mass);
  // A boundary may be one of some cells only, as at hanging nodes: then more mass lies beyond it.
  const Float beyond = max(thickness - within, n.thickness * 1e-6F);
  return filled(within, mass) + filled(beyond, mass - within);
}

/// The mean value in a slab, and where there is one.
struct MeanValue {
  Float value;
  Mask known;
};

/// `least_density`: less is what rounding leaves of splats that end in front of the slab, or begin behind it.
HWY_INLINE MeanValue mean_value(const SlabPlanes& slab, float thickness, float least_density, int at) {
  const Float mass = load(slab.mass + at);
  const Mask known = mass > Float(thickness * least_density);
  return {load(slab.value + at) / select(known, mass, 1.0F), known};
}

/// Half of the difference of the values at a slab's back and front.
template <class Number>
HWY_INLINE Float half_range(const Neighbours& n, const Thickness<Number>& thickness, Float value, Float length,
                            int at) {
  const auto step = [&](const SlabPlanes* other, float whole, Number part) HWY_ATTR {
    if (!other) return Float(0.0F);
    const MeanValue mean = mean_value(*other, whole, n.least_density, at);
    return only(mean.known, (mean.value - value) * (thickness.slab / (thickness.slab + part)));
  };
  const Float to_front = step(n.before, n.before_thickness, n.before_thickness);
  const Float to_back = step(n.after, n.after_thickness, thickness.after);
  // Without one of the neighbours, the value goes on as towards the other one.
  const Mask whole = both(abs(to_front) > Float(0.0F), abs(to_back) > Float(0.0F));
  return (to_back - to_front) * select(whole, 0.5F, length * (1.0F / thickness.slab));
}

/// Looks up the material of some values with their spreads.
HWY_INLINE Material material_of(const FrameConstants& frame, Float value, Float spread, Mask filled) {
  const TableRow table = table_row(frame.table, spread);
  const Float column = fma(value - 0.5F, table.columns, 0.5F * static_cast<float>(frame.table.columns - 1));
  return look_up_rows(frame.table, max(table.row, Int(0)), column, filled);
}

template <bool partial>
HWY_INLINE auto thickness_at(const FrameConstants& frame, const TileArea& area, const Neighbours& n, int row, int x) {
  if constexpr (partial)
    return in_front_of(load(frame.surfaces->at(area.left + x, area.bottom + row)), n);
  else
    return Thickness<float>{n.thickness, n.after_thickness};
}

/// `partial`: surfaces may hide a part of it.
template <bool partial>
void classify(const FrameConstants& frame, const TileArea& area, const Neighbours& n, bool bounded,
              TilePixels& pixels) {
  constexpr float residual_share = 0.25F;  // what splats mixed do not tell of each other's residual
  const float by_focal = frame.orthographic ? 0.0F : 1.0F / frame.focal;
  for (int row = 0; row < area.height; ++row) {
    const float tangent_y = (static_cast<float>(area.bottom + row) + 0.5F - 0.5F * frame.height) * by_focal;
    for (int x = 0; x < area.width; x += lane_count()) {
      const int at = row * row_stride + x;
      const MeanValue mean = mean_value(*n.slab, n.thickness, n.least_density, at);
      if (!any(mean.known)) continue;
      const Float mass = load(n.slab->mass + at), by_mass = only(mean.known, Float(1.0F) / mass);
      const auto thickness = thickness_at<partial>(frame, area, n, row, x);
      const Float length = length_of(n, thickness.slab, bounded, mass, at);
      const Mask filled = both(mean.known, length > Float(0.0F));
      if (!any(filled)) continue;
      const Float half = half_range(n, thickness, mean.value, length, at);
      const Float residual = load(n.slab->residual + at) * by_mass;
      const Float spread = sqrt(max(fma(half * half, 1.0F / 3, residual * residual_share), 0.0F));
      const Material material = material_of(frame, mean.value, spread, filled);
      const float centre = static_cast<float>(x + area.left) + 0.5F - 0.5F * frame.width;
      const Float tangent_x = (lane_numbers() + centre) * by_focal;
      const Float ray = sqrt(fma(tangent_x, tangent_x, tangent_y * tangent_y + 1.0F));
      Float depth = length * ray * material.extinction;
      if (frame.opacity.factors) depth = depth * (load(n.slab->opacity + at) * by_mass);
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
    work.splats.push_back({splat.front, splat.back, splat.weight, splat.weight / splat.chord, splat.kept, slot,
                           static_cast<std::uint8_t>(std::countr_zero(spacing)), splat.stretch > 0,
                           screen.forms[slot] == Form::partial});
  }
}

/// Sums of what is at a depth: optical depths, and optical depths over chords.
struct Crowd {
  double weight = 0, by_chord = 0, kept = 0;
  float shortest = std::numeric_limits<float>::max();  // of the splats' extents in depth

  void add(const SlabWorkspace::Splat& splat) {
    weight += splat.weight;
    by_chord += splat.by_chord;
    kept += static_cast<double>(splat.weight) * splat.kept;
    shortest = std::min(shortest, splat.back - splat.front);
  }
};

/// Cuts the depths of a tile into slabs. A slab is half as thick as chords are long: the harmonic mean of those in it,
/// weighted by their optical depths. But no splat is cut into more than some hundred slabs: chords through needles
/// along the line of sight may be 1e12 times as short as these.
void make_slabs(const Slab& depths, SlabWorkspace& work) {
  constexpr double chords_thick = 0.5, least_thickness = 1e-5;  // the latter as a share of the depth
  constexpr double least_part = 1.0 / 256;                      // of the shortest splat
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
      const double thickness = std::max({chords_thick * mixed.weight / mixed.by_chord, least_thickness * depth,
                                         least_part * static_cast<double>(mixed.shortest)});
      return std::min(static_cast<float>(depth + thickness), depths.back);
    };
    // Those that begin in the slab count too: many small splats may follow a large one.
    float back = back_of(crowd);
    for (std::size_t i = entered; i < splats.size() && splats[i].front < back; ++i) {
      crowd.add(splats[i]);
      back = std::min(back, std::max(back_of(crowd), splats[i].front));
    }
    if (!(back > depth)) return;
    work.slabs.push_back({depth, back, static_cast<float>(crowd.kept / crowd.weight)});
    depth = back;
  }
}

/// The slabs of a tile, one after the other. Planes of those that are at work lie in a ring.
class SlabSequence {
 public:
  SlabSequence(const FrameConstants& frame, const ScreenSplats& screen, const TileArea& area, SlabWorkspace& work)
      : frame_(frame),
        screen_(screen),
        area_(area),
        work_(work),
        slabs_(work.slabs),
        lit_(frame.diffuse != 0),
        fades_(frame.opacity.factors != nullptr) {
    if (lit_) sums_[sum_count_++] = &SlabPlanes::light;
    if (fades_) sums_[sum_count_++] = &SlabPlanes::opacity;
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
    std::array<float, slabs_at_once + most_lanes> fronts;
    fronts.fill(std::numeric_limits<float>::infinity());
    for (std::size_t i = first; i < end; ++i) {
      planes[i - first] = planes_of(i);
      fronts[i - first] = slabs_[i].front;
      bounded_[i % ring_.size()] = bounded;
      partial_[i % ring_.size()] = false;
      clear(planes_of(i), coarsest, bounded);
    }
    for (std::size_t i = 0; i < work_.active.size(); ++i) {
      constexpr std::size_t ahead = 4;
      if (i + ahead < work_.active.size()) prefetch(splats[work_.active[i + ahead]].slot);
      const SlabWorkspace::Splat& splat = splats[work_.active[i]];
      std::size_t begin = 0, back = slabs.size();
      while (slabs[begin].back <= splat.front) ++begin;
      while (slabs[back - 1].front >= splat.back) --back;
      for (std::size_t j = begin; splat.partial && j < back; ++j) partial_[(first + j) % ring_.size()] = true;
      const SampleGrid& grid = sample_grids[splat.grid];
      const Part part = samples_of(frame_, screen_.bounds[splat.slot], area_, grid.spacing);
      if (part.left >= part.right || part.bottom >= part.top) continue;
      mix_splat({screen_.near[splat.slot], screen_.slab[splat.slot], area_, grid, part, lit_, fades_,
                 slabs.subspan(begin, back - begin), fronts.data() + begin,
                 std::span(planes).subspan(begin, back - begin), splat.partial ? frame_.surfaces : nullptr});
    }
    for (std::size_t i = first; i < end; ++i)
      for (std::size_t grid = coarsest; grid > 0; --grid)
        for (const auto sum : sums(false)) add_between(sample_grids[grid], sample_grids[grid - 1], planes_of(i).*sum);
  }

  /// What slabs gather.
  [[nodiscard]] std::span<float * SlabPlanes::*const> sums(bool bounded) const {
    const std::size_t begin = bounded ? 0 : 4;
    return std::span(sums_).subspan(begin, sum_count_ - begin);
  }

  void clear(const SlabPlanes& planes, std::size_t coarsest, bool bounded) const {
    const int rows = sample_grids[coarsest].first_row + grid_rows(sample_grids[coarsest].spacing);
    for (const auto sum : sums(bounded)) std::fill_n(planes.*sum, rows * row_stride, 0.0F);
  }

  void classify_slab(std::size_t i, TilePixels& pixels) const {
    constexpr float by_density = 1e-6F;
    Neighbours n{nullptr,
                 &planes_of(i),
                 nullptr,
                 0,
                 thickness(i),
                 0,
                 slabs_[i].kept,
                 slabs_[i].front,
                 by_density * std::max(slabs_[i].kept, 1e-24F)};
    bool partial = partial_[i % ring_.size()];
    if (i > 0 && touches_next(i - 1)) {
      n.before = &planes_of(i - 1);
      n.before_thickness = thickness(i - 1);
    }
    if (touches_next(i)) {
      n.after = &planes_of(i + 1);
      n.after_thickness = thickness(i + 1);
      partial |= partial_[(i + 1) % ring_.size()];
    }
    (partial ? classify<true> : classify<false>)(frame_, area_, n, bounded_[i % ring_.size()], pixels);
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
  std::array<bool, slabs_at_once + 2> partial_{};  // whether surfaces may hide a part of it
  std::size_t entered_ = 0;
  bool lit_, fades_;

  // What slabs gather: first at boundaries, last what depends on the frame.
  std::array<float * SlabPlanes::*, SlabPlanes::count> sums_{
      &SlabPlanes::leave, &SlabPlanes::leave_at, &SlabPlanes::enter,   &SlabPlanes::enter_at,
      &SlabPlanes::mass,  &SlabPlanes::value,    &SlabPlanes::residual};
  std::size_t sum_count_ = 7;
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
