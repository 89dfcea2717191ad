#include "renderer/reference/reference.h"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/info.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <limits>
#include <mutex>
#include <vector>

#include "base/point_gradients.h"
#include "renderer/reference/cell.h"
#include "scene/clipped_depths.h"
#include "scene/emission_absorption.h"

namespace splatvol {
namespace {

constexpr int tile_side = 16;

/// Most segments that a thread holds at once; a tile with more is drawn in parts.
constexpr std::size_t segment_limit = std::size_t{1} << 20;

/// Most segments for which a pixel keeps its memory for the next tile.
constexpr std::size_t kept_capacity = 4096;

/// Values beyond count as this one. It lies outside of every scene's domain, and its products with areas do not
/// overflow.
constexpr double largest_value = 1e100;

/// Draws the picture tile by tile; each tile needs only the cells whose bounds touch it.
class CellProjection {
 public:
  CellProjection(const TetMesh& mesh, const View& view, const Scene& scene, const SurfaceDepths* surfaces)
      : mesh_(mesh),
        view_(view),
        surfaces_(surfaces),
        transfer_(scene.transfer_function),
        opacity_(scene.opacity ? std::optional<PiecewiseTransfer>(scene.opacity->function) : std::nullopt),
        lighting_(scene.lighting),
        contours_(contours_of(scene)),
        tiles_(tile_side, view.width, view.height) {
    image_.width = view.width;
    image_.height = view.height;
    image_.pixels.resize(static_cast<std::size_t>(view.width) * view.height, vec4(0));
  }

  ReferencePicture render(const std::function<void(double)>& progress) {
    transform_points();
    if (!contours_.surfaces.empty()) find_normals();
    bound_cells();
    fill_tiles();
    draw_tiles(progress);
    return {std::move(image_), segments_};
  }

 private:
  struct Segment : Crossing {
    double lighting;               // factor of the colour
    Ends opacity_values{};         // if the scene has an opacity
    std::array<Ends, 3> normal{};  // the gradient as contours have it, in view coordinates
    Ends color_values{};           // if an attribute colours contours
  };

  /// The segments of a part of a tile, by pixel; kept between tiles for its memory.
  struct Scratch {
    std::vector<std::vector<Segment>> pixels;
    std::size_t count = 0;
  };

  void transform_points();
  void bound_cells();
  [[nodiscard]] bool is_missing(std::size_t cell) const;
  [[nodiscard]] CellCorners corners(std::size_t cell) const;
  [[nodiscard]] std::array<double, 4> values(std::size_t cell, std::span<const double> all) const;
  [[nodiscard]] dvec3 gradient(std::size_t cell) const;
  [[nodiscard]] dvec3 direction(const PixelRay& ray) const;
  void find_normals();
  [[nodiscard]] bool has_contour(const std::array<double, 4>& values) const;

  void fill_tiles();

  template <class Visit>
  void visit_contours(const Segment& segment, const Visit& visit) const;

  void draw_tiles(const std::function<void(double)>& progress);
  void draw_area(std::span<const std::uint32_t> cells, const PixelRectangle& area, Scratch& scratch);
  void gather_cell(std::size_t cell, const PixelRectangle& area, Scratch& scratch) const;
  [[nodiscard]] double surface_depth(int x, int y) const;
  vec4 integrate(const PixelRay& ray, double surface, std::vector<Segment>& segments) const;

