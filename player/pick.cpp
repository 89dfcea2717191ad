#include "player/pick.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>

namespace splatvol {
namespace {

constexpr double invisible = 1e-3;  // opacity

// A part of a ray without layers in it.
struct Stretch {
  double begin, end;  // distances
  double passing;     // share of the light that the layers in front let pass
};

// Returns the parts between layers, which are sorted.
std::vector<Stretch> stretches_between(std::span<const PickLayer> layers, double last) {
  std::vector<Stretch> stretches;
  double begin = 0, passing = 1;
  for (const PickLayer& layer : layers) {
    stretches.push_back({begin, layer.distance, passing});
    begin = layer.distance;
    passing *= 1 - layer.opacity;
  }
  stretches.push_back({begin, std::max(begin, last), passing});
  return stretches;
}

// Returns the least distance in [low, high] with this opacity.
double distance_of(const VolumeOnRay& volume, double opacity, double low, double high) {
  for (double middle = 0.5 * (low + high); low < middle && middle < high; middle = 0.5 * (low + high))
    (volume.opacity_up_to(middle) < opacity ? low : high) = middle;
  return high;
}

// Where the volume has half of its share of the light.
double middle_of(const VolumeOnRay& volume, std::span<const Stretch> stretches, double share) {
  double left = 0.5 * share;
  for (const auto& [begin, end, passing] : stretches) {
    const double before = volume.opacity_up_to(begin), after = volume.opacity_up_to(end);
    if (passing * (after - before) >= left) return distance_of(volume, before + left / passing, begin, end);
    left -= passing * (after - before);
  }
  return stretches.back().end;
}

struct Hit {
  double distance;
  std::size_t triangle;
  std::array<double, 3> shares;  // of its corners
  bool from_outside;             // as Surface::opacity has it
};

// Returns where a ray meets a mesh, by distances. Rounding opens no gap between triangles.
std::vector<Hit> hits_of(const TriangleMesh& mesh, const View& along) {
  constexpr double beside = -1e-12;  // share of a corner
  std::vector<Hit> hits;
  for (std::size_t triangle = 0; triangle < mesh.triangles.size(); ++triangle) {
    const auto& [i, j, k] = mesh.triangles[triangle];
    const dvec3 &p = mesh.points[i], u = mesh.points[j] - p, v = mesh.points[k] - p;
    const dvec3 across = glm::cross(along.forward, v), from = along.eye - p, turned = glm::cross(from, u);
    const double determinant = glm::dot(u, across);
    if (determinant == 0) continue;
    const double s = glm::dot(from, across) / determinant, t = glm::dot(along.forward, turned) / determinant;
    const double distance = glm::dot(v, turned) / determinant;
    if (s >= beside && t >= beside && s + t <= 1 - beside && distance > 0 && !is_clipped(along, 0, 0, distance))
      hits.push_back({distance, triangle, {1 - s - t, s, t}, determinant > 0});
  }
  std::ranges::sort(hits, {}, &Hit::distance);
  const auto is_one = [](const Hit& a, const Hit& b) { return b.distance - a.distance <= 1e-12 * b.distance; };
  const auto twice = std::ranges::unique(hits, is_one);
  hits.erase(twice.begin(), twice.end());
  return hits;
}

PickedValue value_on(const Surface& surface, const Hit& hit, const VolumeOnRay& volume) {
  if (!surface.values) {
    constexpr double beside = 1e-5;  // of the distance: positions on it may be beside all cells by rounding
    for (const double factor : {1.0, 1 - beside, 1 + beside})
      if (PickedValue found = volume.value_at(factor * hit.distance); !std::isnan(found.value)) return found;
    return volume.value_at(hit.distance);
  }
  return {surface.values->attribute, surface.value(hit.triangle, hit.shares)};
}

// Slices without a value at the place are not there.
void add_slices(std::span<const SceneSlice> slices, const View& along, const VolumeOnRay& volume,
                std::vector<PickLayer>& layers) {
  for (std::size_t i = 0; i < slices.size(); ++i) {
    if (!slices[i].shown || !(slices[i].opacity > 0)) continue;
    const Plane plane = make_plane(slices[i].point, slices[i].normal);
    const double distance = PlaneDepths(along, plane).at(0, 0);
    if (!std::isfinite(distance)) continue;
    if (PickedValue found = volume.value_on(plane, distance); !std::isnan(found.value))
      layers.push_back({Pick::Kind::slice,
                        "slice " + std::to_string(i + 1),
                        distance,
                        std::min(slices[i].opacity, 1.0),
                        {std::move(found)}});
  }
}

void add_surfaces(std::span<const Surface> surfaces, const View& along, const VolumeOnRay& volume,
                  std::vector<PickLayer>& layers) {
  for (const Surface& surface : surfaces) {
    if (!surface.is_visible()) continue;
    const SceneSurface& style = surface.style;
    for (const Hit& hit : hits_of(*surface.mesh, along)) {
      const double opacity = std::min(surface.opacity(hit.triangle, hit.from_outside), 1.0);
      if (opacity > 0)
        layers.push_back({Pick::Kind::surface,
                          style.boundary.empty() ? style.file : style.boundary,
                          hit.distance,
                          opacity,
                          {value_on(surface, hit, volume)}});
    }
  }
}

}  // namespace

Looking looking_through(const View& view, double x, double y) {
  const dvec3 aside = (x - 0.5 * view.width) / view.focal * view.right + (0.5 * view.height - y) / view.focal * view.up;
  if (view.orthographic) return {{view.eye + aside, view.forward}, 1 / view.focal, true};
  return {{view.eye, glm::normalize(view.forward + aside)}, 1 / view.focal, false};
}

View view_along(const Ray& ray, const ClipRegion& clip) {
  View view;
  view.eye = ray.origin;
  view.forward = ray.direction;
  view.orthographic = true;
  view.width = view.height = 1;
  const dvec3 size = glm::abs(ray.direction);
  const dvec3 aside = size.x <= size.y && size.x <= size.z ? dvec3(1, 0, 0)
                      : size.y <= size.z                   ? dvec3(0, 1, 0)
                                                           : dvec3(0, 0, 1);
  view.right = glm::normalize(glm::cross(ray.direction, aside));
  view.up = glm::cross(view.right, view.forward);
  view.clip = clip;
  return view;
}

std::optional<Pick> pick(const Ray& ray, const VolumeOnRay& volume, std::vector<PickLayer> layers, const Scene& scene,
                         std::span<const Surface> surfaces, const ClipRegion& clip) {
  const View along = view_along(ray, clip);
  add_slices(scene.slices, along, volume, layers);
  add_surfaces(surfaces, along, volume, layers);
  std::ranges::stable_sort(layers, {}, &PickLayer::distance);
  std::vector<Pick::Row> rows = volume.rows();
  const auto stretches = stretches_between(layers, rows.empty() ? 0 : rows.back().distance);
  double of_volume = 0, most = 0;
  const PickLayer* largest = nullptr;
  for (std::size_t i = 0; i < stretches.size(); ++i) {
    const auto& [begin, end, passing] = stretches[i];
    const double opacity = volume.opacity_up_to(end);
    of_volume += passing * (opacity - volume.opacity_up_to(begin));
    if (i == layers.size()) break;
    const double share = passing * (1 - opacity) * layers[i].opacity;
    if (share > most) most = share, largest = &layers[i];
  }
  const double passed = stretches.back().passing * (1 - volume.opacity_up_to(stretches.back().end));
  if (!(1 - passed >= invisible)) return {};
  Pick found{.opacity = 1 - passed, .rows = std::move(rows)};
  double distance = 0;
  if (largest && most > of_volume) {
    found.kind = largest->kind;
    found.name = largest->name;
    found.values = largest->values;
    distance = largest->distance;
  } else {
    distance = middle_of(volume, stretches, of_volume);
    found.values = {volume.value_at(distance)};
  }
  found.position = ray.at(distance);
  return found;
}

double light_from(const Ray& ray, const VolumeOnRay& volume, std::vector<PickLayer> layers, const Scene& scene,
                  std::span<const Surface> surfaces, const ClipRegion& clip, double distance) {
  constexpr double beside = 1e-5;  // of the distance: surfaces are as far beside cells by rounding
  const View along = view_along(ray, clip);
  add_slices(scene.slices, along, volume, layers);
  add_surfaces(surfaces, along, volume, layers);
  double light = 1 - volume.opacity_up_to(distance);
  for (const PickLayer& layer : layers)
    if (layer.distance < (1 - beside) * distance) light *= 1 - layer.opacity;
  return light;
}

}  // namespace splatvol
