#include "renderer/surfaces/draw_surfaces.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <compare>
#include <cstdint>
#include <limits>

#include "base/parallel.h"
#include "scene/clipped_depths.h"
#include "scene/tile_grid.h"

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

constexpr double largest_depth = std::numeric_limits<float>::max();

constexpr int tile_side = 32;
constexpr std::size_t block_triangles = std::size_t{1} << 18;  // that are sorted into tiles at once
constexpr std::size_t most_entries = std::size_t{1} << 22;     // of the tiles' lists, unless one triangle has more

// Joined layers end where so little light passes: it is not seen.
constexpr float least_light = 1.0F / 4096;

// Colour of an edge, as a share of the surface's.
constexpr double edge_brightness = 0.15;

// The place where a ray meets a triangle. Triangles of all surfaces are numbered; the number decides between places of
// the same depth, so that the order does not depend on threads.
struct Hit {
  static constexpr std::uint64_t none = std::numeric_limits<std::uint64_t>::max();
  double depth = infinity;
  std::uint64_t triangle = none;

  [[nodiscard]] auto operator<=>(const Hit&) const = default;
  [[nodiscard]] bool is_one() const { return triangle != none; }
};

// Returns a d - b c with the right sign (Kahan).
double determinant(double a, double b, double c, double d) {
  const double first = a * d, second = b * c, difference = first - second;
  if (std::abs(difference) > 1e-15 * (std::abs(first) + std::abs(second))) return difference;
  return std::fma(a, d, -second) + std::fma(-b, c, second);
}

// A triangle as the rays of pixels see it: the points (a z, b z, z), or (a, b, z) in orthographic projection.
//
// The corners are sheared along the ray to (u, v), so that the ray becomes the line u = v = 0. It meets the triangle if
// the determinants u_i v_j - u_j v_i of the edges have one sign. They are also the barycentric coordinates of the
// place, up to a factor. This holds for triangles of any size, in front of the eye and round it. The signs are exact,
// and neighbours see the same corners, so there are no holes between them.
class TriangleOnRays {
 public:
  TriangleOnRays(const std::array<dvec3, 3>& corners, bool orthographic) : corners_(corners) {
    for (std::size_t k = 0; k < 3; ++k) w_[k] = orthographic ? 1 : corners[k].z;
  }

  void select_row(double b) {
    for (std::size_t k = 0; k < 3; ++k) v_[k] = corners_[k].y - b * w_[k];
  }

  // Returns the depth of the place; NaN if the ray, with the row's b, misses the triangle.
  [[nodiscard]] double depth(double a) {
    shear(a);
    const std::array<double, 3> e{edge(0), edge(1), edge(2)};
    const int side = side_of(0, e[0]);
    if (side == 0 || side != side_of(1, e[1]) || side != side_of(2, e[2]))
      return std::numeric_limits<double>::quiet_NaN();
    return (e[0] * corners_[0].z + e[1] * corners_[1].z + e[2] * corners_[2].z) / (e[0] + e[1] + e[2]);
  }

  // Whether the corners run counterclockwise as the ray sees them. It must meet the triangle.
  [[nodiscard]] bool is_from_outside(double a) {
    shear(a);
    return side_of(0, edge(0)) > 0;
  }

  // Returns the shares of the corners at the place; they sum up to 1.
  [[nodiscard]] std::array<double, 3> shares(double a) {
    shear(a);
    const std::array<double, 3> e{edge(0), edge(1), edge(2)};
    const double sum = e[0] + e[1] + e[2];
    return {e[0] / sum, e[1] / sum, e[2] / sum};
  }

  // Returns the distance from the nearest edge, as a difference of a and b.
  [[nodiscard]] double distance_from_edges(double a) {
    shear(a);
    double nearest = infinity;
    for (std::size_t k = 0; k < 3; ++k)
      nearest = std::min(nearest, std::abs(edge(k)) / glm::length(dvec2(slope_along_a(k), slope_along_b(k))));
    return nearest;
  }

 private:
  void shear(double a) {
    for (std::size_t k = 0; k < 3; ++k) u_[k] = corners_[k].x - a * w_[k];
  }

