#include "streamer/clip.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "base/rotation.h"

namespace splatvol {
namespace {

constexpr double farthest = 3;      // deviations; a face beyond cuts off nothing, or everything
constexpr double softest = 0.75;    // if a smaller share of the mass is left, the face becomes the splat's boundary
constexpr double foot_scale = 128;  // of MomentsSplat::boundary
constexpr double largest_foot = 511 / foot_scale;

// A splat in double precision.
struct Material {
  dvec3 center;
  dmat3 axes;        // columns
  dvec3 deviations;  // along the axes
  double mass;
  double value, value_deviation, residual;  // residual: deviation from the linear field
  dvec3 covariance;                         // of the value with the position along each axis
};

int signed_byte(std::uint32_t packed, int k) { return static_cast<std::int8_t>(packed >> 8 * k & 255); }

Material unpack(const MomentsSplat& splat) {
  Material m;
  m.center = dvec3(splat.position);
  m.axes = rotated_axes(splat.orientation);
  m.deviations = dvec3(splat.deviations);
  m.mass = static_cast<double>(splat.mass);
  m.value = static_cast<double>(splat.value);
  m.value_deviation = static_cast<double>(splat.value_deviation);
  for (int k = 0; k < 3; ++k)
    m.covariance[k] = signed_byte(splat.correlations, k) / 127.0 * m.value_deviation * m.deviations[k];
  m.residual = signed_byte(splat.correlations, 3) / 127.0 * m.value_deviation;
  return m;
}

void pack(const Material& m, MomentsSplat& splat) {
  splat.position = vec3(m.center);
  splat.deviations = vec3(m.deviations);
  splat.mass = static_cast<float>(m.mass);
  splat.value = static_cast<float>(m.value);
  splat.value_deviation = static_cast<float>(m.value_deviation);
  splat.correlations = 0;
  for (int k = 0; k < 4; ++k) {
    const double unit = k < 3 ? m.value_deviation * m.deviations[k] : m.value_deviation;
    const double number = k < 3 ? m.covariance[k] : m.residual;
    const double correlation = unit > 0 ? std::clamp(number / unit, -1.0, 1.0) : 0;
    const auto code = static_cast<std::int8_t>(std::lround(127 * correlation));
    splat.correlations |= static_cast<std::uint32_t>(static_cast<std::uint8_t>(code)) << 8 * k;
  }
}

// Returns, packed, the foot of the perpendicular from the centroid on the plane at `distance` along `normal` (in
// principal directions), in deviations. Returns 0 if the foot is out of range.
std::uint32_t boundary_at(const Material& m, const dvec3& normal, double distance) {
  const dvec3 across = normal * m.deviations;
  const double square = glm::dot(across, across);
  if (!(square > 0)) return 0;
  const dvec3 foot = distance / square * across;
  if (!(std::max({std::abs(foot.x), std::abs(foot.y), std::abs(foot.z)}) < largest_foot)) return 0;
  std::uint32_t packed = 0;
  for (int k = 0; k < 3; ++k)
    packed |= (static_cast<std::uint32_t>(std::lround(foot_scale * foot[k])) & 1023u) << 10 * k;
  return packed;
}

// Cuts off the material beyond the plane at `distance` from the centre along `outwards`. A truncated normal
// distribution has its share, mean and variance in closed form; the other numbers follow by regression. Returns false
// if nothing is left.
bool cut(Material& m, const dvec3& outwards, double distance, MomentsSplat& splat) {
  const dvec3 normal = outwards * m.axes;  // along the principal axes
  const dvec3 with = m.deviations * m.deviations * normal;
  const double variance = glm::dot(with, normal), deviation = std::sqrt(variance);
  if (!(deviation > 0)) return distance >= 0;
  const double cut_at = distance / deviation;
  if (cut_at >= farthest) return true;
  if (cut_at <= -farthest) return false;

  const double share = 0.5 * std::erfc(-cut_at / std::numbers::sqrt2);
  const double density = std::exp(-0.5 * cut_at * cut_at) / std::sqrt(2 * std::numbers::pi);
  const double mean = -density / share;                                              // in deviations
  const double lost = std::clamp(cut_at * density / share + mean * mean, 0.0, 1.0);  // of the variance
  const double with_value = glm::dot(m.covariance, normal);
  m.mass *= share;
  m.center += mean / deviation * (m.axes * with);
  m.value += mean / deviation * with_value;
  const double value_variance =
      std::max(0.0, m.value_deviation * m.value_deviation - lost * with_value * with_value / variance);
  m.value_deviation = std::sqrt(value_variance);
  m.covariance -= lost * with_value / variance * with;
  for (int k = 0; k < 3; ++k)
    m.deviations[k] = std::sqrt(std::max(0.0, m.deviations[k] * m.deviations[k] - lost * with[k] * with[k] / variance));
  if (splat.boundary == 0 && share < softest) splat.boundary = boundary_at(m, normal, distance - mean * deviation);
  return true;
}

}  // namespace

void clip(std::span<MomentsSplat> splats, const Box& box) {
  for (MomentsSplat& splat : splats) {
    if (!(splat.mass > 0)) continue;
    Material m = unpack(splat);
    // Most splats are so far inside that no face matters.
    const double reach = farthest * std::max({m.deviations.x, m.deviations.y, m.deviations.z});
    const dvec3 below = m.center - box.low, above = box.high - m.center;
    if (std::min({below.x, below.y, below.z, above.x, above.y, above.z}) > reach) continue;
    bool left = true;
    for (int axis = 0; axis < 3 && left; ++axis) {
      dvec3 outwards(0);
      outwards[axis] = 1;
      left = cut(m, outwards, box.high[axis] - m.center[axis], splat) &&
             cut(m, -outwards, m.center[axis] - box.low[axis], splat);
    }
    if (left)
      pack(m, splat);
    else
      splat.mass = 0;
  }
}

void clip(std::span<OctantSplat> splats, const Box& box) {
  for (OctantSplat& splat : splats) {
    const dvec3 position(splat.position);
    if (!(glm::all(glm::greaterThanEqual(position, box.low)) && glm::all(glm::lessThanEqual(position, box.high))))
      splat.value = std::numeric_limits<float>::quiet_NaN();
  }
}

}  // namespace splatvol