  const TetMesh& mesh_;
  const View& view_;
  const SurfaceDepths* surfaces_;
  PiecewiseTransfer transfer_;
  std::optional<PiecewiseTransfer> opacity_;
  std::optional<Lighting> lighting_;
  Contours contours_;
  Image image_;
  TileGrid tiles_;
  std::vector<dvec3> points_;                   // view coordinates
  std::array<std::vector<double>, 3> normals_;  // [axis][point]: of contours, in view coordinates
  std::vector<PixelRectangle> bounds_;          // of each cell
  std::vector<std::uint64_t> tile_starts_;      // into tile_cells_; one more than tiles
  std::vector<std::uint32_t> tile_cells_;
  std::atomic<std::uint64_t> segments_ = 0;
};

void CellProjection::transform_points() {
  points_.resize(mesh_.points.size());
  tbb::parallel_for(std::size_t{0}, points_.size(),
                    [&](std::size_t i) { points_[i] = view_.to_view(mesh_.points[i]); });
}

bool CellProjection::is_missing(std::size_t cell) const {
  return std::ranges::any_of(mesh_.tetrahedra[cell], [&](std::uint32_t point) {
    const dvec3& p = points_[point];
    const std::size_t number = mesh_.constant ? cell : point;
    return !std::isfinite(mesh_.values[number]) || (opacity_ && !std::isfinite(mesh_.opacity_values[number])) ||
           !std::isfinite(p.x + p.y + p.z);
  });
}

CellCorners CellProjection::corners(std::size_t cell) const {
  const auto& [a, b, c, d] = mesh_.tetrahedra[cell];
  return {points_[a], points_[b], points_[c], points_[d]};
}

std::array<double, 4> CellProjection::values(std::size_t cell, std::span<const double> all) const {
  const auto& [a, b, c, d] = mesh_.tetrahedra[cell];
  const auto value = [&](std::size_t i) { return std::clamp(all[i], -largest_value, largest_value); };
  if (mesh_.constant) return {value(cell), value(cell), value(cell), value(cell)};
  return {value(a), value(b), value(c), value(d)};
}

/// Returns the gradient's direction in view coordinates. Computed from world coordinates, whose differences are exact
/// far from the eye too.
dvec3 CellProjection::gradient(std::size_t cell) const {
  const auto& [a, b, c, d] = mesh_.tetrahedra[cell];
  const CellCorners corners{mesh_.points[a], mesh_.points[b], mesh_.points[c], mesh_.points[d]};
  const dvec3 world = gradient_direction(corners, values(cell, mesh_.values));
  return {glm::dot(world, view_.right), glm::dot(world, view_.up), glm::dot(world, view_.forward)};
}

/// Finds the gradients at points in view coordinates, as numbers up to 1.
void CellProjection::find_normals() {
  std::vector<GradientSum> sums(mesh_.points.size());
  add_gradients(mesh_.points, mesh_.tetrahedra, mesh_.values, sums);
  if (!mesh_.vertices.empty()) {
    std::vector<GradientSum> of_vertices(sums.size());
    for (std::size_t i = 0; i < sums.size(); ++i) of_vertices[mesh_.vertices[i]].add(sums[i]);
    for (std::size_t i = 0; i < sums.size(); ++i) sums[i] = of_vertices[mesh_.vertices[i]];
  }
  double largest = 0;
  for (std::vector<double>& axis : normals_) axis.resize(sums.size());
  for (std::size_t i = 0; i < sums.size(); ++i) {
    const dvec3 gradient = sums[i].mean();
    normals_[0][i] = glm::dot(gradient, view_.right);
    normals_[1][i] = glm::dot(gradient, view_.up);
    normals_[2][i] = glm::dot(gradient, view_.forward);
    for (const std::vector<double>& axis : normals_) largest = std::max(largest, std::abs(axis[i]));
  }
  for (std::vector<double>& axis : normals_)
    for (double& component : axis) component /= std::max(largest, std::numeric_limits<double>::min());
}

/// Whether a contour may be in a cell of these values.
bool CellProjection::has_contour(const std::array<double, 4>& values) const {
  const auto [low, high] = std::ranges::minmax(values);
  return std::ranges::any_of(contours_.surfaces,
                             [&](const Contour& contour) { return low <= contour.value && contour.value <= high; });
}

/// Returns the ray's direction in view coordinates, with length 1.
dvec3 CellProjection::direction(const PixelRay& ray) const {
  return view_.orthographic ? dvec3(0, 0, 1) : glm::normalize(dvec3(ray.a, ray.b, 1));
}

void CellProjection::bound_cells() {
  bounds_.resize(mesh_.tetrahedra.size());
  tbb::parallel_for(std::size_t{0}, bounds_.size(), [&](std::size_t cell) {
    bounds_[cell] = is_missing(cell) ? PixelRectangle{0, -1, 0, -1} : pixel_bounds(view_, corners(cell));
  });
}

void CellProjection::fill_tiles() {
  tile_starts_.assign(tiles_.count() + 1, 0);
  for (const PixelRectangle& bounds : bounds_)
    tiles_.visit_tiles(bounds, [&](std::size_t tile) { ++tile_starts_[tile + 1]; });
  for (std::size_t tile = 0; tile < tiles_.count(); ++tile) tile_starts_[tile + 1] += tile_starts_[tile];

  tile_cells_.resize(tile_starts_.back());
  std::vector<std::uint64_t> next(tile_starts_.begin(), tile_starts_.end() - 1);
  for (std::size_t cell = 0; cell < bounds_.size(); ++cell)
    tiles_.visit_tiles(bounds_[cell],
                       [&](std::size_t tile) { tile_cells_[next[tile]++] = static_cast<std::uint32_t>(cell); });
}

void CellProjection::draw_tiles(const std::function<void(double)>& progress) {
  tbb::enumerable_thread_specific<Scratch> scratches;
  std::mutex progress_mutex;
  std::size_t done = 0;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, tiles_.count(), 1), [&](const auto& range) {
    for (std::size_t tile = range.begin(); tile < range.end(); ++tile) {
      const auto cells =
          std::span(tile_cells_).subspan(tile_starts_[tile], tile_starts_[tile + 1] - tile_starts_[tile]);
      draw_area(cells, tiles_.tile(tile), scratches.local());
      if (!progress) continue;
      const std::scoped_lock lock(progress_mutex);
      progress(static_cast<double>(++done) / static_cast<double>(tiles_.count()));
    }
  });
}

