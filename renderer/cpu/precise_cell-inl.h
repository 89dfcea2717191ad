// Rays in precise cells: in double precision. Included once for each instruction set.
#if defined(SPLATVOL_RENDERER_CPU_PRECISE_CELL_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATVOL_RENDERER_CPU_PRECISE_CELL_INL_H
#undef SPLATVOL_RENDERER_CPU_PRECISE_CELL_INL_H
#else
#define SPLATVOL_RENDERER_CPU_PRECISE_CELL_INL_H
#endif

#include <array>
#include <cstddef>
#include <cstdint>

#include "renderer/cpu/cell_frame.h"
#include "renderer/cpu/vector-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatvol::tiles::HWY_NAMESPACE {

using DoubleTag = hn::Repartition<double, FloatTag>;
using DoubleMask = hn::Mask<DoubleTag>;

/// Numbers of double precision, one in each lane: half as many as of single precision.
struct Double {
  hn::Vec<DoubleTag> v;

  Double() = default;
  HWY_INLINE Double(hn::Vec<DoubleTag> vector) : v(vector) {}            // NOLINT(google-explicit-constructor)
  HWY_INLINE Double(double number) : v(hn::Set(DoubleTag(), number)) {}  // NOLINT(google-explicit-constructor)
};

HWY_INLINE Double operator+(Double a, Double b) { return hn::Add(a.v, b.v); }
HWY_INLINE Double operator-(Double a, Double b) { return hn::Sub(a.v, b.v); }
HWY_INLINE Double operator*(Double a, Double b) { return hn::Mul(a.v, b.v); }
HWY_INLINE Double operator/(Double a, Double b) { return hn::Div(a.v, b.v); }
HWY_INLINE DoubleMask operator>(Double a, Double b) { return hn::Gt(a.v, b.v); }
HWY_INLINE DoubleMask is_zero(Double a) { return hn::Eq(a.v, hn::Zero(DoubleTag())); }
HWY_INLINE Double fma(Double a, Double b, Double c) { return hn::MulAdd(a.v, b.v, c.v); }
HWY_INLINE Double select(DoubleMask mask, Double yes, Double no) { return hn::IfThenElse(mask, yes.v, no.v); }
HWY_INLINE bool any_lane(DoubleMask mask) { return !hn::AllFalse(DoubleTag(), mask); }
HWY_INLINE Double load_double(const float* numbers) {
  return hn::PromoteTo(DoubleTag(), hn::LoadU(hn::Rebind<float, DoubleTag>(), numbers));
}
HWY_INLINE void store(Double a, float* numbers) {
  const hn::Rebind<float, DoubleTag> tag;
  hn::StoreU(hn::DemoteTo(tag, a.v), tag, numbers);
}

/// The ways of rays through a precise cell.
struct alignas(64) PreciseWays {
  using Lanes = std::array<float, most_lanes>;
  struct End {
    Lanes d, z, u, o;
    Lanes face;  // its number in face_corners; 4: the eye's plane
  };
  End enter, leave;
  Lanes length;  // as a difference of depths
};

/// Finds where rays enter and leave a precise cell, as CellCrosser (renderer/reference/cell.h) does for one ray: rays
/// are not moved. Corners are offsets (u, w) from the ray at their depths. The ray's sides of the edges, u_i w_j - u_j
/// w_i, depend on the edge alone, so all cells round it agree. The ray meets a face if the sides of its edges agree.
/// They are also the weights of the corners there: so depth and value stay within those of the face.
class PreciseRays {
 public:
  /// `origin`: of the chunk's depths.
  PreciseRays(const CellFrame& frame, const DepthOrigin& origin, const PreciseCell& cell)
      : frame_(frame), origin_(origin), cell_(cell) {}