  // The determinant of the edge opposite to corner k, and how it changes with the ray.
  [[nodiscard]] double edge(std::size_t k) const {
    return determinant(u_[next(k)], v_[next(k)], u_[last(k)], v_[last(k)]);
  }
  [[nodiscard]] double slope_along_a(std::size_t k) const {
    return determinant(v_[next(k)], w_[next(k)], v_[last(k)], w_[last(k)]);
  }
  [[nodiscard]] double slope_along_b(std::size_t k) const {
    return determinant(w_[next(k)], u_[next(k)], w_[last(k)], u_[last(k)]);
  }
  static std::size_t next(std::size_t k) { return k == 2 ? 0 : k + 1; }
  static std::size_t last(std::size_t k) { return k == 0 ? 2 : k - 1; }

  // The ray counts as moved a little in a, and less in b, so that one triangle of an edge has it.
  [[nodiscard]] int side_of(std::size_t k, double e) const {
    if (e == 0) e = slope_along_a(k);
    if (e == 0) e = slope_along_b(k);
    return e > 0 ? 1 : e < 0 ? -1 : 0;
  }

  std::array<dvec3, 3> corners_;
  std::array<double, 3> w_{}, u_{}, v_{};
};

// A surface in view coordinates.
struct ViewedSurface {
  const Surface* surface;
  std::uint64_t first;  // number of its first triangle
  std::vector<dvec3> points;

  [[nodiscard]] std::array<dvec3, 3> corners(std::size_t triangle) const {
    const auto& [a, b, c] = surface->mesh->triangles[triangle];
    return {points[a], points[b], points[c]};
  }
};

// Draws triangles tile by tile.
class SurfaceDrawing {
 public:
  SurfaceDrawing(std::span<const Surface> surfaces, std::span<const SlicePicture> slices, const View& view)
      : view_(view), slices_(slices), tiles_(tile_side, view.width, view.height) {
    std::uint64_t first = 0;
    for (const Surface& surface : surfaces) {
      if (!surface.is_visible()) continue;
      const std::vector<dvec3>& points = surface.mesh->points;
      ViewedSurface& viewed = surfaces_.emplace_back(&surface, first, std::vector<dvec3>(points.size()));
      parallel_for(std::size_t{0}, points.size(), [&](std::size_t i) { viewed.points[i] = view.to_view(points[i]); });
      first += surface.mesh->triangles.size();
    }
    first_slice_ = first;
  }

  SurfaceLayers draw(std::size_t most_layers);

 private:
  [[nodiscard]] bool has_translucent() const;
  [[nodiscard]] std::size_t pixels() const { return static_cast<std::size_t>(view_.width) * view_.height; }
  [[nodiscard]] std::vector<Hit> nearest_opaque() const;
  [[nodiscard]] std::vector<Hit> next_translucent(const std::vector<Hit>& opaque, const std::vector<Hit>& before) const;
  [[nodiscard]] PixelRectangle bounds_of(const std::array<dvec3, 3>& corners) const;
  template <class Visit>
  void visit_hits(const ViewedSurface& surface, bool opaque, const Visit& visit) const;
  template <class Visit>
  void visit_tile(const ViewedSurface& surface, bool opaque, std::size_t first,
                  std::span<const std::uint32_t> triangles, std::span<const PixelRectangle> bounds,
                  const PixelRectangle& tile, const Visit& visit) const;
  template <class Visit>
  void visit_slices(bool opaque, const Visit& visit) const;
  [[nodiscard]] SurfaceLayer layer_of(const std::vector<Hit>& hits, const std::vector<Hit>& opaque) const;
  void join(SurfaceLayer& layer, const std::vector<Hit>& hits, const std::vector<Hit>& opaque) const;
  [[nodiscard]] vec4 shade(const Hit& hit, int x, int y) const;

  // The ray through a pixel's centre.
  [[nodiscard]] double a_of(int x) const { return (x + 0.5 - 0.5 * view_.width) / view_.focal; }
  [[nodiscard]] double b_of(int y) const { return (y + 0.5 - 0.5 * view_.height) / view_.focal; }
  [[nodiscard]] std::size_t pixel(int x, int y) const {
    return static_cast<std::size_t>(view_.height - 1 - y) * view_.width + x;
  }

  const View& view_;
  std::span<const SlicePicture> slices_;
  TileGrid tiles_;
  std::vector<ViewedSurface> surfaces_;
  std::uint64_t first_slice_ = 0;  // slices are numbered behind the triangles
};

bool SurfaceDrawing::has_translucent() const {
  const auto is_translucent = [](const vec4& light) { return light.a > 0 && light.a < 1; };
  return std::ranges::any_of(surfaces_, [](const ViewedSurface& one) { return one.surface->has_translucent(); }) ||
         std::ranges::any_of(slices_, [&](const SlicePicture& slice) {
           return std::ranges::any_of(slice.light.pixels, is_translucent);
         });
}

