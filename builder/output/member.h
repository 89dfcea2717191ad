// A point on its way through the resolutions.
#pragma once

#include <cstdint>
#include <vector>

#include "builder/mesh/boundary.h"
#include "builder/mesh/moments.h"
#include "builder/output/stored_splat.h"
#include "builder/sorting/morton.h"

namespace splatvol {

/// Most resolutions. Here they are counted from the finest, in levels: level 0 has all points. The number of levels is
/// known at the end.
inline constexpr std::size_t max_levels = 64;

struct MemberValue {
  float value = 0;       // of the point, as the file stores it
  ValueMoments moments;  // of the cluster
};

/// A point that stays for a coarser level, with the material of its cluster there.
struct Member {
  MortonKey key;
  std::uint64_t leaf = 0;  // number of its index leaf
  PointPosition point;
  SpatialMoments moments;  // about the point
  BoundaryPlane plane;
  std::vector<MemberValue> values;         // [attribute]
  std::vector<vec3> gradients;             // [attribute]: unit vector, or 0. Empty if not wanted
  std::vector<StoredSplat> splats;         // [level], up to the present one
  std::vector<StoredValue> stored_values;  // [level * attributes + attribute]

  /// Removes material and splats, and keeps the number of attributes.
  void clear();

  /// Fetches the member into the cache: members are made on other processors, and come in an order that no processor
  /// foresees.
  void prefetch() const;

  /// Fetches the elements of the vectors, and the memory of the next ones. Of use once the member itself is in the
  /// cache.
  void prefetch_vectors() const;
};

}  // namespace splatvol
