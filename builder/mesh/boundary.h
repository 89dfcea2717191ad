// Where the material ends: the outer faces of a mesh, and a plane of them for each splat that borders on one.
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
  bool has_side;                         // false: the tetrahedron is flat, and which side is outside not known
};

/// Outer faces of a mesh: those that no other tetrahedron has as well, by the indices of their corners. Outside is
/// where the tetrahedron's fourth corner is not; for a flat tetrahedron it follows from its neighbours. A tetrahedron
/// that names a corner twice has no faces. Requires indices in range, fewer than 2^32 tetrahedra. The order does not
/// depend on the number of threads.
[[nodiscard]] std::vector<OuterFace> find_outer_faces(std::span<const dvec3> positions,
                                                      std::span<const Tetrahedron> tetrahedra);

/// Renumbers the corners of all pieces' outer faces, point i to places[i], and drops the faces that then coincide, for
/// they are inside, and those that name a corner twice. The result is in an order of its own.
void join_outer_faces(std::vector<OuterFace>& faces, std::span<const std::uint64_t> places);

/// A plane through part of the boundary.
struct BoundaryPlane {
  dvec3 area{0};      // vector: outwards, of the length of the area that it stands for; 0: no plane
  double offset = 0;  // area . (a place on the plane less the point's position)
};

/// For each point the plane of the faces at it that turn the same way, a third of each face's area: of all such groups
/// the one with the largest. Faces without a side, or whose area is nothing or too large for double precision, do not
/// count. Does not depend on the number of threads.
[[nodiscard]] std::vector<BoundaryPlane> boundary_planes(std::span<const dvec3> positions,
                                                         std::span<const OuterFace> faces);

/// The plane of a cluster: as above, of its members' planes, and through the mean of their places. `shifts` are the
/// members' points less the cluster's. Requires spans of one length. Thread-safe.
[[nodiscard]] BoundaryPlane merge_planes(std::span<const BoundaryPlane> members, std::span<const dvec3> shifts);

/// What drawing takes of a plane, format::SplatShape::boundary: the foot of the perpendicular from the centroid on the
/// plane where the covariance is the identity, in deviations along the principal axes; under 4. `shape` is of
/// `moments`. 0 where there is no plane, or the material does not look like half of what its reflection completes: it
/// lies on both sides of the plane, or tapers off towards it. Thread-safe.
[[nodiscard]] dvec3 boundary_foot(const BoundaryPlane& plane, const SpatialMoments& moments,
                                  const format::SplatShape& shape);

}  // namespace splatvol