// Returns the pixels whose centres may show a triangle; never too few.
PixelRectangle SurfaceDrawing::bounds_of(const std::array<dvec3, 3>& corners) const {
  constexpr double margin = 1e-6;  // of a pixel
  dvec2 low(infinity), high(-infinity);
  for (std::size_t k = 0; k < 3; ++k) {
    const dvec3 &p = corners[k], &next = corners[(k + 1) % 3];
    if (view_.orthographic || p.z > 0) {
      const dvec2 at = dvec2(p) / (view_.orthographic ? 1 : p.z);
      low = glm::min(low, at), high = glm::max(high, at);
    }
    if (view_.orthographic || (p.z > 0) == (next.z > 0)) continue;
    // The edge passes the eye's plane: in the picture it has no end there.
    const dvec3 through = p + (p.z / (p.z - next.z)) * (next - p);
    const double rounding = 1e-9 * std::max(glm::length(p), glm::length(next));
    for (int axis = 0; axis < 2; ++axis) {
      if (through[axis] > -rounding) high[axis] = infinity;
      if (through[axis] < rounding) low[axis] = -infinity;
    }
  }
  const auto first = [&](double at, int size) {
    return static_cast<int>(std::clamp(std::ceil(view_.focal * at + 0.5 * size - 0.5 - margin), 0.0, double(size)));
  };
  const auto last = [&](double at, int size) {
    return static_cast<int>(std::clamp(std::floor(view_.focal * at + 0.5 * size - 0.5 + margin), -1.0, size - 1.0));
  };
  return {first(low.x, view_.width), last(high.x, view_.width), first(low.y, view_.height), last(high.y, view_.height)};
}

template <class Visit>
void SurfaceDrawing::visit_tile(const ViewedSurface& surface, bool opaque, std::size_t first,
                                std::span<const std::uint32_t> triangles, std::span<const PixelRectangle> bounds,
                                const PixelRectangle& tile, const Visit& visit) const {
  for (const std::uint32_t i : triangles) {
    TriangleOnRays triangle(surface.corners(first + i), view_.orthographic);
    const PixelRectangle& all = bounds[i];
    for (int y = std::max(all.y0, tile.y0); y <= std::min(all.y1, tile.y1); ++y) {
      triangle.select_row(b_of(y));
      for (int x = std::max(all.x0, tile.x0); x <= std::min(all.x1, tile.x1); ++x) {
        const double depth = triangle.depth(a_of(x));
        if (!(depth > 0 && depth < infinity) || is_clipped(view_, a_of(x), b_of(y), depth)) continue;
        const double opacity = surface.surface->opacity(first + i, triangle.is_from_outside(a_of(x)));
        if (opacity > 0 && (opacity >= 1) == opaque) visit(pixel(x, y), Hit{depth, surface.first + first + i});
      }
    }
  }
}

// Calls `visit` with each place where a ray meets the surface: in parallel, but one place of a pixel after the other.
// Only places that are opaque, or only translucent ones.
template <class Visit>
void SurfaceDrawing::visit_hits(const ViewedSurface& surface, bool opaque, const Visit& visit) const {
  const std::size_t triangles = surface.surface->mesh->triangles.size();
  std::vector<PixelRectangle> bounds;
  std::vector<std::uint32_t> starts, entries, next;
  for (std::size_t first = 0; first < triangles; first += block_triangles) {
    bounds.resize(std::min(block_triangles, triangles - first));
    parallel_for(std::size_t{0}, bounds.size(),
                 [&](std::size_t i) { bounds[i] = bounds_of(surface.corners(first + i)); });
    for (std::size_t begin = 0, end = 0; begin < bounds.size(); begin = end) {
      starts.assign(tiles_.count() + 1, 0);
      std::size_t count = 0;
      for (end = begin; end < bounds.size() && count < most_entries; ++end)
        tiles_.visit_tiles(bounds[end], [&](std::size_t tile) { ++starts[tile + 1], ++count; });
      for (std::size_t tile = 0; tile < tiles_.count(); ++tile) starts[tile + 1] += starts[tile];
      entries.resize(count);
      next.assign(starts.begin(), starts.end() - 1);
      for (std::size_t i = begin; i < end; ++i)
        tiles_.visit_tiles(bounds[i], [&](std::size_t tile) { entries[next[tile]++] = static_cast<std::uint32_t>(i); });
      parallel_for(std::size_t{0}, tiles_.count(), [&](std::size_t tile) {
        if (starts[tile] == starts[tile + 1]) return;
        visit_tile(surface, opaque, first, std::span(entries).subspan(starts[tile], starts[tile + 1] - starts[tile]),
                   bounds, tiles_.tile(tile), visit);
      });
    }
  }
}