  /// Sets the lanes of rays that are in the cell, and returns which they are. Others may have any number.
  template <bool orthographic>
  HWY_INLINE Mask find(Float x, Float y, PreciseWays& ways) const {
    PreciseWays::Lanes xs, ys;
    store(x, xs.data());
    store(y, ys.data());
    std::uint32_t hits = 0;
    const auto lanes = static_cast<std::size_t>(hn::Lanes(DoubleTag()));
    for (std::size_t first = 0; first < static_cast<std::size_t>(lane_count()); first += lanes)
      hits |= find_some<orthographic>(load_double(&xs[first]), load_double(&ys[first]), first, ways) << first;
    return hn::Not(is_zero(Int(static_cast<std::int32_t>(hits)) & Int(hn::Shl(Int(1).v, lane_indices().v))));
  }

 private:
  static constexpr std::array<std::array<std::size_t, 2>, 6> edges = {{{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}}};
  /// Edges ab, ac and bc of the faces in face_corners.
  static constexpr std::array<std::array<std::size_t, 3>, 4> face_edges = {
      {{0, 1, 3}, {0, 2, 4}, {1, 2, 5}, {3, 4, 5}}};

  struct Corner {
    Double u, w, zeta;  // zeta: the depth; 1 in orthographic projection
  };
  struct Sides {
    std::array<Double, 6> size;
    std::array<DoubleMask, 6> is_above;
  };
  /// A place on a face. `depth`: less that of corner 0. Before finish(), all but `face` are sums over the corners, and
  /// `weight` is that of the weights.
  struct Place {
    Double depth, value, other, weight, face;
  };

  HWY_INLINE static Place choose(DoubleMask mask, const Place& yes, const Place& no) {
    return {select(mask, yes.depth, no.depth), select(mask, yes.value, no.value), select(mask, yes.other, no.other),
            select(mask, yes.weight, no.weight), select(mask, yes.face, no.face)};
  }

  // The side of an edge for rays that meet its line: an infinitely small turn of the ray decides, to the right before
  // upwards, then an infinitely small move of the eye.
  template <bool orthographic>
  HWY_NOINLINE static Double side_of_turned(const Corner& i, const Corner& j) {
    Double side = i.w * j.zeta - j.w * i.zeta;
    side = select(is_zero(side), i.zeta * j.u - j.zeta * i.u, side);
    if (orthographic) return side;
    side = select(is_zero(side), i.w - j.w, side);
    side = select(is_zero(side), j.u - i.u, side);
    return select(is_zero(side), i.zeta - j.zeta, side);
  }

  template <bool orthographic>
  HWY_INLINE Sides find_sides(Double x, Double y) const {
    const Double focal(frame_.view->focal), a = x / focal, b = y / focal;
    std::array<Corner, 4> corners;
    for (std::size_t k = 0; k < 4; ++k) {
      const dvec3& corner = cell_.corners[k];
      const Double zeta(orthographic ? 1.0 : corner.z);
      corners[k] = {Double(corner.x) - a * zeta, Double(corner.y) - b * zeta, zeta};
    }
    Sides sides;
    for (std::size_t k = 0; k < 6; ++k) {
      const Corner &i = corners[edges[k][0]], &j = corners[edges[k][1]];
      sides.size[k] = i.u * j.w - j.u * i.w;
      sides.is_above[k] = sides.size[k] > Double(0.0);
      const DoubleMask on_line = is_zero(sides.size[k]);
      if (any_lane(on_line))
        sides.is_above[k] =
            hn::Or(sides.is_above[k], hn::And(on_line, side_of_turned<orthographic>(i, j) > Double(0.0)));
    }
    return sides;
  }

  HWY_INLINE Place place_on(std::size_t face, const Sides& sides) const {
    const auto [a, b, c, opposite] = face_corners[face];
    const auto [ab, ac, bc] = face_edges[face];
    const Double of_a = sides.size[bc], of_b = Double(0.0) - sides.size[ac], of_c = sides.size[ab];
    const auto weighted = [&](double at_a, double at_b, double at_c)
                              HWY_ATTR { return fma(of_a, at_a, fma(of_b, at_b, of_c * Double(at_c))); };
    const double z = cell_.corners[0].z;
    Place place;
    place.depth = weighted(cell_.corners[a].z - z, cell_.corners[b].z - z, cell_.corners[c].z - z);
    place.value = weighted(cell_.u[a], cell_.u[b], cell_.u[c]);
    place.other = frame_.opacity ? weighted(cell_.o[a], cell_.o[b], cell_.o[c]) : Double(0.0);
    place.weight = of_a + of_b + of_c;
    place.face = Double(static_cast<double>(face));
    return place;
  }

