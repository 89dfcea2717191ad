// Tubes round lines, as triangles.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "base/math.h"
#include "base/triangle_mesh.h"

namespace splatvol {

/// Triangles with a value at each point; none without values of lines.
struct TubeMesh {
  TriangleMesh mesh;
  std::vector<double> values;  // [point of the mesh]
};

/// Returns the rows that are left of a line: the first, the last, and enough between them. No other row is farther than
/// `distance` from the line through these, and no value by more than `difference` from that between theirs. `values`:
/// one for each row, or none.
[[nodiscard]] std::vector<std::size_t> thinned(std::span<const dvec3> positions, std::span<const double> values,
                                               double distance, double difference);

/// Returns how many points the tube round some rows of a line has. Twice as many triangles are more than it has.
[[nodiscard]] std::size_t tube_points(std::span<const dvec3> positions, std::span<const std::size_t> rows);

/// Adds a closed tube round some rows of a line. Fails without room: a mesh has fewer than 2^32 points.
[[nodiscard]] Status add_tube(std::span<const dvec3> positions, std::span<const double> values,
                              std::span<const std::size_t> rows, double radius, TubeMesh& tubes);

}  // namespace splatvol
