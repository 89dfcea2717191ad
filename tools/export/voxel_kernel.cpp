#include "tools/export/voxel_kernel.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "splat/kernel.h"

namespace splatvol {
namespace {

// Variance of a voxel along each axis. With it, even a splat without extent has the centre of a voxel in its ellipsoid.
constexpr double voxel_variance = 1.0 / 12;

// Most voxels of an ellipsoid that reaches out of the box. In a larger ellipsoid, only voxels in the box are visited.
constexpr double most_outside = 65536;

constexpr double farthest = std::numeric_limits<std::int32_t>::max() - 1;
std::int32_t first_voxel(double from) {
  return static_cast<std::int32_t>(std::ceil(std::clamp(from, -farthest, farthest)));
}
std::int32_t last_voxel(double to) {
  return static_cast<std::int32_t>(std::floor(std::clamp(to, -farthest, farthest)));
}

}  // namespace

VoxelKernel::VoxelKernel(const dvec3& centroid, const SplatShape& shape) : centroid_(centroid) {
  SplatShape unit = shape;
  unit.mass = 1;
  ellipsoid_ = ellipsoid_of(centroid, unit, voxel_variance);
  ellipsoid_.peak = 1;
  const dmat3 from = from_ball(shape, voxel_variance);
  square_ = from * glm::transpose(from);
  inverse_ = glm::transpose(ellipsoid_.to_ball) * ellipsoid_.to_ball;
  volume_ = 4 * std::numbers::pi / 3 * std::abs(glm::determinant(from));
}

bool VoxelKernel::reaches(const Box& box) const {
  for (int k = 0; k < 3; ++k) {
    const double center = ellipsoid_.center[k], reach = ellipsoid_.reach[k];
    if (center + reach < box.low[k] || center - reach > box.high[k]) return false;
  }
  return true;
}

LinearField VoxelKernel::field(const SplatShape& shape, const SplatValue& value) const {
  return field_of(centroid_, shape, value, voxel_variance);
}

// Calls visit(run, offset) for each voxel run whose centres are in the ellipsoid and in the box, until it returns
// false. `offset`: of the run's first voxel from the ellipsoid's centre. Returns false after that, or if there are more
// than `most` rows: those without a voxel take time, too.
template <class Visit>
bool VoxelKernel::visit_rows(const Box& box, std::size_t most, const Visit& visit) const {
  const dmat3 &q = square_, &p = inverse_;
  const dvec3& center = ellipsoid_.center;
  const double most_x = std::sqrt(q[0][0]);
  if (first_voxel(std::max(center.x - most_x, box.low.x)) > last_voxel(std::min(center.x + most_x, box.high.x)))
    return true;
  std::size_t rows = 0;
  const double reach_z = std::sqrt(q[2][2]);
  const std::int32_t last_z = last_voxel(std::min(center.z + reach_z, box.high.z));
  for (std::int32_t z = first_voxel(std::max(center.z - reach_z, box.low.z)); z <= last_z; ++z) {
    // The projection along x is an ellipse; its matrix gives its chords.
    const double dz = z - center.z;
    const double reach_y = std::sqrt(std::max(0.0, (q[1][1] - q[1][2] * q[1][2] / q[2][2]) * (1 - dz * dz / q[2][2])));
    const double middle_y = center.y + q[1][2] / q[2][2] * dz;
    const std::int32_t last_y = last_voxel(std::min(middle_y + reach_y, box.high.y));
    for (std::int32_t y = first_voxel(std::max(middle_y - reach_y, box.low.y)); y <= last_y; ++y) {
      if (rows++ == most) return false;
      const double dy = y - center.y;
      const double slant = -(p[0][1] * dy + p[0][2] * dz) / p[0][0];
      const double rest = p[1][1] * dy * dy + 2 * p[1][2] * dy * dz + p[2][2] * dz * dz;
      const double square = slant * slant + (1 - rest) / p[0][0];
      if (!(square > 0)) continue;
      const double reach_x = std::sqrt(square);
      const std::int32_t first = first_voxel(std::max(center.x + slant - reach_x, box.low.x));
      const std::int32_t last = last_voxel(std::min(center.x + slant + reach_x, box.high.x));
      if (first > last) continue;
      const Run run{first, y, z, static_cast<std::uint32_t>(std::int64_t{last} - first) + 1};
      if (!visit(run, dvec3(first - center.x, dy, dz))) return false;
    }
  }
  return true;
}

bool VoxelKernel::append(const Box& box, std::size_t most, std::vector<Run>& runs, std::vector<double>& shares) const {
  const Box reach{ellipsoid_.center - ellipsoid_.reach, ellipsoid_.center + ellipsoid_.reach};
  Box both = reach;
  both.include(box);
  const bool integrate = volume_ > most_outside && both != box;
  const std::size_t first_run = runs.size(), first_share = shares.size();
  double sum = 0;
  const bool fits = visit_rows(integrate ? box : reach, most, [&](const Run& run, dvec3 offset) {
    if (run.count > most - (shares.size() - first_share)) return false;
    runs.push_back(run);
    for (std::uint32_t i = 0; i < run.count; ++i, offset.x += 1) {
      const dvec3 u = ellipsoid_.to_ball * offset;
      shares.push_back(ellipsoid_.is_cut_off(u) ? 0 : ellipsoid_.density(u));
      sum += shares.back();
    }
    return true;
  });
  if (!fits) return false;
  if (integrate) {
    sum = volume_ * 3 / (4 * std::numbers::pi * moments_peak) * (ellipsoid_.has_boundary() ? 0.5 : 1.0);
  } else if (!(sum > 0)) {
    // No centre of a voxel is in the ellipsoid on the material's side of the boundary: the nearest voxel gets all.
    runs.resize(first_run);
    shares.resize(first_share);
    const auto nearest = [](double x) { return static_cast<std::int32_t>(nearest_integer(x)); };
    runs.push_back({nearest(centroid_.x), nearest(centroid_.y), nearest(centroid_.z), 1});
    shares.push_back(1);
    return true;
  }
  for (auto share = shares.begin() + static_cast<std::ptrdiff_t>(first_share); share != shares.end(); ++share)
    *share /= sum;
  return true;
}

}  // namespace splatvol
