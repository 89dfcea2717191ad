// Tetrahedra between points that are named by their ranks.
#pragma once

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
  if (least_height(a, b, c, d) == 0) return 0;
  return signed_volume_6(a, b, c, d) > 0 ? 1 : -1;
}

}  // namespace splatvol
