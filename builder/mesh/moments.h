// Splat moments: mass, mean and covariance, in space and value, of the material that each point stands for.
#pragma once

#include <array>
#include <cstdint>
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

/// Values of several attributes at the vertices of a mesh, four attributes side by side.
class ValueTable {
 public:
  static constexpr std::size_t lanes = 4;
  using Row = std::array<double, lanes>;

  ValueTable() = default;
  ValueTable(std::size_t vertices, std::size_t attributes) { resize(vertices, attributes); }

  /// Keeps the memory, and no values.
  void resize(std::size_t vertices, std::size_t attributes) {
    vertices_ = vertices;
    attributes_ = attributes;
    rows_.resize((attributes + lanes - 1) / lanes * vertices);
  }

  [[nodiscard]] std::size_t attributes() const { return attributes_; }

  [[nodiscard]] double& at(std::size_t vertex, std::size_t attribute) {
    return rows_[attribute / lanes * vertices_ + vertex][attribute % lanes];
  }
  [[nodiscard]] double at(std::size_t vertex, std::size_t attribute) const {
    return rows_[attribute / lanes * vertices_ + vertex][attribute % lanes];
  }

  /// The attributes from `first` on, a multiple of `lanes`: [vertex]. Attributes beyond the last have any value.
  [[nodiscard]] std::span<const Row> rows(std::size_t first) const {
    return std::span(rows_).subspan(first / lanes * vertices_, vertices_);
  }

 private:
  std::size_t vertices_ = 0, attributes_ = 0;
  std::vector<Row> rows_;
};

/// Some vertices of a mesh, and the corners of all tetrahedra at them, numbered anew: the vertices whose values decide
/// on the material of the block. Keeps its memory for the next block.
class VertexBlock {
 public:
  /// [new number]: a vertex of the mesh. Those of the block come first, in their order.
  [[nodiscard]] std::span<const std::uint32_t> vertices() const { return vertices_; }

 private:
  friend class VertexMaterial;

  void clear();
  std::uint32_t number_of(std::uint32_t vertex);
  void grow();

  std::vector<std::uint32_t> vertices_;
  std::vector<std::array<std::uint32_t, 3>> others_;  // new numbers: of the other corners of each tetrahedron
  std::vector<std::size_t> begins_;                   // [vertex of the block]: its tetrahedra among others_
  std::vector<std::uint32_t> slots_;                  // hash table: 1 + new number; 0: empty
};

/// The material of a vertex that has a value of an attribute, and the direction of the value's gradient there.
struct VertexValue {
  ValueMoments moments;
  dvec3 gradient{0};  // of any length
};

/// The material of each vertex of a mesh, in closed form. A vertex owns the quarter of each of its tetrahedra where its
/// barycentric coordinate is the largest. Values are linear in each tetrahedron, volumes absolute. A tetrahedron that
/// is flat, or too large for double precision, adds nothing. Both spans must outlive this; fewer than 2^32 tetrahedra.
/// Thread-safe. Memory accesses take most of the time, so ask for everything about a vertex at once.
class VertexMaterial {
 public:
  VertexMaterial(std::span<const dvec3> positions, std::span<const Tetrahedron> tetrahedra);

  [[nodiscard]] SpatialMoments moments(std::size_t vertex) const;

  /// `values`: of all vertices. A tetrahedron with a missing value (NaN) at a corner has no value.
  [[nodiscard]] ValueMoments value_moments(std::size_t vertex, std::span<const double> values) const;

  /// Returns the direction of the value's gradient, of any length, as in Meredith and Ma (2001), section 3.2: the sum
  /// of one-sided differences along edges. An edge counts once for each of its tetrahedra, so that pieces of a mesh add
  /// up to the whole. 0 if there is none.
  [[nodiscard]] dvec3 gradient(std::size_t vertex, std::span<const double> values) const;

  /// Makes `block` that of these vertices, which must differ.
  void make_block(std::span<const std::uint32_t> vertices, VertexBlock& block) const;

  /// Finds value_moments, and with `gradients` also gradient, of all attributes at vertex `number` of a block, to the
  /// same last bit, much faster than one by one. `table`: values at block.vertices(). Returns the vertex's moments.
  /// Requires values.size() == table.attributes().
  SpatialMoments find_values(const VertexBlock& block, std::size_t number, const ValueTable& table, bool gradients,
                             std::span<VertexValue> values) const;

  /// Bytes that it holds for a mesh.
  [[nodiscard]] static std::size_t bytes(std::size_t vertices, std::size_t tetrahedra) {
    return 8 * vertices + 24 * tetrahedra;
  }

 private:
  template <class Add>
  double visit(std::size_t vertex, Add add_quarter) const;

  std::span<const dvec3> positions_;
  std::span<const Tetrahedron> tetrahedra_;
  IndexLists incident_;         // [vertex]: tetrahedra
  std::vector<double> masses_;  // [tetrahedron]: of a quarter
};

/// Returns mass and principal axes as the file stores them. The squares of the deviations are exact to a few units of
/// rounding of the largest square.
[[nodiscard]] SplatShape shape_of(const SpatialMoments& moments);

/// Returns the shapes of up to `shapes_at_once` moments, in a third of the time that they take one by one. Only the
/// first moments.size() results count.
inline constexpr std::size_t shapes_at_once = 4;
[[nodiscard]] std::array<SplatShape, shapes_at_once> shapes_of(std::span<const SpatialMoments* const> moments);

/// Returns a value's distribution as the file stores it, except that the mean still contains the attribute's offset.
/// `shape` belongs to all the material that `value` is a part of. Correlations, residual and coverage never exceed 1,
/// however thin the material is.
[[nodiscard]] SplatValue value_of(const ValueMoments& value, const SplatShape& shape);

}  // namespace splatvol
