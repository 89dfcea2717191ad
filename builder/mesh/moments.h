// Splat moments: mass, mean and covariance, in space and value, of the material that each point stands for.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/mesh/index_lists.h"
#include "format/columns.h"

namespace splatvol {

/// A symmetric 3x3 matrix.
struct SymmetricMatrix {
  double xx = 0, yy = 0, zz = 0, xy = 0, xz = 0, yz = 0;
};

/// The material of a point or cluster in space. Lengths are relative to the point, so that nothing is lost far from the
/// origin.
struct SpatialMoments {
  double mass = 0;             // volume
  dvec3 centroid{0};           // less the point's position; 0 without mass
  SymmetricMatrix covariance;  // about the centroid
};

/// The part of the material that has a value of an attribute.
struct ValueMoments {
  double mass = 0;
  dvec3 centroid{0};                                     // of this part, less the point's position
  double mean = 0;                                       // of the value
  double variance = 0;                                   // of the value
  dvec3 covariance{0};                                   // of position and value
  double min = std::numeric_limits<double>::infinity();  // range of the value
  double max = -std::numeric_limits<double>::infinity();
};

using Tetrahedron = std::array<std::uint32_t, 4>;

/// The first place of a vertex among the corners. Has no branches, which the processor could not foresee.
inline std::size_t place_of(std::uint32_t vertex, const Tetrahedron& corners) {
  std::size_t place = 3;
  for (const std::size_t k : {2u, 1u, 0u}) place = corners[k] == vertex ? k : place;
  return place;
}

/// Adds weight * d d^T to `sum`.
inline void add_square(SymmetricMatrix& sum, double weight, const dvec3& d) {
  sum.xx += weight * d.x * d.x, sum.yy += weight * d.y * d.y, sum.zz += weight * d.z * d.z;
  sum.xy += weight * d.x * d.y, sum.xz += weight * d.x * d.z, sum.yz += weight * d.y * d.z;
}

/// Adds b to a, whose materials must be disjoint. `shift` is the position of b's point less that of a's. Exact up to
/// rounding, in any order.
void merge(SpatialMoments& a, const SpatialMoments& b, const dvec3& shift);
void merge(ValueMoments& a, const ValueMoments& b, const dvec3& shift);

/// Lists the tetrahedra at each point by their numbers, ascending; twice if a tetrahedron names the point twice.
[[nodiscard]] IndexLists tetrahedra_at_points(std::size_t points, std::span<const Tetrahedron> tetrahedra);

/// The material of a vertex that has a value of an attribute, and the direction of the value's gradient there.
struct VertexValue {
  ValueMoments moments;
  dvec3 gradient{0};  // of any length
};

/// Values of several attributes at the vertices of a mesh.
class ValueTable {
 public:
  ValueTable() = default;
  ValueTable(std::size_t vertices, std::size_t attributes) { resize(vertices, attributes); }

  /// Keeps the memory, and no values.
  void resize(std::size_t vertices, std::size_t attributes) {
    vertices_ = vertices;
    attributes_ = attributes;
    values_.resize(vertices * attributes);
  }

  [[nodiscard]] std::size_t attributes() const { return attributes_; }

  /// The values of an attribute: [vertex].
  [[nodiscard]] std::span<double> column(std::size_t attribute) {
    return std::span(values_).subspan(attribute * vertices_, vertices_);
  }
  [[nodiscard]] std::span<const double> column(std::size_t attribute) const {
    return std::span(values_).subspan(attribute * vertices_, vertices_);
  }

 private:
  std::size_t vertices_ = 0, attributes_ = 0;
  std::vector<double> values_;
};

/// Some vertices of a mesh, and the corners of all tetrahedra at them, numbered anew: the vertices whose values decide
/// on the material of the block. Keeps its memory for the next block: a number for each vertex of the mesh, too.
class VertexBlock {
 public:
  /// [new number]: a vertex of the mesh. Those of the block come first, in their order.
  [[nodiscard]] std::span<const std::uint32_t> vertices() const { return vertices_; }

  /// Gets the number of a vertex, the moments of all its material, and its value of each attribute.
  using VisitVertex =
      std::function<void(std::size_t number, const SpatialMoments& space, std::span<const VertexValue> values)>;

  /// Finds the material of each vertex of the block, and of all attributes. `table`: values at vertices(). A
  /// tetrahedron with a missing value (NaN) at a corner has no value. With `gradients`, finds their directions as in
  /// Meredith and Ma (2001), section 3.2: the sum of one-sided differences along edges. An edge counts once for each of
  /// its tetrahedra, so that pieces of a mesh add up to the whole. 0 if there is none. A vertex does not depend on the
  /// others.
  void find_values(const ValueTable& table, bool gradients, const VisitVertex& visit) const;

