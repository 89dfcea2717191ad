#include "viewer/probe.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>
#include <variant>
#include <vector>

#include "renderer/slice_values.h"

namespace splatvol {
namespace {

constexpr double reach = 4;  // deviations; a splat farther from the ray is left out

struct Ray {
  dvec3 origin, direction;  // of length 1
};

Ray ray_through(const View& view, double x, double y) {
  const dvec3 aside = (x - 0.5 * view.width) / view.focal * view.right + (0.5 * view.height - y) / view.focal * view.up;
  if (view.orthographic) return {view.eye + aside, view.forward};
  return {view.eye, glm::normalize(view.forward + aside)};
}

// The optical depth of one Gaussian on a ray, at the distance along the ray where it is densest.
struct Crossing {
  double distance;
  double optical_depth;
  double value;
};

struct Gaussian {
  dvec3 center;
  dmat3 axes;        // columns
  dvec3 deviations;  // along them
  double mass, value;
};

constexpr double thinnest = 1e-4;  // share of the largest deviation: a ray still meets a flat splat

Gaussian gaussian_of(const Material& splat, const dvec3& origin, const DrawingUnits& units) {
  const dvec3 deviations = units.length * splat.deviations;
  return {origin + units.length * splat.center, glm::mat3_cast(splat.orientation),
          glm::max(deviations, dvec3(thinnest * deviations.x)), units.volume(splat.mass), units.value(splat.value)};
}

// A ball whose centre is as opaque as the splat's.
Gaussian gaussian_of(const OctantSplat& splat, const dvec3& origin, const DrawingUnits& units) {
  const double size = units.length * static_cast<double>(splat.size), deviation = 0.4 * size;
  return {origin + units.length * dvec3(splat.position), dmat3(1), dvec3(deviation),
          size * 2 * std::numbers::pi * deviation * deviation, units.value(static_cast<double>(splat.value))};
}

std::optional<Crossing> cross(const Ray& ray, const Gaussian& g, const TransferFunction& function) {
  if (!(g.mass > 0) || !(g.deviations.x > 0) || std::isnan(g.value)) return {};
  // In units of the deviations the Gaussian is round.
  const dvec3 from = (ray.origin - g.center) * g.axes / g.deviations;
  const dvec3 along = ray.direction * g.axes / g.deviations;
  const double square = glm::dot(along, along), nearest = -glm::dot(from, along) / square;
  if (!(nearest > 0)) return {};
  const dvec3 miss = from + nearest * along;
  const double far = glm::dot(miss, miss);
  if (far > reach * reach) return {};
  const double volume = std::pow(2 * std::numbers::pi, 1.5) * g.deviations.x * g.deviations.y * g.deviations.z;
  const double depth =
      function.extinction(g.value) * g.mass / volume * std::exp(-far / 2) * std::sqrt(2 * std::numbers::pi / square);
  if (!(depth > 0)) return {};
  return Crossing{nearest, depth, g.value};
}

// Finds the crossings of a range. `deviation`: about the largest of a splat, drawing units; splats that are too far
// from the ray by it are not unpacked, which would take most of the time.
template <class Shape, class Deviation, class Unpack>
void find_crossings(const DrawRange& range, std::span<const Shape> shapes, const Deviation& deviation,
                    const Unpack& unpack_one, const TransferFunction& function, const DrawingUnits& units,
                    const Ray& ray, std::vector<Crossing>& found) {
  const RecordBlock& block = range.row.shapes->blocks()[range.block];
  for (std::uint32_t i = range.begin; i < range.begin + range.count; ++i) {
    const dvec3 from = block.origin + units.length * block.step * dvec3(shapes[i].position.offset()) - ray.origin;
    const dvec3 miss = from - glm::dot(from, ray.direction) * ray.direction;
    const double near = 1.01 * reach * units.length * deviation(shapes[i]);
    if (glm::dot(miss, miss) > near * near) continue;
    if (const auto crossing = cross(ray, gaussian_of(unpack_one(range.row, i), block.origin, units), function))
      found.push_back(*crossing);
  }
}

void find_crossings(const DrawRange& range, const TransferFunction& function, const DrawingUnits& units, const Ray& ray,
                    std::vector<Crossing>& found) {
  const ShapeRow::Records& records = range.row.shapes->records();
  if (const auto* octants = std::get_if<std::vector<OctantShape>>(&records)) {
    const auto deviation = [](const OctantShape& shape) { return 0.4 * static_cast<double>(shape.size); };
    find_crossings(range, std::span(*octants), deviation, unpack_octant, function, units, ray, found);
  } else {
    const double scale = range.row.shapes->deviation_scale();
    const auto deviation = [&](const MomentsShape& shape) { return log_number(shape.deviations[0], scale); };
    find_crossings(range, std::span(std::get<std::vector<MomentsShape>>(records)), deviation, unpack, function, units,
                   ray, found);
  }
}

}  // namespace

std::optional<Probe> probe(const DrawList& list, const TransferFunction& function, const DrawingUnits& units,
                           const View& view, double x, double y) {
  const Ray ray = ray_through(view, x, y);
  std::vector<Crossing> crossings;
  for (const DrawRange& range : list.ranges) find_crossings(range, function, units, ray, crossings);
  std::ranges::sort(crossings, {}, &Crossing::distance);
  double depth = 0;
  for (const Crossing& crossing : crossings) depth += crossing.optical_depth;
  const double opacity = -std::expm1(-depth);
  constexpr double invisible = 1e-3;
  if (opacity < invisible) return {};
  double passed = 0;
  for (const Crossing& crossing : crossings) {
    passed += crossing.optical_depth;
    if (-std::expm1(-passed) >= opacity / 2)
      return Probe{crossing.value, ray.origin + crossing.distance * ray.direction, opacity};
  }
  return {};
}

std::optional<Probe> probe_slices(const DrawList& sliced, const DrawingUnits& units, const View& view, double x,
                                  double y) {
  // A picture of one pixel, whose ray is this one.
  const Ray ray = ray_through(view, x, y);
  View pixel = view;
  pixel.width = pixel.height = 1;
  pixel.eye = ray.origin;
  pixel.forward = ray.direction;
  const dvec3 right = view.right - glm::dot(view.right, ray.direction) * ray.direction;
  if (!(glm::length(right) > 0)) return {};
  pixel.right = glm::normalize(right);
  pixel.up = glm::cross(pixel.right, pixel.forward);
  std::optional<Probe> nearest;
  double least = std::numeric_limits<double>::infinity();
  for (const Slice& slice : view.slices) {
    const double depth = -slice.plane.distance(ray.origin) / glm::dot(slice.plane.normal, ray.direction);
    const dvec3 position = ray.origin + depth * ray.direction;
    if (!(depth > 0 && depth < least) || !view.clip.contains(position, 1e-6 * depth)) continue;
    const double value = slice_values(sliced, units, pixel, slice.plane, std::span(&depth, 1)).front();
    if (std::isnan(value)) continue;
    least = depth;
    nearest = Probe{value, position, slice.opacity};
  }
  return nearest;
}

}  // namespace splatvol
