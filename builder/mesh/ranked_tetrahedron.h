// Tetrahedra between points that are named by their ranks.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>

#include "base/error.h"
#include "base/math.h"
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

/// Returns the sign of a tetrahedron's volume.
[[nodiscard]] inline std::int8_t sign_of_volume(dvec3 a, dvec3 b, dvec3 c, dvec3 d) {
  const double volume = signed_volume_6(a, b, c, d);
  return static_cast<std::int8_t>(volume > 0 ? 1 : volume < 0 ? -1 : 0);
}

}  // namespace splatvol