  HWY_INLINE void finish(Place& place) const {
    const Double inverse = Double(1.0) / place.weight;
    const DoubleMask in_plane = is_zero(place.weight);
    place.depth = place.depth * inverse, place.value = place.value * inverse, place.other = place.other * inverse;
    if (!any_lane(in_plane)) return;
    // Rays in the face's plane meet it where the eye is, from which all of them come.
    const Place at_eye{-cell_.corners[0].z, cell_.u[0], cell_.o[0], 1.0, place.face};
    place = choose(in_plane, at_eye, place);
  }

  // What lies behind the eye does not count.
  HWY_INLINE Place in_front(const Place& enter, const Place& leave) const {
    const Double nearest(frame_.nearest - cell_.corners[0].z);
    const Double share = (nearest - enter.depth) / (leave.depth - enter.depth);
    const auto mix = [&](Double from, Double to) HWY_ATTR { return fma(to - from, share, from); };
    return choose(nearest > enter.depth,
                  {nearest, mix(enter.value, leave.value), mix(enter.other, leave.other), enter.weight, Double(4.0)},
                  enter);
  }

  template <bool orthographic>
  HWY_INLINE std::uint32_t find_some(Double x, Double y, std::size_t first, PreciseWays& ways) const {
    const Sides sides = find_sides<orthographic>(x, y);
    std::array<DoubleMask, 4> met;
    for (std::size_t face = 0; face < 4; ++face) {
      const auto [ab, ac, bc] = face_edges[face];
      met[face] =
          hn::AndNot(hn::Xor(sides.is_above[ab], sides.is_above[bc]), hn::Xor(sides.is_above[ab], sides.is_above[ac]));
    }
    if (!any_lane(hn::Or(hn::Or(met[0], met[1]), hn::Or(met[2], met[3])))) return 0;

    // Rays meet two faces or none. Of the first and the last that they meet, the nearer one is where they enter.
    Place begin{0.0, 0.0, 0.0, 1.0, 0.0}, last = begin;
    DoubleMask is_met = hn::FirstN(DoubleTag(), 0);
    for (std::size_t face = 0; face < 4; ++face) {
      if (!any_lane(met[face])) continue;
      const Place place = place_on(face, sides);
      begin = choose(is_met, begin, place);
      last = choose(met[face], place, last);
      is_met = hn::Or(is_met, met[face]);
    }
    finish(begin);
    finish(last);
    const DoubleMask turned = begin.depth > last.depth;
    Place enter = choose(turned, last, begin);
    const Place leave = choose(turned, begin, last);
    if (cell_.is_behind) enter = in_front(enter, leave);
    const Double length = leave.depth - enter.depth;
    const DoubleMask hit = hn::And(is_met, length > Double(0.0));
    if (!any_lane(hit)) return 0;

    const Double w = fma(x - origin_.at_x, origin_.wx, fma(y - origin_.at_y, origin_.wy, origin_.w));
    const auto put = [&](const Place& place, PreciseWays::End& end) HWY_ATTR {
      const Double z = place.depth + cell_.corners[0].z;
      store((orthographic ? Double(0.0) - z : Double(1.0) / z) - w, &end.d[first]);
      store(orthographic ? Double(1.0) : z, &end.z[first]);
      store(place.value, &end.u[first]);
      store(place.other, &end.o[first]);
      store(place.face, &end.face[first]);
    };
    put(enter, ways.enter);
    put(leave, ways.leave);
    store(length, &ways.length[first]);
    std::array<std::uint8_t, 8> bytes{};
    hn::StoreMaskBits(DoubleTag(), hit, bytes.data());
    return bytes[0];
  }

  const CellFrame& frame_;
  const DepthOrigin& origin_;
  const PreciseCell& cell_;
};

}  // namespace splatvol::tiles::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
