// Splat moments: mass, mean and covariance, in space and value, of the material that each point stands for.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "base/math.h"
#include "format/columns.h"

namespace splatvol {

/// A symmetric 3x3 matrix.
struct SymmetricMatrix {
  double xx = 0, yy = 0, zz = 0, xy = 0, xz = 0, yz = 0;
};

/// A cluster's material in space. Lengths relative to a point near it, so that nothing is lost far from the origin.
struct SpatialMoments {
  double mass = 0;             // volume
  dvec3 centroid{0};           // less the point's position; 0 without mass
  SymmetricMatrix covariance;  // about the centroid
};

/// The part of it that has a value of an attribute.
struct ValueMoments {
  double mass = 0;
  dvec3 centroid{0};                                     // of that part, less the point's position
  double mean = 0;                                       // of the value
  double variance = 0;                                   // of the value
  dvec3 covariance{0};                                   // of position and value
  double min = std::numeric_limits<double>::infinity();  // what values it takes
  double max = -std::numeric_limits<double>::infinity();
};

using Tetrahedron = std::array<std::uint32_t, 4>;

/// Adds b to a, both of disjoint materials; `shift` is b's point less a's. Exact up to rounding, in any order.
void merge(SpatialMoments& a, const SpatialMoments& b, const dvec3& shift);
void merge(ValueMoments& a, const ValueMoments& b, const dvec3& shift);

/// What each vertex owns of its tetrahedra: the quarter where its barycentric coordinate is the largest, in closed form
/// (values are linear in each tetrahedron). Absolute volumes; what is flat, or too large for double precision, gives
/// nothing. Both spans must outlive this; fewer than 2^32 tetrahedra. Thread-safe; ask for all that is wanted of a
/// vertex at once, as it is memory that takes the time.
class VertexMaterial {
 public:
  VertexMaterial(std::span<const dvec3> positions, std::span<const Tetrahedron> tetrahedra);

  [[nodiscard]] SpatialMoments moments(std::size_t vertex) const;

  /// `values` of all vertices; a tetrahedron with a missing one (NaN) at a corner has none.
  [[nodiscard]] ValueMoments value_moments(std::size_t vertex, std::span<const double> values) const;

  /// Direction of the value's gradient as in Meredith and Ma (2001), section 3.2: the sum of one-sided differences
  /// along edges, each as often as it belongs to a tetrahedron, so that pieces of a mesh add up to the whole. Any
  /// length; 0 where there is none.
  [[nodiscard]] dvec3 gradient(std::size_t vertex, std::span<const double> values) const;

 private:
  template <class Add>
  double visit(std::size_t vertex, Add add_quarter) const;

  std::span<const dvec3> positions_;
  std::span<const Tetrahedron> tetrahedra_;
  std::vector<std::uint64_t> begins_;     // [position]: where its tetrahedra begin; and the total
  std::vector<std::uint32_t> incidence_;  // tetrahedra of each vertex, ascending
  std::vector<double> masses_;            // [tetrahedron]: of a quarter
};

/// Mass and principal axes, as the file stores them; deviations to a few units of rounding of the largest one's square.
[[nodiscard]] format::SplatShape shape_of(const SpatialMoments& moments);

/// The same of up to so many together, which takes a third of the time of one by one. The first moments.size() count.
inline constexpr std::size_t shapes_at_once = 4;
[[nodiscard]] std::array<format::SplatShape, shapes_at_once> shapes_of(std::span<const SpatialMoments* const> moments);

/// A value's distribution, as the file stores it but for the mean, which keeps the attribute's offset. `shape` is of
/// all the material that `value` is a part of. Never larger than 1 what must not be, however thin the material.
[[nodiscard]] format::SplatValue value_of(const ValueMoments& value, const format::SplatShape& shape);

}  // namespace splatvol