// Calls `visit` with each pixel of the slices that are opaque, or of those that are not: in parallel.
template <class Visit>
void SurfaceDrawing::visit_slices(bool opaque, const Visit& visit) const {
  for (std::size_t k = 0; k < slices_.size(); ++k) {
    const SlicePicture& slice = slices_[k];
    parallel_for(std::size_t{0}, pixels(), [&](std::size_t i) {
      const float alpha = slice.light.pixels[i].a;
      if (slice.depths[i] < infinity && alpha > 0 && (alpha >= 1) == opaque)
        visit(i, Hit{slice.depths[i], first_slice_ + k});
    });
  }
}

std::vector<Hit> SurfaceDrawing::nearest_opaque() const {
  std::vector<Hit> nearest(pixels());
  for (const ViewedSurface& surface : surfaces_)
    if (surface.surface->style.opacity >= 1)
      visit_hits(surface, true,
                 [&](std::size_t pixel, const Hit& hit) { nearest[pixel] = std::min(nearest[pixel], hit); });
  visit_slices(true, [&](std::size_t pixel, const Hit& hit) { nearest[pixel] = std::min(nearest[pixel], hit); });
  return nearest;
}

// Returns the nearest translucent surfaces behind those of `before` and in front of the opaque ones. `before` may be
// empty: the nearest of all.
std::vector<Hit> SurfaceDrawing::next_translucent(const std::vector<Hit>& opaque,
                                                  const std::vector<Hit>& before) const {
  std::vector<Hit> nearest(pixels());
  const auto visit = [&](std::size_t pixel, const Hit& hit) {
    if (hit < nearest[pixel] && hit.depth < opaque[pixel].depth && (before.empty() || before[pixel] < hit))
      nearest[pixel] = hit;
  };
  for (const ViewedSurface& surface : surfaces_)
    if (surface.surface->has_translucent()) visit_hits(surface, false, visit);
  visit_slices(false, visit);
  return nearest;
}

// Returns the light of a surface in a pixel.
vec4 SurfaceDrawing::shade(const Hit& hit, int x, int y) const {
  if (!hit.is_one()) return vec4(0);
  if (hit.triangle >= first_slice_)
    return slices_[static_cast<std::size_t>(hit.triangle - first_slice_)].light.pixels[pixel(x, y)];
  const ViewedSurface& surface = *(std::ranges::upper_bound(surfaces_, hit.triangle, {}, &ViewedSurface::first) - 1);
  const SceneSurface& style = surface.surface->style;
  const auto number = static_cast<std::size_t>(hit.triangle - surface.first);
  const auto corners = surface.corners(number);
  const double a = a_of(x), b = b_of(y);
  const dvec3 ray = view_.orthographic ? dvec3(0, 0, 1) : glm::normalize(dvec3(a, b, 1));
  const dvec3 normal = glm::cross(corners[1] - corners[0], corners[2] - corners[0]);
  const double length = glm::length(normal);
  double brightness = Lighting{}.factor(ray, length > 0 ? normal / length : dvec3(0));
  TriangleOnRays triangle(corners, view_.orthographic);
  triangle.select_row(b);
  if (style.edges) {
    const double line = std::clamp(1 - view_.focal * triangle.distance_from_edges(a), 0.0, 1.0);
    brightness *= 1 + line * (edge_brightness - 1);
  }
  dvec3 color = style.color;
  if (surface.surface->values)
    if (const double value = surface.surface->value(number, triangle.shares(a)); !std::isnan(value))
      color = style.color_by->function.color(value);
  const double opacity = surface.surface->opacity(number, triangle.is_from_outside(a));
  return {vec3(opacity * brightness * color), static_cast<float>(opacity)};
}

// Returns the layer of the translucent places, and of the opaque ones in all other pixels.
SurfaceLayer SurfaceDrawing::layer_of(const std::vector<Hit>& hits, const std::vector<Hit>& opaque) const {
  SurfaceLayer layer{{view_.width, view_.height, std::vector<float>(pixels())},
                     {view_.width, view_.height, std::vector<vec4>(pixels())}};
  parallel_for(0, view_.height, [&](int y) {
    for (int x = 0; x < view_.width; ++x) {
      const std::size_t i = pixel(x, y);
      const Hit& hit = !hits.empty() && hits[i].is_one() ? hits[i] : opaque[i];
      layer.depths.depths[i] = static_cast<float>(hit.is_one() ? std::min(hit.depth, largest_depth) : infinity);
      layer.light.pixels[i] = shade(hit, x, y);
    }
  });
  return layer;
}

