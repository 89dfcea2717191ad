// The border of the material: the outer faces of a mesh, and a boundary plane for each point on them.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/mesh/moments.h"
#include "format/columns.h"

namespace splatvol {

/// A face of one tetrahedron only.
struct OuterFace {
  std::array<std::uint64_t, 3> corners;  // points, counterclockwise from outside
  bool has_side;                         // false: the tetrahedron is flat, and its outside is not known
  std::uint32_t tetrahedron;             // the one that has it
};

/// Finds the outer faces of a mesh: the faces that only one tetrahedron has. The tetrahedron's fourth corner lies
/// inside; for a flat tetrahedron its neighbours decide. A tetrahedron that names a corner twice has no faces. Requires
/// indices in range, fewer than 2^32 tetrahedra. The order does not depend on the number of threads.
[[nodiscard]] std::vector<OuterFace> find_outer_faces(std::span<const dvec3> positions,
                                                      std::span<const Tetrahedron> tetrahedra);

/// The same, in less time. `incident`: tetrahedra_at_points.
[[nodiscard]] std::vector<OuterFace> find_outer_faces(std::span<const dvec3> positions,
                                                      std::span<const Tetrahedron> tetrahedra,
                                                      const IndexLists& incident);

/// A plane through part of the boundary.
struct BoundaryPlane {
  dvec3 area{0};      // outward normal; its length is the area that the plane stands for. 0: no plane
  double offset = 0;  // dot(area, p), where p is a position on the plane less the point's position
};

/// Returns the boundary plane of each point. The faces at a point form groups that turn the same way; the group with
/// the largest area gives the plane. Each face counts with a third of its area. Faces do not count without a side, or
/// if their area is 0 or too large for double precision. Does not depend on the number of threads.
[[nodiscard]] std::vector<BoundaryPlane> boundary_planes(std::span<const dvec3> positions,
                                                         std::span<const OuterFace> faces);

/// Returns the boundary plane of a cluster: groups its members' planes as above. The plane runs through the mean of the
/// planes in the largest group. `shifts[m]` is the position of member m less the cluster's. Requires spans of one
/// length. Thread-safe.
[[nodiscard]] BoundaryPlane merge_planes(std::span<const BoundaryPlane> members, std::span<const dvec3> shifts);

/// Returns a plane as it is drawn (SplatShape::boundary). In a space where the covariance is the identity, this
/// is the foot of the perpendicular from the centroid on the plane, in deviations along the principal axes. Its length
/// is below 4. `shape` is the shape of `moments`. Returns 0 without a plane, and if the material does not look like one
/// half of a body that the plane mirrors: if it lies on both sides, or tapers off towards the plane. Thread-safe.
[[nodiscard]] dvec3 boundary_foot(const BoundaryPlane& plane, const SpatialMoments& moments, const SplatShape& shape);

}  // namespace splatvol