void CellProjection::draw_area(std::span<const std::uint32_t> cells, const PixelRectangle& area, Scratch& scratch) {
  const int width = area.x1 - area.x0 + 1;
  const int height = area.y1 - area.y0 + 1;
  scratch.pixels.resize(std::max(scratch.pixels.size(), static_cast<std::size_t>(width) * height));
  for (auto& segments : scratch.pixels) segments.clear();
  scratch.count = 0;
  for (const std::uint32_t cell : cells) {
    gather_cell(cell, area, scratch);
    if (scratch.count <= segment_limit || width * height == 1) continue;

    // Too many segments for one pass: halve the longer side and begin again.
    PixelRectangle first = area;
    PixelRectangle second = area;
    if (width > height)
      second.x0 = (first.x1 = area.x0 + width / 2 - 1) + 1;
    else
      second.y0 = (first.y1 = area.y0 + height / 2 - 1) + 1;
    draw_area(cells, first, scratch);
    draw_area(cells, second, scratch);
    return;
  }

  for (int y = area.y0; y <= area.y1; ++y)
    for (int x = area.x0; x <= area.x1; ++x) {
      auto& segments = scratch.pixels[static_cast<std::size_t>(y - area.y0) * width + (x - area.x0)];
      image_.at(x, view_.height - 1 - y) = integrate(pixel_ray(view_, x, y), surface_depth(x, y), segments);
      if (segments.capacity() > kept_capacity) segments = {};
    }
  segments_ += scratch.count;
}

