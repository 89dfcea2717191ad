// Mixes splats of the kernel moments in slabs of a tile, and classifies the mixture: a pixel in each lane.
#include <algorithm>
#include <array>
#include <cmath>
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

constexpr int plane = TilePixels::plane;

/// What the pixels of a slab gather. Lengths are depths: a ray is longer by its own factor.
struct SlabPlanes {
  static constexpr int count = 8;

  float* mass = nullptr;      // density times length
  float* value = nullptr;     // times mass; then the mean
  float* residual = nullptr;  // the same
  float* light = nullptr;     // the same
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

HWY_INLINE void add(Float a, float* to) { store(load(to) + a, to); }

/// The density (1 - u^2)^(3/2) along a chord, whose integral from -1 to 1 is 1: its integral up to u, and that of u.
struct ChordSums {
  Float mass, moment;
};

HWY_INLINE ChordSums chord_sums(Float u) {
  const Float square = u * u;
  Float odd = fma(square, 0.02572878F, 0.04308751F);
  odd = fnma(square, odd, 0.41694202F);
  odd = u * fnma(square, odd, 0.84812573F);
  const Float w = max(Float(1.0F) - square, 0.0F);
  return {odd, w * w * fast_sqrt(max(w, 1e-20F)) * -0.169765273F};
}

/// Returns that density.
HWY_INLINE Float chord_density(Float u) {
  const Float w = max(fnma(u, u, 1.0F), 0.0F);
  return w * sqrt(w) * 0.848826363F;
}

/// A splat's chords through some pixels.
struct Chords {
  Float middle, half, inverse_half;  // depths
  Float begin, end;                  // of the part that counts, in u
  Float mass;                        // density times depth, of the whole chord
  Float value, slope;                // in the middle; per u
  Float cut;                         // of the boundary, in u
  Mask enters;
  Mask inside;
};

HWY_INLINE Chords chords_of(const NearSplat& splat, const SlabSplat& slab, Float t, float v, Mask inside) {
  const NearChord at = near_chord<true>(splat, t, v);
  Chords chords;
  chords.inside = both(inside, at.q > Float(0.0F));
  const Float inverse_root_q = fast_inverse_sqrt(max(at.q, 1e-30F)), root_q = at.q * inverse_root_q;
  const Float along = fma(t, splat.along[1], splat.along[0] + v * splat.along[2]);
  chords.middle = along * at.root * at.root * -slab.depth;
  chords.half = root_q * at.root * slab.depth;
  chords.inverse_half = inverse_root_q * at.square * at.root * (1.0F / slab.depth);
  chords.mass = only(chords.inside, at.root * at.q * at.q * splat.strength);
  const Vector3 gradient = vector_of(splat.gradient);
  chords.value = dot(gradient, at.middle) + splat.mean;
  chords.slope = dot(gradient, at.direction) * at.root * root_q;
  chords.begin = clamp(chords.middle * chords.inverse_half * -1.0F, -1.0F, 1.0F);  // the eye
  chords.end = 1.0F;
  chords.cut = 2.0F;
  if (splat.stretch > 0) {
    const Vector3 normal = vector_of(splat.normal);
    const Float towards = dot(normal, at.direction) * at.root;
    chords.enters = towards < Float(0.0F);
    const Float size = select(chords.enters, min(towards, -1e-12F), max(towards, 1e-12F));
    chords.cut = dot(normal, at.middle) * inverse_root_q / -size;
    chords.end = select(chords.enters, 1.0F, max(min(chords.cut, 1.0F), chords.begin));
    chords.begin = select(chords.enters, max(chords.begin, min(chords.cut, 1.0F)), chords.begin);
  }
  return chords;
}

/// Adds chords to the slabs that they touch. `from`: of the pixels in a plane.
HWY_INLINE void add_chords(const NearSplat& splat, const Chords& chords, bool lit, std::span<const Slab> slabs,
                           std::span<const SlabPlanes> planes, int from) {
  // Of a tilted splat, the chords of some pixels touch few of the slabs that the splat touches.
  constexpr std::size_t most_touched = 2;
  float nearest = -3e38F, farthest = 3e38F;
  if (slabs.size() > most_touched) {
    const Float front = fma(chords.begin, chords.half, chords.middle),
                back = fma(chords.end, chords.half, chords.middle);
    nearest = hn::GetLane(hn::MinOfLanes(FloatTag(), select(chords.inside, front, 3e38F).v));
    farthest = hn::GetLane(hn::MaxOfLanes(FloatTag(), select(chords.inside, back, -3e38F).v));
  }
  const auto u_of = [&](float depth) HWY_ATTR {
    return clamp((Float(depth) - chords.middle) * chords.inverse_half, chords.begin, chords.end);
  };
  ChordSums before;
  float known = -3e38F;
  for (std::size_t j = 0; j < slabs.size() && slabs[j].front < farthest; ++j) {
    if (slabs[j].back <= nearest) continue;
    if (slabs[j].front != known) before = chord_sums(u_of(slabs[j].front));
    const ChordSums after = chord_sums(u_of(slabs[j].back));
    known = slabs[j].back;
    const Float mass = chords.mass * (after.mass - before.mass), moment = chords.mass * (after.moment - before.moment);
    before = after;
    const SlabPlanes& p = planes[j];
    add(mass, p.mass + from);
    add(fma(mass, chords.value, moment * chords.slope), p.value + from);
    add(mass * splat.residual, p.residual + from);
    if (lit) add(mass * splat.light, p.light + from);
    if (!(splat.stretch > 0)) continue;
    const Float cut = fma(chords.cut, chords.half, chords.middle);
    const Mask here = both(both(abs(chords.cut) < Float(1.0F), cut > Float(0.0F)),
                           both(cut >= Float(slabs[j].front), cut < Float(slabs[j].back)));
    if (!any(here)) continue;
    const Float density = only(here, chords.mass * chords.inverse_half * chord_density(chords.cut));
    const Float moved = only(here, density * (cut - slabs[j].front));
    add(only(chords.enters, density), p.enter + from);
    add(only(chords.enters, moved), p.enter_at + from);
    add(only(hn::Not(chords.enters), density), p.leave + from);
    add(only(hn::Not(chords.enters), moved), p.leave_at + from);
  }
}

void gather(const FrameConstants& frame, const NearSplat& splat, const SlabSplat& slab, const TileArea& area,
            const Part& part, std::span<const Slab> slabs, std::span<const SlabPlanes> planes) {
  NearRows rows;
  for (int row = part.bottom; row < part.top; row += lane_count()) {
    const Float v = lane_numbers() + (static_cast<float>(area.bottom + row) + 0.5F - splat.outline.y);
    set_spans(span_of(splat.outline, v), row_centres(splat.outline, area, v), part, row, rows);
  }
  for (int row = part.bottom; row < part.top; ++row) {
    const float v = static_cast<float>(area.bottom + row) + 0.5F - splat.outline.y;
    for (int x = rows.begin[row]; x < rows.end[row]; x += lane_count()) {
      const Float at = lane_numbers() + (static_cast<float>(x) + 0.5F);
      const Mask inside = at < Float(static_cast<float>(rows.end[row]));
      const Chords chords = chords_of(splat, slab, at - rows.centre[row], v, inside);
      if (any(chords.inside))
        add_chords(splat, chords, frame.diffuse != 0, slabs, planes, row * TilePixels::row_stride + x);
    }
  }
}

/// Makes means of sums.
HWY_INLINE void divide(const SlabPlanes& p, int at) {
  const Float mass = load(p.mass + at);
  const Float by_mass = only(mass > Float(0.0F), Float(1.0F) / mass);
  for (float* sum : {p.value, p.residual, p.light}) store(load(sum + at) * by_mass, sum + at);
}

/// A slab, and those that touch it.
struct Neighbours {
  const SlabPlanes *before, *slab, *after;  // null: there is none
  float before_thickness, thickness, after_thickness;
};

/// Returns the length of material in a slab.
HWY_INLINE Float length_of(const Neighbours& n, int at) {
  constexpr float least_density = 0.25F;  // of a boundary that counts; at twice of it, it decides
  const SlabPlanes& p = *n.slab;
  const Float thickness(n.thickness), mass = load(p.mass + at);
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
  const Float within = max(fma(max(leaves, enters), between - thickness, thickness), n.thickness * 1e-6F);
  // Inside, the sum of densities only ripples. Where material ends without a boundary, it falls from 1 to 0.
  return only(mass > Float(0.0F), within * clamp(fma(mass / within, 1.5F, -0.25F), 0.0F, 1.0F));
}

/// Half of the difference of the values at a slab's back and front.
HWY_INLINE Float half_range(const Neighbours& n, Float length, int at) {
  const Float value = load(n.slab->value + at);
  const auto step = [&](const SlabPlanes* other, float thickness) HWY_ATTR {
    if (!other) return Float(0.0F);
    const float share = n.thickness / (n.thickness + thickness);
    return only(load(other->mass + at) > Float(0.0F), (load(other->value + at) - value) * share);
  };
  const Float to_front = step(n.before, n.before_thickness), to_back = step(n.after, n.after_thickness);
  // Without one of the neighbours, the value goes on as towards the other one.
  const Mask whole = both(abs(to_front) > Float(0.0F), abs(to_back) > Float(0.0F));
  return (to_back - to_front) * select(whole, 0.5F, length * (1.0F / n.thickness));
}

void classify(const FrameConstants& frame, const TileArea& area, const Neighbours& n, TilePixels& pixels) {
  constexpr float residual_share = 0.25F;  // what splats mixed do not tell of each other's residual
  const float by_focal = frame.orthographic ? 0.0F : 1.0F / frame.focal;
  for (int row = 0; row < area.height; ++row) {
    const float tangent_y = (static_cast<float>(area.bottom + row) + 0.5F - 0.5F * frame.height) * by_focal;
    for (int x = 0; x < area.width; x += lane_count()) {
      const int at = row * TilePixels::row_stride + x;
      const Float length = length_of(n, at);
      const Mask filled = length > Float(0.0F);
      if (!any(filled)) continue;
      const Float half = half_range(n, length, at);
      const Float spread = sqrt(fma(half * half, 1.0F / 3, load(n.slab->residual + at) * residual_share));
      const TableRow table = table_row(frame.table, spread);
      const Float column =
          fma(load(n.slab->value + at) - 0.5F, table.columns, 0.5F * static_cast<float>(frame.table.columns - 1));
      const Material material = look_up_rows(frame.table, max(table.row, Int(0)), column, filled);
      const float centre = static_cast<float>(x + area.left) + 0.5F - 0.5F * frame.width;
      const Float tangent_x = (lane_numbers() + centre) * by_focal;
      const Float ray = sqrt(fma(tangent_x, tangent_x, tangent_y * tangent_y + 1.0F));
      const Float depth = length * ray * material.extinction;
      const Mask sound = both(filled, is_finite(depth));
      const Float light = frame.diffuse != 0 ? load(n.slab->light + at) : Float(frame.ambient);
      blend(only(sound, opacity(max(depth, 0.0F))), select(sound, light, 0.0F), material, pixels.values.data() + at);
    }
  }
}

constexpr std::size_t slabs_at_once = 8;

/// Sums of what is at a depth: optical depths, and optical depths over chords.
struct Crowd {
  double weight = 0, by_chord = 0;