 private:
  friend class VertexMaterial;

  // The part of a tetrahedron that a vertex of the block owns.
  struct Quarter {
    std::array<std::uint32_t, 3> others;  // new numbers: of the tetrahedron's other corners
    double mass;
  };

  void clear(std::size_t mesh_vertices);
  std::uint32_t number_of(std::uint32_t vertex, std::span<const dvec3> positions);

  std::vector<std::uint32_t> vertices_;
  std::vector<dvec3> positions_;        // [new number]
  std::vector<double> masses_;          // [vertex of the block]: of its quarters
  std::vector<std::size_t> begins_;     // [vertex of the block]: its quarters; then their end
  std::vector<Quarter> quarters_;       // of the vertices of the block, in the order of their tetrahedra
  std::vector<std::uint32_t> numbers_;  // [vertex of the mesh]: 1 + new number; 0: not in the block
};

/// The material of each vertex of a mesh, in closed form. A vertex owns the quarter of each of its tetrahedra where its
/// barycentric coordinate is the largest. Values are linear in each tetrahedron, volumes absolute. A tetrahedron that
/// is flat, or too large for double precision, adds nothing. Both spans must outlive this; fewer than 2^32 tetrahedra.
/// Thread-safe.
class VertexMaterial {
 public:
  VertexMaterial() = default;
  VertexMaterial(std::span<const dvec3> positions, std::span<const Tetrahedron> tetrahedra);

  /// Makes `block` that of these vertices, which must differ.
  void make_block(std::span<const std::uint32_t> vertices, VertexBlock& block) const;

  /// Calls visit(vertex - begin, ...) for vertices from `begin` to before `end`, as VertexBlock::find_values. `values`:
  /// [attribute][vertex]. `block` is scratch.
  void find_values(std::size_t begin, std::size_t end, std::span<const std::vector<double>> values, bool gradients,
                   VertexBlock& block, const VertexBlock::VisitVertex& visit) const;

  /// The tetrahedra at each vertex: tetrahedra_at_points.
  [[nodiscard]] const IndexLists& incident() const { return incident_; }

  /// Bytes that it holds for a mesh.
  [[nodiscard]] static std::size_t bytes(std::size_t vertices, std::size_t tetrahedra) {
    return 8 * vertices + 24 * tetrahedra;
  }

 private:
  std::span<const dvec3> positions_;
  std::span<const Tetrahedron> tetrahedra_;
  IndexLists incident_;         // [vertex]: tetrahedra
  std::vector<double> masses_;  // [tetrahedron]: of a quarter
};

/// Returns mass and principal axes as the file stores them. The squares of the deviations are exact to a few units of
/// rounding of the largest square.
[[nodiscard]] SplatShape shape_of(const SpatialMoments& moments);

/// Finds the shapes of up to `shapes_at_once` moments, in a third of the time that they take one by one. Leaves further
/// elements of `shapes` as they are.
inline constexpr std::size_t shapes_at_once = 4;
void find_shapes(std::span<const SpatialMoments* const> moments, std::array<SplatShape, shapes_at_once>& shapes);

/// Returns a value's distribution as the file stores it, except that the mean still contains the attribute's offset.
/// `shape` belongs to all the material that `value` is a part of. Correlations, residual and coverage never exceed 1,
/// however thin the material is.
[[nodiscard]] inline SplatValue value_of(const ValueMoments& value, const SplatShape& shape) {
  if (!(value.mass > 0)) return {};
  SplatValue result{.mean = value.mean, .deviation = std::sqrt(std::max(0.0, value.variance))};
  const dmat3 axes = glm::mat3_cast(shape.orientation);
  const auto correlation = [&](const dvec3& axis, double deviation) {
    const double largest = result.deviation * deviation;
    return largest > 0 ? std::clamp(glm::dot(axis, value.covariance) / largest, -1.0, 1.0) : 0;
  };
  const double x = correlation(axes[0], shape.deviations.x);
  const double y = correlation(axes[1], shape.deviations.y);
  const double z = correlation(axes[2], shape.deviations.z);
  result.correlation = {x, y, z};
  result.residual = std::sqrt(std::max(0.0, 1 - (x * x + y * y + z * z)));
  result.coverage = std::min(1.0, value.mass / shape.mass);
  return result;
}

}  // namespace splatvol
