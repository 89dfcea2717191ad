// Numbers of different vertices, tetrahedra or matrices side by side: the processor waits for their roots and quotients
// only once. A lane does not depend on the others.
#pragma once

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>

#include "base/math.h"
#include "builder/mesh/moments.h"

namespace splatvol {

inline constexpr std::size_t lanes = 4;
using Lanes [[gnu::vector_size(lanes * sizeof(double))]] = double;
using LaneBits [[gnu::vector_size(lanes * sizeof(double))]] = std::int64_t;

inline constexpr LaneBits sign_bit = LaneBits{} + std::numeric_limits<std::int64_t>::min();

inline void take_root(Lanes& x) {
  for (std::size_t l = 0; l < lanes; ++l) x[l] = std::sqrt(x[l]);
}
inline Lanes magnitude(const Lanes& x) { return std::bit_cast<Lanes>(std::bit_cast<LaneBits>(x) & ~sign_bit); }
inline LaneBits is_finite(const Lanes& x) { return x - x == 0; }
inline bool any(const LaneBits& mask) {
  std::int64_t all = 0;
  for (std::size_t l = 0; l < lanes; ++l) all |= mask[l];
  return all != 0;
}

/// Vectors side by side. Operations run in GLM's order, so that results have the same bits.
struct LaneVectors {
  Lanes x, y, z;

  [[nodiscard]] dvec3 operator[](std::size_t lane) const { return {x[lane], y[lane], z[lane]}; }
};

inline LaneVectors operator+(const LaneVectors& a, const LaneVectors& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline LaneVectors operator-(const LaneVectors& a, const LaneVectors& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline LaneVectors operator*(const Lanes& factor, const LaneVectors& a) {
  return {factor * a.x, factor * a.y, factor * a.z};
}
inline Lanes dot(const LaneVectors& a, const LaneVectors& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline LaneVectors cross(const LaneVectors& a, const LaneVectors& b) {
  return {a.y * b.z - b.y * a.z, a.z * b.x - b.z * a.x, a.x * b.y - b.x * a.y};
}

/// Four positions side by side.
inline LaneVectors lanes_of(const dvec3& a, const dvec3& b, const dvec3& c, const dvec3& d) {
  return {Lanes{a.x, b.x, c.x, d.x}, Lanes{a.y, b.y, c.y, d.y}, Lanes{a.z, b.z, c.z, d.z}};
}

/// The corners of four tetrahedra.
struct TetrahedronLanes {
  LaneVectors a, b, c, d;
};

/// Calls visit(t, count, corners) for the tetrahedra from t on, up to four at a time, on several threads. Lanes beyond
/// `count` repeat the last one.
template <class Visit>
void visit_side_by_side(std::span<const dvec3> positions, std::span<const Tetrahedron> tetrahedra, const Visit& visit) {
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, tetrahedra.size(), 4096), [&](const tbb::blocked_range<std::size_t>& range) {
        for (std::size_t t = range.begin(); t < range.end(); t += lanes) {
          const auto of = [&](std::size_t lane) { return tetrahedra[std::min(t + lane, range.end() - 1)]; };
          const Tetrahedron first = of(0), second = of(1), third = of(2), fourth = of(3);
          const auto corner = [&](std::size_t k) {
            return lanes_of(positions[first[k]], positions[second[k]], positions[third[k]], positions[fourth[k]]);
          };
          visit(t, std::min(lanes, range.end() - t), TetrahedronLanes{corner(0), corner(1), corner(2), corner(3)});
        }
      });
}

}  // namespace splatvol
