// The gradient of a value at the points of tetrahedra.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "base/math.h"

namespace splatvol {

/// Sums for the gradient of a value at a point, over the tetrahedra there. Sums of parts of the tetrahedra
/// add up to that of all.
struct GradientSum {
  dvec3 gradients{0};  // times the weight
  double weight = 0;

  void add(const GradientSum& other) {
    gradients += other.gradients;
    weight += other.weight;
  }

  /// Returns the weighted mean; 0 if no tetrahedron counts, or if lengths or values are so large or small that it
  /// cannot be computed.
  [[nodiscard]] dvec3 mean() const;
};

/// Adds the gradient in each tetrahedron to the sums of its points. `values` and `sums`: [point]. Its weight at a point
/// is its volume by the squares of the three edges there, as N. Max weights the normals of facets ("Weights for
/// Computing Vertex Normals from Facet Normals", 1999): thin tetrahedra count little, and small ones more than large
/// ones. Flat tetrahedra and those with a missing value do not count. Requires lengths from 1e-50 to 1e50.
void add_gradients(std::span<const dvec3> points, std::span<const std::array<std::uint32_t, 4>> tetrahedra,
                   std::span<const double> values, std::span<GradientSum> sums);

/// The same for sums of other points. `places`: [point]: its number in `sums`; the last of these is for all points that
/// have none.
void add_gradients(std::span<const dvec3> points, std::span<const std::array<std::uint32_t, 4>> tetrahedra,
                   std::span<const double> values, std::span<const std::uint32_t> places, std::span<GradientSum> sums);

/// Returns the means of sums.
[[nodiscard]] std::vector<dvec3> means_of(std::span<const GradientSum> sums);

}  // namespace splatvol