void CellProjection::gather_cell(std::size_t cell, const PixelRectangle& area, Scratch& scratch) const {
  const PixelRectangle& bounds = bounds_[cell];
  const PixelRectangle common{std::max(area.x0, bounds.x0), std::min(area.x1, bounds.x1), std::max(area.y0, bounds.y0),
                              std::min(area.y1, bounds.y1)};
  if (common.is_empty()) return;

  CellCrosser crosser(view_.orthographic, corners(cell), values(cell, mesh_.values));
  // It crosses on the same segment.
  std::optional<CellCrosser> opacity_crosser;
  if (opacity_) opacity_crosser.emplace(view_.orthographic, corners(cell), values(cell, mesh_.opacity_values));
  std::optional<CellCrosser> color_crosser;
  if (!contours_.attribute.empty())
    color_crosser.emplace(view_.orthographic, corners(cell), values(cell, mesh_.color_values));
  std::vector<CellCrosser> normal_crossers;
  if (has_contour(values(cell, mesh_.values)))
    for (const std::vector<double>& axis : normals_)
      normal_crossers.emplace_back(view_.orthographic, corners(cell), values(cell, axis));
  const dvec3 cell_gradient = lighting_ ? gradient(cell) : dvec3(0);
  const int width = area.x1 - area.x0 + 1;
  for (int y = common.y0; y <= common.y1; ++y) {
    const double b = pixel_ray(view_, 0, y).b;
    if (!crosser.select_row(b) || (opacity_crosser && !opacity_crosser->select_row(b)) ||
        (color_crosser && !color_crosser->select_row(b)))
      continue;
    for (CellCrosser& of_normal : normal_crossers) static_cast<void>(of_normal.select_row(b));
    auto* row = &scratch.pixels[static_cast<std::size_t>(y - area.y0) * width];
    for (int x = common.x0; x <= common.x1; ++x) {
      const PixelRay ray = pixel_ray(view_, x, y);
      const auto crossing = crosser.cross(ray.a);
      if (!crossing || crossing->leave <= std::max(crossing->enter, 0.0)) continue;
      Segment segment{*crossing, lighting_ ? lighting_->factor(direction(ray), cell_gradient) : 1};
      if (opacity_crosser) {
        const auto of_opacity = opacity_crosser->cross(ray.a);
        segment.opacity_values = {of_opacity->value_enter, of_opacity->value_leave};
      }
      for (std::size_t axis = 0; axis < normal_crossers.size(); ++axis) {
        const auto of_normal = normal_crossers[axis].cross(ray.a);
        segment.normal[axis] = {of_normal->value_enter, of_normal->value_leave};
      }
      if (color_crosser) {
        const auto of_color = color_crosser->cross(ray.a);
        segment.color_values = {of_color->value_enter, of_color->value_leave};
      }
      row[x - area.x0].push_back(segment);
      ++scratch.count;
    }
  }
}

/// Returns the depth where a pixel's ray ends; infinity: nowhere.
double CellProjection::surface_depth(int x, int y) const {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  if (!surfaces_) return infinity;
  const double depth = surfaces_->depths[static_cast<std::size_t>(view_.height - 1 - y) * view_.width + x];
  return std::isnan(depth) ? infinity : depth;
}

vec4 CellProjection::integrate(const PixelRay& ray, double surface, std::vector<Segment>& segments) const {
  std::ranges::sort(segments, [](const Segment& a, const Segment& b) {
    return a.enter != b.enter ? a.enter < b.enter : a.leave < b.leave;
  });
  const double world_per_depth = view_.orthographic ? 1 : std::sqrt(1 + ray.a * ray.a + ray.b * ray.b);
  const auto [from, visible_to] = clipped_depths(view_, ray.a, ray.b);
  const double to = std::min(visible_to, surface);
  RayLight light;
  for (const Segment& segment : segments) {
    // The invisible part is cut off only here: the order above is the order of whole cells.
    const auto add_matter = [&](double first, double last) {
      const double enter = std::max(first, from), leave = std::min(last, to);
      if (!(enter < leave)) return;
      const auto between = [&](const Ends& ends) {
        const auto at = [&](double depth) {
          return ends.at((depth - segment.enter) / (segment.leave - segment.enter));
        };
        return Ends{at(enter), leave == segment.leave ? ends.back : at(leave)};
      };
      light.lighting = segment.lighting;
      const Ends values = between({segment.value_enter, segment.value_leave});
      const double length = (leave - enter) * world_per_depth;
      if (opacity_)
        transfer_.add(values, *opacity_, between(segment.opacity_values), length, light);
      else
        transfer_.add(values, length, light);
    };
    double done = segment.enter;
    visit_contours(segment, [&](const Contour& contour, double share) {
      const double depth = segment.enter + share * (segment.leave - segment.enter);
      add_matter(done, depth);
      done = depth;
      if (depth < from || depth > to) return;
      const double value = segment.color_values.at(share);
      if (contour.is_colored && !std::isfinite(value)) return;
      const dvec3 rgb = contour.is_colored ? contours_.colors.color(value) : contour.color;
      const dvec3 normal(segment.normal[0].at(share), segment.normal[1].at(share), segment.normal[2].at(share));
      const double length = glm::length(normal);
      const dvec3 unit = length > 0 ? normal / length : dvec3(0);
      light.add_surface(contours_.lighting.factor(direction(ray), unit) * rgb, contour.opacity);
    });
    add_matter(done, segment.leave);
  }
  return light.rgba();
}

