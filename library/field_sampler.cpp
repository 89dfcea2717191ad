#include "library/field_sampler.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/interruption.h"

namespace splatvol {
namespace {

constexpr std::uint32_t leaf_positions = 16;

bool is_finite(const dvec3& position) {
  return std::isfinite(position.x) && std::isfinite(position.y) && std::isfinite(position.z);
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

void FieldSampler::add(const dvec3& centroid, const SplatShape& of, const SplatValue& value) {
  const SplatShape shape = with_thickness(of);
  const Ellipsoid ellipsoid = ellipsoid_of(centroid, shape);
  const double weight = shape.density * value.coverage;
  if (nodes_.empty() || !(ellipsoid.peak * weight > 0)) return;
  const LinearField field = field_of(centroid, shape, value);
  const Box box{ellipsoid.centre - ellipsoid.reach, ellipsoid.centre + ellipsoid.reach};
  const auto add_to = [&](std::uint32_t position) {
    const dvec3 u = ellipsoid.in_ball(positions_[position]);
    const double density = weight * ellipsoid.density(u);
    if (!(density > 0)) return;
    const bool is_cut_off = ellipsoid.is_cut_off(u);
    sums_[position].density.add(density, ellipsoid.has_boundary(), is_cut_off);
    if (!is_cut_off) sums_[position].value += density * field.at(positions_[position]);
  };
  for (std::uint32_t n = 0; n < nodes_.size();) {
    const Node& node = nodes_[n];
    const bool is_near = squared_distance(node.box, box) == 0, is_leaf = node.next == n + 1;
    for (std::uint32_t i = node.begin; is_near && is_leaf && i < node.end; ++i) add_to(order_[i]);
    n = is_near ? n + 1 : node.next;
  }
}

std::vector<double> FieldSampler::values() const {
  std::vector<double> values;
  values.reserve(sums_.size());
  for (const Sums& sums : sums_)
    values.push_back(sums.density.is_material() ? sums.value / sums.density.left
                                                : std::numeric_limits<double>::quiet_NaN());
  return values;
}

}  // namespace splatvol
