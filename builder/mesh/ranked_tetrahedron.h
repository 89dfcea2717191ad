// Tetrahedra between points that are named by their ranks.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <span>

#include "base/error.h"
#include "base/math.h"
#include "builder/mesh/heights.h"
#include "builder/mesh/tetrahedra.h"

namespace splatvol {

/// A tetrahedron. A rank is the number of a point among all points in Morton order.
struct RankedTetrahedron {
  std::array<std::uint64_t, 4> corners = {};  // ascending ranks
  std::int8_t sign = 0;                       // of its volume, before positions are rounded

  friend bool operator==(const RankedTetrahedron&, const RankedTetrahedron&) = default;
};

/// Gets tetrahedra, each once, in any order.
using TakeTetrahedra = std::function<Status(std::span<const RankedTetrahedron>)>;

/// Returns the sign of a tetrahedron's volume; 0 if it is flat (least_height).
[[nodiscard]] inline std::int8_t sign_of_volume(dvec3 a, dvec3 b, dvec3 c, dvec3 d) {
  // No edge is longer than twice the longest one from `a`. Most tetrahedra are so high that this tells.
  const double volume_6 = signed_volume_6(a, b, c, d);
  const double squared = std::max({glm::dot(b - a, b - a), glm::dot(c - a, c - a), glm::dot(d - a, d - a)});
  constexpr double least = 16 * flat_height, in_range = 1e-200;
  const double enough = least * least * squared * squared * squared;
  if (!(enough > in_range && volume_6 * volume_6 > enough) && least_height(a, b, c, d) == 0) return 0;
  return volume_6 > 0 ? 1 : -1;
}

}  // namespace splatvol
