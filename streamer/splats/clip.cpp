#include "streamer/splats/clip.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>
#include <variant>
#include <vector>

#include "splat/splat.h"

namespace splatvol {
namespace {

constexpr double farthest = 3;    // deviations; a face beyond cuts off nothing, or everything
constexpr double softest = 0.75;  // if a smaller share of the mass is left, the face becomes the splat's boundary
constexpr double largest_foot = 511.0 / 128;  // of MomentsShape::boundary

// A splat, and the numbers that cutting it changes together.
struct Cutting {
  MomentsSplat splat;
  dmat3 axes;        // columns
  dvec3 covariance;  // of the value with the position along each axis
};

Cutting begin_cutting(const MomentsSplat& m) {
  return {m, glm::mat3_cast(m.orientation), m.correlations * m.value_deviation * m.deviations};
}

MomentsSplat end_cutting(const Cutting& cutting) {
  MomentsSplat m = cutting.splat;
  for (int k = 0; k < 3; ++k) {
    const double unit = m.value_deviation * m.deviations[k];
    m.correlations[k] = unit > 0 ? std::clamp(cutting.covariance[k] / unit, -1.0, 1.0) : 0;
  }
  return m;
}

// Returns the foot of the perpendicular from the centroid on the plane at `distance` along `normal` (in principal
// directions), in deviations. Returns 0 if the foot is out of range.
dvec3 boundary_at(const MomentsSplat& m, const dvec3& normal, double distance) {
  const dvec3 across = normal * m.deviations;
  const double square = glm::dot(across, across);
  if (!(square > 0)) return dvec3(0);
  const dvec3 foot = distance / square * across;
  const bool in_range = std::max({std::abs(foot.x), std::abs(foot.y), std::abs(foot.z)}) < largest_foot;
  return in_range ? foot : dvec3(0);
}

// Cuts off the material beyond the plane at `distance` from the centre along `outwards`. A truncated normal
// distribution has its share, mean and variance in closed form; the other numbers follow by regression. Returns false
// if nothing is left.
bool cut(Cutting& cutting, const dvec3& outwards, double distance) {
  MomentsSplat& m = cutting.splat;
  const dvec3 normal = outwards * cutting.axes;  // along the principal axes
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
  const double with_value = glm::dot(cutting.covariance, normal);
  m.mass *= share;
  m.center += mean / deviation * (cutting.axes * with);
  m.value += mean / deviation * with_value;
  const double value_variance =
      std::max(0.0, m.value_deviation * m.value_deviation - lost * with_value * with_value / variance);
  m.value_deviation = std::sqrt(value_variance);
  cutting.covariance -= lost * with_value / variance * with;
  for (int k = 0; k < 3; ++k)
    m.deviations[k] = std::sqrt(std::max(0.0, m.deviations[k] * m.deviations[k] - lost * with[k] * with[k] / variance));
  if (m.boundary == dvec3(0) && share < softest) m.boundary = boundary_at(m, normal, distance - mean * deviation);
  return true;
}

// Whether all positions in a box are at least `margin` inside of the region.
bool lies_within(const ClipRegion& region, const Box& box, double margin) {
  if (region.box && !(glm::all(glm::greaterThanEqual(box.low, region.box->low + margin)) &&
                      glm::all(glm::lessThanEqual(box.high, region.box->high - margin))))
    return false;
  const dvec3 center = 0.5 * (box.low + box.high), half = 0.5 * box.extent();
  return std::ranges::all_of(region.planes, [&](const Plane& plane) {
    return plane.distance(center) - glm::dot(glm::abs(plane.normal), half) >= margin;
  });
}

// Boxes of the centres of a range, relative to its block, and how far its splats reach beyond them.
struct Reach {
  Box centers;
  double beyond = 0;
};

template <class Shape>
Box centers_of(const DrawRange& range, std::span<const Shape> shapes) {
  glm::ivec3 low(largest_offset), high(-largest_offset);
  for (const Shape& shape : shapes) {
    const glm::ivec3 offset = shape.position.offset();
    low = glm::min(low, offset);
    high = glm::max(high, offset);
  }
  const double step = range.row.shapes->blocks()[range.block].step;
  return {step * dvec3(low), step * dvec3(high)};
}

Reach reach_of(const DrawRange& range, std::span<const MomentsShape> shapes) {
  unsigned code = 0;
  for (const MomentsShape& shape : shapes) code = std::max<unsigned>(code, shape.deviations[0]);
  return {centers_of(range, shapes), farthest * log_number(code, range.row.shapes->deviation_scale())};
}

Reach reach_of(const DrawRange& range, std::span<const OctantShape> shapes) { return {centers_of(range, shapes), 0}; }

std::vector<MomentsSplat> unpacked(const DrawRange& range, std::span<const MomentsShape> /*shapes*/) {
  std::vector<MomentsSplat> splats;
  for (std::uint32_t i = 0; i < range.count; ++i) splats.push_back(unpack(range.row, range.begin + i));
  return splats;
}

std::vector<OctantSplat> unpacked(const DrawRange& range, std::span<const OctantShape> /*shapes*/) {
  std::vector<OctantSplat> splats;
  for (std::uint32_t i = 0; i < range.count; ++i) splats.push_back(unpack_octant(range.row, range.begin + i));
  return splats;
}

OpacityValues opacity_of(const DrawRange& range) {
  const OpacityValues& whole = range.row.values->opacity();
  if (whole.records.empty()) return {};
  const auto part = std::span(whole.records).subspan(range.begin, range.count);
  return {{part.begin(), part.end()}, whole.deviation_scale};
}

bool draws(const MomentsSplat& splat) { return splat.mass > 0; }
bool draws(const OctantSplat& splat) { return !std::isnan(splat.value); }

}  // namespace

bool clip(MomentsSplat& splat, const ClipRegion& region) {
  if (!(splat.mass > 0)) return false;
  // Most splats are so far inside that no face matters.
  const double reach = farthest * std::max({splat.deviations.x, splat.deviations.y, splat.deviations.z});
  if (lies_within(region, {splat.center, splat.center}, reach)) return false;
  Cutting cutting = begin_cutting(splat);
  bool left = true;
  for (int axis = 0; axis < 3 && left && region.box; ++axis) {
    dvec3 outwards(0);
    outwards[axis] = 1;
    left = cut(cutting, outwards, region.box->high[axis] - cutting.splat.center[axis]) &&
           cut(cutting, -outwards, cutting.splat.center[axis] - region.box->low[axis]);
  }
  for (std::size_t i = 0; i < region.planes.size() && left; ++i)
    left = cut(cutting, -region.planes[i].normal, region.planes[i].distance(cutting.splat.center));
  if (left)
    splat = end_cutting(cutting);
  else
    splat.mass = 0;
  return true;
}

bool clip(OctantSplat& splat, const ClipRegion& region) {
  if (std::isnan(splat.value) || region.contains(dvec3(splat.position))) return false;
  splat.value = std::numeric_limits<float>::quiet_NaN();
  return true;
}

ClippedRange clip(const DrawRange& range, const ClipRegion& region, double length) {
  const dvec3& origin = range.row.shapes->blocks()[range.block].origin;
  ClipRegion relative = region;
  if (region.box) relative.box = Box{(region.box->low - origin) / length, (region.box->high - origin) / length};
  for (Plane& plane : relative.planes) plane.point = (plane.point - origin) / length;
  const auto clip_shapes = [&](const auto& records) -> ClippedRange {
    const auto shapes = std::span(records).subspan(range.begin, range.count);
    const auto [centers, beyond] = reach_of(range, shapes);
    if (lies_within(relative, centers, beyond)) return {ClippedRange::Part::all, {}};
    if (relative.excludes({centers.low - beyond, centers.high + beyond})) return {ClippedRange::Part::none, {}};
    auto splats = unpacked(range, shapes);
    bool changed = false;
    for (auto& splat : splats) changed = clip(splat, relative) || changed;
    if (!changed) return {ClippedRange::Part::all, {}};
    if (std::ranges::none_of(splats, [](const auto& splat) { return draws(splat); }))
      return {ClippedRange::Part::none, {}};
    return {ClippedRange::Part::some, pack_row(splats, origin, length, opacity_of(range))};
  };
  return std::visit(clip_shapes, range.row.shapes->records());
}

}  // namespace splatvol
