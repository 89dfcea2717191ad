// A point on its way through the resolutions.
#pragma once

#include <cstdint>
#include <vector>

#include "builder/mesh/boundary.h"
#include "builder/mesh/moments.h"
#include "builder/output/splat_rows.h"
#include "builder/sorting/morton.h"

namespace splatvol {

/// Resolutions are counted from the finest here, in levels: level 0 has all points. How many there are shows at the
/// end.
inline constexpr std::size_t max_levels = 64;

/// An attribute of a member.
struct MemberValue {
  float value = 0;       // of the point, as the file stores it
  vec3 gradient{0};      // unit vector, or 0
  ValueMoments moments;  // of the cluster
};

/// A point that stays for a coarser level, with the material of its cluster there.
struct Member {
  MortonKey key;
  std::uint64_t leaf = 0;  // of the index, by number
  PlacedPoint point;
  SpatialMoments moments;  // about the point
  BoundaryPlane plane;
  std::vector<MemberValue> values;   // [attribute]
  std::vector<SplatRow> splats;      // [level], up to the present one
  std::vector<ValueRow> value_rows;  // [level * attributes + attribute]

  /// Leaves no material and no splats, and values as many as there were.
  void clear();

  /// Fetches it into the cache, and once it is there, what its vectors hold and get next. Members are made on other
  /// processors, and come in no order that these foresee.
  void prefetch() const;
  void prefetch_vectors() const;
};

}  // namespace splatvol