/// Calls visit(contour, share of the segment) for each contour that the ray meets, front to back.
template <class Visit>
void CellProjection::visit_contours(const Segment& segment, const Visit& visit) const {
  const double front = segment.value_enter, back = segment.value_leave;
  const auto visit_one = [&](const Contour& contour) {
    const bool begins_above = front + segment.rounding_enter >= contour.value;
    const bool ends_above = back + segment.rounding_leave >= contour.value;
    if (begins_above == ends_above) return;
    visit(contour, front == back ? 0.0 : std::clamp((contour.value - front) / (back - front), 0.0, 1.0));
  };
  const std::vector<Contour>& contours = contours_.surfaces;
  if (front <= back)
    std::for_each(contours.begin(), contours.end(), visit_one);
  else
    std::for_each(contours.rbegin(), contours.rend(), visit_one);
}

}  // namespace

Status check_mesh(const TetMesh& mesh) {
  const std::size_t expected = mesh.constant ? mesh.tetrahedra.size() : mesh.points.size();
  if (expected != mesh.values.size())
    return fail(ErrorCode::invalid_argument, "{} {} and {} values", expected, mesh.constant ? "tetrahedra" : "points",
                mesh.values.size());
  if (!mesh.opacity_values.empty() && mesh.opacity_values.size() != expected)
    return fail(ErrorCode::invalid_argument, "{} values and {} of the opacity", expected, mesh.opacity_values.size());
  if (!mesh.color_values.empty() && mesh.color_values.size() != expected)
    return fail(ErrorCode::invalid_argument, "{} values and {} of the contours' colours", expected,
                mesh.color_values.size());
  if (!mesh.vertices.empty() && mesh.vertices.size() != mesh.points.size())
    return fail(ErrorCode::invalid_argument, "{} points and {} numbers of vertices", mesh.points.size(),
                mesh.vertices.size());
  for (const std::uint32_t vertex : mesh.vertices)
    if (vertex >= mesh.points.size())
      return fail(ErrorCode::invalid_data, "vertex {} of {}", vertex, mesh.points.size());
  for (std::size_t cell = 0; cell < mesh.tetrahedra.size(); ++cell)
    for (const std::uint32_t point : mesh.tetrahedra[cell])
      if (point >= mesh.points.size())
        return fail(ErrorCode::invalid_data, "tetrahedron {}: point {} of {}", cell, point, mesh.points.size());
  return {};
}

Result<ReferencePicture> render_reference(const TetMesh& mesh, const Scene& scene,
                                          const ReferenceOptions& options) try {
  SPLATVOL_TRY(check_mesh(mesh));
  if (scene.opacity && mesh.opacity_values.size() != mesh.values.size())
    return fail(ErrorCode::invalid_argument, "no values of the opacity attribute '{}'", scene.opacity->attribute);
  const Contours contours = contours_of(scene);
  if (mesh.constant && !contours.surfaces.empty())
    return fail(ErrorCode::invalid_argument, "contours: each cell has one value, and so nothing passes another");
  if (!contours.attribute.empty() && mesh.color_values.size() != mesh.values.size())
    return fail(ErrorCode::invalid_argument, "no values of the attribute '{}' that colours contours",
                contours.attribute);
  SPLATVOL_TRY_ASSIGN(view, make_view(scene));
  const SurfaceDepths* surfaces = options.surface_depths;
  if (surfaces && (surfaces->width != view.width || surfaces->height != view.height ||
                   surfaces->depths.size() != static_cast<std::size_t>(view.width) * view.height))
    return fail(ErrorCode::invalid_argument, "{} depths of surfaces for {} x {} pixels", surfaces->depths.size(),
                view.width, view.height);
  const int machine_threads = tbb::info::default_concurrency();
  tbb::task_arena arena(options.threads > 0 ? std::min(options.threads, machine_threads) : machine_threads);
  return arena.execute([&] { return CellProjection(mesh, view, scene, surfaces).render(options.progress); });
} catch (const std::bad_alloc&) {
  return fail(ErrorCode::out_of_budget, "not enough memory for {} tetrahedra at {} x {} pixels", mesh.tetrahedra.size(),
              scene.width, scene.height);
} catch (const std::exception& error) {
  return fail(ErrorCode::invalid_argument, "{}", error.what());
}

}  // namespace splatvol
