#include "sampler/splat_sampler.h"

#include <cstdint>
#include <limits>

namespace splatvol {

SplatSampler::SplatSampler(std::span<const dvec3> positions)
    : positions_(positions), tree_(positions), sums_(positions.size()) {}

void SplatSampler::add(const format::SplatGroup& group) {
  for (std::size_t i = 0; i < group.size(); ++i) add(group.centroids[i], group.shapes[i], group.materials[0][i]);
}

void SplatSampler::add(const dvec3& centroid, const SplatShape& of, const SplatValue& value) {
  const SplatShape shape = with_thickness(of);
  const Ellipsoid ellipsoid = ellipsoid_of(centroid, shape);
  const double weight = shape.density * value.coverage;
  if (tree_.empty() || !(ellipsoid.peak * weight > 0)) return;
  const LinearField field = field_of(centroid, shape, value);
  const Box box{ellipsoid.center - ellipsoid.reach, ellipsoid.center + ellipsoid.reach};
  const auto add_to = [&](std::uint32_t position) {
    const dvec3 u = ellipsoid.in_ball(positions_[position]);
    const double density = weight * ellipsoid.density(u);
    if (!(density > 0)) return;
    const bool is_cut_off = ellipsoid.is_cut_off(u);
    sums_[position].density.add(density, ellipsoid.has_boundary(), is_cut_off);
    if (!is_cut_off) sums_[position].value += density * field.at(positions_[position]);
  };
  tree_.visit_near(box, add_to);
}

std::vector<double> SplatSampler::values() const {
  std::vector<double> values;
  values.reserve(sums_.size());
  for (const Sums& sums : sums_)
    values.push_back(sums.density.is_material() ? sums.value / sums.density.left
                                                : std::numeric_limits<double>::quiet_NaN());
  return values;
}

}  // namespace splatvol