  void add(const SlabSplat& splat, double sign) {
    weight += sign * splat.weight;
    by_chord += sign * splat.weight / splat.chord;
  }
};

/// Cuts the depths of a tile into slabs. A slab is half as thick as chords are long: the harmonic mean of those at its
/// front, weighted by their optical depths.
void make_slabs(const ScreenSplats& screen, std::span<const std::uint32_t> slots, const Slab& depths,
                SlabWorkspace& work) {
  constexpr double chords_thick = 0.5, least_thickness = 1e-5;  // the latter as a share of the depth
  work.fronts.clear();
  work.backs.clear();
  for (const std::uint32_t slot : slots) {
    work.fronts.push_back({screen.slab[slot].front, slot});
    work.backs.push_back({screen.slab[slot].back, slot});
  }
  std::ranges::sort(work.fronts);
  std::ranges::sort(work.backs);
  work.slabs.clear();
  std::size_t entered = 0, left = 0;
  Crowd crowd;
  float depth = std::max(work.fronts[0].depth, depths.front);
  while (depth < depths.back) {
    for (; entered < slots.size() && work.fronts[entered].depth <= depth; ++entered)
      crowd.add(screen.slab[work.fronts[entered].slot], 1);
    for (; left < entered && work.backs[left].depth <= depth; ++left) crowd.add(screen.slab[work.backs[left].slot], -1);
    if (left == entered) {
      if (entered == slots.size()) return;
      crowd = {};
      depth = work.fronts[entered].depth;
      continue;
    }
    const double thickness = std::max(chords_thick * crowd.weight / crowd.by_chord, least_thickness * depth);
    const float back = std::min(static_cast<float>(depth + thickness), depths.back);
    if (!(back > depth)) return;
    work.slabs.push_back({depth, back});
    depth = back;
  }
}

/// The slabs of a tile, one after the other. Planes of those that are at work lie in a ring.
class SlabSequence {
 public:
  SlabSequence(const FrameConstants& frame, const ScreenSplats& screen, const TileArea& area, SlabWorkspace& work)
      : frame_(frame), screen_(screen), area_(area), work_(work), slabs_(work.slabs) {
    constexpr std::size_t numbers_each = std::size_t{SlabPlanes::count} * plane + TilePixels::row_stride;
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
    std::array<SlabPlanes, slabs_at_once> planes;
    for (std::size_t i = first; i < end; ++i) {
      planes[i - first] = planes_of(i);
      std::fill_n(planes_of(i).mass, SlabPlanes::count * plane, 0.0F);
    }
    const std::span<const Slab> slabs = slabs_.subspan(first, end - first);
    for (; entered_ < work_.fronts.size() && work_.fronts[entered_].depth < slabs.back().back; ++entered_)
      work_.active.push_back(work_.fronts[entered_].slot);
    std::erase_if(work_.active, [&](std::uint32_t slot) { return slab_of(slot).back <= slabs.front().front; });
    for (std::size_t i = 0; i < work_.active.size(); ++i) {
      constexpr std::size_t ahead = 4;
      if (i + ahead < work_.active.size()) prefetch(work_.active[i + ahead]);
      const std::uint32_t slot = work_.active[i];
      const SlabSplat& splat = slab_of(slot);
      std::size_t begin = 0, back = slabs.size();
      while (slabs[begin].back <= splat.front) ++begin;
      while (slabs[back - 1].front >= splat.back) --back;
      gather(frame_, screen_.near[slot], splat, area_, part_of(screen_.bounds[slot], area_),
             slabs.subspan(begin, back - begin), std::span(planes).subspan(begin, back - begin));
    }
    for (std::size_t i = first; i < end; ++i)
      for (int row = 0; row < area_.height; ++row)
        for (int x = 0; x < area_.width; x += lane_count()) divide(planes_of(i), row * TilePixels::row_stride + x);
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
    classify(frame_, area_, n, pixels);
  }

  /// Splats of a tile are far apart in memory.
  void prefetch(std::uint32_t slot) const {
    hwy::Prefetch(&screen_.slab[slot]);
    hwy::Prefetch(&screen_.bounds[slot]);
    for (std::size_t byte = 0; byte < sizeof(NearSplat); byte += 64)
      hwy::Prefetch(reinterpret_cast<const char*>(&screen_.near[slot]) + byte);
  }
  [[nodiscard]] const SlabSplat& slab_of(std::uint32_t slot) const { return screen_.slab[slot]; }

  const FrameConstants& frame_;
  const ScreenSplats& screen_;
  const TileArea& area_;
  SlabWorkspace& work_;
  std::span<const Slab> slabs_;
  std::array<SlabPlanes, slabs_at_once + 2> ring_;
  std::size_t entered_ = 0;
};

bool blend_in_slabs(const FrameConstants& frame, const ScreenSplats& screen, std::span<const std::uint32_t> slots,
                    const Slab& depths, const TileArea& area, SlabWorkspace& work, TilePixels& pixels) {
  make_slabs(screen, slots, depths, work);
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