// Adds all further translucent places to a layer, behind `hits`, which it has.
void SurfaceDrawing::join(SurfaceLayer& layer, const std::vector<Hit>& hits, const std::vector<Hit>& opaque) const {
  for (auto more = next_translucent(opaque, hits); std::ranges::any_of(more, &Hit::is_one);
       more = next_translucent(opaque, more)) {
    parallel_for(0, view_.height, [&](int y) {
      for (int x = 0; x < view_.width; ++x) {
        const std::size_t i = pixel(x, y);
        vec4& light = layer.light.pixels[i];
        if (light.a > 1 - least_light) more[i] = {};
        light += (1 - light.a) * shade(more[i], x, y);
      }
    });
  }
}

SurfaceLayers SurfaceDrawing::draw(std::size_t most_layers) {
  SurfaceLayers result;
  if (surfaces_.empty() && slices_.empty()) return result;
  const std::vector<Hit> opaque = nearest_opaque();
  std::vector<Hit> hits;
  while (has_translucent()) {
    auto next = next_translucent(opaque, hits);
    if (std::ranges::none_of(next, &Hit::is_one)) break;
    if (result.layers.size() == most_layers) {
      result.is_joined = true;
      join(result.layers.back(), hits, opaque);
      break;
    }
    result.layers.push_back(layer_of(next, opaque));
    hits = std::move(next);
  }
  // What lies behind the translucent ones.
  if (!result.layers.empty() || std::ranges::any_of(opaque, &Hit::is_one))
    result.layers.push_back(layer_of({}, opaque));
  return result;
}

}  // namespace

std::vector<double> slice_depths(const View& view, const Plane& plane) {
  std::vector<double> depths(static_cast<std::size_t>(view.width) * view.height, infinity);
  const PlaneDepths on_rays(view, plane);
  parallel_for(0, view.height, [&](int row) {
    const double b = (0.5 * view.height - row - 0.5) / view.focal;
    for (int x = 0; x < view.width; ++x)
      depths[static_cast<std::size_t>(row) * view.width + x] = on_rays.at((x + 0.5 - 0.5 * view.width) / view.focal, b);
  });
  return depths;
}

SlicePicture color_slice(const View& view, const Slice& slice, std::vector<double> depths,
                         std::span<const double> values, const TransferFunction& function) {
  SlicePicture picture{std::move(depths), {view.width, view.height, std::vector<vec4>(values.size(), vec4(0))}};
  parallel_for(std::size_t{0}, values.size(), [&](std::size_t i) {
    if (!std::isfinite(values[i]))
      picture.depths[i] = infinity;
    else if (picture.depths[i] < infinity)
      picture.light.pixels[i] =
          vec4(vec3(slice.opacity * function.color(values[i])), static_cast<float>(slice.opacity));
  });
  return picture;
}

SurfaceLayers draw_surfaces(std::span<const Surface> surfaces, std::span<const SlicePicture> slices, const View& view,
                            std::size_t most_layers) {
  return SurfaceDrawing(surfaces, slices, view).draw(most_layers);
}

void SurfaceComposite::add(const Image& volume, const SurfaceLayer& layer) {
  if (light_.pixels.empty()) {
    light_ = {volume.width, volume.height, std::vector<vec4>(volume.pixels.size(), vec4(0, 0, 0, 1))};
    volume_ = {volume.width, volume.height, std::vector<vec4>(volume.pixels.size(), vec4(0))};
  }
  parallel_for(std::size_t{0}, volume.pixels.size(), [&](std::size_t i) {
    vec4& light = light_.pixels[i];
    const vec4 &front = volume.pixels[i], &surface = layer.light.pixels[i];
    const vec3 between = vec3(front) - vec3(volume_.pixels[i]);
    light = vec4(vec3(light) + light.a * (between + (1 - front.a) * vec3(surface)), light.a * (1 - surface.a));
  });
  volume_ = volume;
}

Image SurfaceComposite::finish() {
  for (std::size_t i = 0; i < light_.pixels.size(); ++i) {
    float& alpha = light_.pixels[i].a;
    alpha = 1 - alpha * (1 - volume_.pixels[i].a);
  }
  return std::move(light_);
}

}  // namespace splatvol
