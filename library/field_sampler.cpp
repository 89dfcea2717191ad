#include "library/field_sampler.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/interruption.h"
#include "splat/kernel.h"

namespace splatvol {
namespace {

constexpr std::uint32_t leaf_positions = 16;

// Material covers this share of a place at least, or the place counts as empty: as where slabs end (docs/design.md).
constexpr double least_density = 1.0 / 6;

// A splat is at least this share of its length thick, so that its ellipsoid can be inverted.
constexpr double least_thickness = 1e-6;

bool is_finite(const dvec3& position) {
  return std::isfinite(position.x) && std::isfinite(position.y) && std::isfinite(position.z);
}

// The kernel of a splat, as the renderer draws it.
struct Ellipsoid {
  dvec3 center{0};
  dmat3 inverse{0};     // of L L^T, L from the unit ball to the ellipsoid
  Box box;              // round it
  double density = 0;   // at its centre
  dvec3 cut_normal{0};  // of the boundary plane, outwards; 0: no boundary
  double cut_offset = 0;
};

Ellipsoid ellipsoid_of(const dvec3& centroid, const format::SplatShape& shape) {
  Ellipsoid ellipsoid;
  const dmat3 axes = glm::mat3_cast(shape.orientation);
  const dvec3 deviations = glm::max(shape.deviations, dvec3(least_thickness * shape.deviations.x));
  dmat3 covariance(0);
  for (int k = 0; k < 3; ++k) {
    covariance += deviations[k] * deviations[k] * glm::outerProduct(axes[k], axes[k]);
    ellipsoid.cut_normal += shape.boundary[k] / deviations[k] * axes[k];
  }
  const dvec3 shift = format::reflection_shift(shape);
  covariance += glm::outerProduct(shift, shift);
  ellipsoid.center = centroid + shift;
  ellipsoid.cut_offset = glm::dot(shape.boundary, shape.boundary);
  const dmat3 square = moments_half_width * moments_half_width * covariance;
  ellipsoid.inverse = glm::inverse(square);
  const dvec3 reach = glm::sqrt(dvec3(square[0][0], square[1][1], square[2][2]));
  ellipsoid.box = {ellipsoid.center - reach, ellipsoid.center + reach};
  // Half of an ellipsoid holds the mass of material with a boundary.
  const double halves = shape.boundary == dvec3(0) ? 1 : 2;
  ellipsoid.density = halves * moments_peak * shape.mass / std::sqrt(glm::determinant(square));
  return ellipsoid;
}

// The slope of the stored value in the material, per world length.
dvec3 slope_of(const format::SplatShape& shape, const format::SplatValue& value) {
  dvec3 along(0);
  for (int k = 0; k < 3; ++k)
    if (shape.deviations[k] > 0) along[k] = value.correlation[k] * value.deviation / shape.deviations[k];
  return glm::mat3_cast(shape.orientation) * along;
}

}  // namespace

FieldSampler::FieldSampler(std::span<const dvec3> positions) : positions_(positions), sums_(positions.size()) {
  for (std::uint32_t i = 0; i < positions.size(); ++i)
    if (is_finite(positions[i])) order_.push_back(i);
  if (!order_.empty()) make_node(0, static_cast<std::uint32_t>(order_.size()));
}

void FieldSampler::make_node(std::uint32_t begin, std::uint32_t end) {
  const auto number = static_cast<std::uint32_t>(nodes_.size());
  nodes_.push_back({{}, begin, end, 0});
  Box box;
  for (std::uint32_t i = begin; i < end; ++i) box.include(positions_[order_[i]]);
  nodes_[number].box = box;
  // The first group after an interruption ends the work: no need to divide on.
  if (end - begin > leaf_positions && box.low != box.high && !is_interrupted()) {
    const int axis = longest_axis(box.extent());
    const std::uint32_t middle = begin + (end - begin) / 2;
    std::ranges::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end, {},
                             [&](std::uint32_t i) { return positions_[i][axis]; });
    make_node(begin, middle);
    make_node(middle, end);
  }
  nodes_[number].next = static_cast<std::uint32_t>(nodes_.size());
}

void FieldSampler::add(const format::SplatGroup& group) {
  for (std::size_t i = 0; i < group.size(); ++i) add(group.centroids[i], group.shapes[i], group.materials[0][i]);
}

void FieldSampler::add(const dvec3& centroid, const format::SplatShape& shape, const format::SplatValue& value) {
  if (nodes_.empty() || !(shape.mass > 0) || !(shape.deviations.x > 0)) return;
  const Ellipsoid ellipsoid = ellipsoid_of(centroid, shape);
  const dvec3 slope = slope_of(shape, value);
  const auto add_to = [&](std::uint32_t position) {
    const dvec3 offset = positions_[position] - ellipsoid.center;
    const double height = 1 - glm::dot(offset, ellipsoid.inverse * offset);
    if (!(height > 0)) return;
    const dvec3 from_centroid = positions_[position] - centroid;
    if (glm::dot(ellipsoid.cut_normal, from_centroid) > ellipsoid.cut_offset) return;
    const double density = ellipsoid.density * height * std::sqrt(height);
    Sums& sums = sums_[position];
    sums.density += density;
    if (!(value.coverage > 0)) return;
    sums.known += density * value.coverage;
    sums.value += density * value.coverage * (value.mean + glm::dot(slope, from_centroid));
  };
  for (std::uint32_t n = 0; n < nodes_.size();) {
    const Node& node = nodes_[n];
    const bool is_near = squared_distance(node.box, ellipsoid.box) == 0, is_leaf = node.next == n + 1;
    for (std::uint32_t i = node.begin; is_near && is_leaf && i < node.end; ++i) add_to(order_[i]);
    n = is_near ? n + 1 : node.next;
  }
}

std::vector<double> FieldSampler::values() const {
  std::vector<double> values;
  values.reserve(sums_.size());
  for (const Sums& sums : sums_) {
    const bool is_known = sums.density >= least_density && sums.known >= 0.5 * sums.density;
    values.push_back(is_known ? sums.value / sums.known : std::numeric_limits<double>::quiet_NaN());
  }
  return values;
}

}  // namespace splatvol
