// Places the cells of a chunk on the screen, as far as no instruction set matters.
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

#include "renderer/common.h"
#include "renderer/cpu/cell_frame.h"

namespace splatvol::tiles {
namespace {

// Sorts by the upper halves: by 11 bits of them, three times.
void sort_keys(std::vector<std::uint64_t>& keys, std::vector<std::uint64_t>& scratch) {
  scratch.resize(keys.size());
  for (int shift = 32; shift < 64; shift += 11) {
    const auto digit = [&](std::uint64_t key) { return static_cast<std::size_t>(key >> shift & 2047); };
    std::array<std::uint32_t, 2049> begins{};
    for (const std::uint64_t key : keys) ++begins[digit(key) + 1];
    std::partial_sum(begins.begin(), begins.end(), begins.begin());
    for (const std::uint64_t key : keys) scratch[begins[digit(key)]++] = key;
    std::swap(keys, scratch);
  }
}

// A cell in view coordinates, for all fields in it.
struct CellInSpace {
  explicit CellInSpace(const std::array<dvec3, 4>& of_corners)
      : corners(of_corners),
        across{glm::cross(edge(2), edge(3)), glm::cross(edge(3), edge(1)), glm::cross(edge(1), edge(2))},
        volume(glm::dot(edge(1), across[0])) {}

  // Times the volume.
  [[nodiscard]] dvec3 gradient(const std::array<double, 4>& values) const {
    return (values[1] - values[0]) * across[0] + (values[2] - values[0]) * across[1] +
           (values[3] - values[0]) * across[2];
  }

  std::array<dvec3, 4> corners;  // what follows is made of them
  std::array<dvec3, 3> across;   // products of edges
  double volume;

 private:
  [[nodiscard]] dvec3 edge(std::size_t corner) const { return corners[corner] - corners[0]; }
};

double nearness(const View& view, double depth) { return view.orthographic ? -depth : 1 / depth; }

// The plane of the points of a flat chunk, by least squares of their nearness; none if the chunk is not flat.
std::optional<DepthOrigin> plane_of(const CellFrame& frame, const CellSetup& setup) {
  const View& view = *frame.view;
  std::optional<dvec3> first;
  double count = 0;
  dvec3 sum(0);
  glm::dmat3 products(0);
  for (std::size_t i = 0; i < setup.in_view.size(); ++i) {
    const dvec3& p = setup.in_view[i];
    if (setup.is_used[i] == 0 || p.z <= frame.nearest) continue;
    const double scale = view.orthographic ? view.focal : view.focal / p.z;
    const dvec3 at(p.x * scale, p.y * scale, nearness(view, p.z));
    if (!first) first = at;
    const dvec3 offset = at - *first;
    count += 1, sum += offset, products += glm::outerProduct(offset, offset);
  }
  if (!first) return std::nullopt;
  const dvec3 mean = sum / count;
  const glm::dmat3 spread = products / count - glm::outerProduct(mean, mean);
  const double determinant = spread[0][0] * spread[1][1] - spread[0][1] * spread[0][1];
  const double trace = spread[0][0] + spread[1][1];
  if (!(determinant > 1e-8 * trace * trace)) return std::nullopt;  // seen edge-on
  const double a = (spread[1][1] * spread[0][2] - spread[0][1] * spread[1][2]) / determinant;
  const double b = (spread[0][0] * spread[1][2] - spread[0][1] * spread[0][2]) / determinant;
  const double rest = spread[2][2] - a * spread[0][2] - b * spread[1][2];
  if (!(rest < 0.01 * spread[2][2])) return std::nullopt;
  const dvec3 middle = *first + mean;
  return DepthOrigin{middle.z, a, b, middle.x, middle.y};
}

// The reference is the farthest corner, unless it is far outside of the picture: then its middle, and none is returned.
std::optional<dvec3> set_reference(const CellFrame& frame, const CellInSpace& cell, const DepthOrigin& origin,
                                   CellShading& shading) {
  const View& view = *frame.view;
  const dvec3& farthest_corner =
      *std::ranges::max_element(cell.corners, {}, [](const dvec3& corner) { return corner.z; });
  const dvec2 place = dvec2(farthest_corner) * (view.orthographic ? view.focal : view.focal / farthest_corner.z);
  if (!(std::abs(place.x) <= frame.widest && std::abs(place.y) <= frame.widest)) return std::nullopt;
  shading.x = static_cast<float>(place.x), shading.y = static_cast<float>(place.y);
  shading.d = static_cast<float>(nearness(view, farthest_corner.z) - origin.w - origin.rise(place.x, place.y));
  return farthest_corner;
}

void set_light(const View& view, const dvec3& gradient, const std::optional<dvec3>& reference, CellShading& shading) {
  const double length = glm::length(gradient);
  if (!(length > 0)) return;
  const dvec3 g = gradient / length;
  shading.has_gradient = true;
  if (view.orthographic) {
    shading.l0 = static_cast<float>(g.z);
    return;
  }
  shading.lx = static_cast<float>(g.x / view.focal), shading.ly = static_cast<float>(g.y / view.focal);
  shading.l0 = static_cast<float>(reference ? glm::dot(g, *reference) / reference->z : g.z);
}

FieldOnScreen field_in(const View& view, const CellInSpace& cell, const std::array<double, 4>& values,
                       const std::optional<dvec3>& reference, const DepthOrigin& origin) {
  const dvec3 slope = cell.volume == 0 ? dvec3(0) : cell.gradient(values) / cell.volume;
  FieldOnScreen field{};
  field.low = static_cast<float>(std::ranges::min(values)), field.high = static_cast<float>(std::ranges::max(values));
  field.at = nearest_float(values[0] + glm::dot(slope, reference.value_or(dvec3(0)) - cell.corners[0]));
  double by_depth = 0;
  if (view.orthographic) by_depth = -slope.z;
  if (!view.orthographic && reference) by_depth = -glm::dot(slope, *reference);
  field.x = nearest_float(slope.x / view.focal + by_depth * origin.wx);
  field.y = nearest_float(slope.y / view.focal + by_depth * origin.wy);
  field.d = nearest_float(by_depth);
  if (!reference) field.c = nearest_float(view.orthographic ? by_depth * (origin.w + origin.rise(0, 0)) : slope.z);
  return field;
}

// Whether an interval of u may have extinction.
bool shows_matter(const FunctionPieces& function, float low, float high) {
  const auto bin_of = [&](float u) {
    const float bin = u * static_cast<float>(FunctionPieces::bins) + function.bin_of_origin;
    return static_cast<std::size_t>(std::clamp(bin, 0.0F, static_cast<float>(FunctionPieces::bins + 1)));
  };
  return function.visible_before[bin_of(high) + 1] > function.visible_before[bin_of(low)];
}

bool is_nan(float u) { return std::isnan(u); }

// The numbers of a cell's corners; equal ones if it is constant.
template <class Number>
std::array<Number, 4> of_corners(const Tetrahedra& cells, std::size_t number, const std::vector<Number>& all) {
  std::array<Number, 4> numbers{};
  for (std::size_t k = 0; k < 4; ++k) numbers[k] = all[cells.constant ? number : cells.corners[number][k]];
  return numbers;
}

// [axis of the view][corner]: gradients, of which the largest component is 1 or -1.
std::array<std::array<double, 4>, 3> normals_in(const View& view, std::span<const dvec3> gradients,
                                                const std::array<std::uint32_t, 4>& corners) {
  std::array<std::array<double, 4>, 3> normals{};
  double largest = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    const dvec3& gradient = gradients[corners[k]];
    const dvec3 turned(glm::dot(gradient, view.right), glm::dot(gradient, view.up), glm::dot(gradient, view.forward));
    for (int axis = 0; axis < 3; ++axis) {
      normals[static_cast<std::size_t>(axis)][k] = turned[axis];
      largest = std::max(largest, std::abs(turned[axis]));
    }
  }
  if (!(largest > 0)) return {};
  for (auto& axis : normals)
    for (double& component : axis) component /= largest;
  return normals;
}

// The slices that cut a cell; a bit for each.
std::uint64_t slices_through(const CellSetup& setup, const std::array<std::uint32_t, 4>& corners) {
  if (setup.sides.empty()) return 0;
  std::uint64_t before = 0, behind = 0;
  for (const std::uint32_t corner : corners) before |= setup.sides[corner].before, behind |= setup.sides[corner].behind;
  return before & behind;
}

// Lists what rays may meet in a cell.
EventsOfCell list_events(const CellFrame& frame, const Tetrahedra& cells, std::size_t number, const CellSetup& setup,
                         const CellOnScreen& cell, CellsOnScreen& screen) {
  const std::array<std::uint32_t, 4>& corners = cells.corners[number];
  EventsOfCell events{0, 0, static_cast<std::uint32_t>(screen.contours.size()), 0, slices_through(setup, corners), {}};
  for (std::size_t at = 0; at < 4 && events.slices != 0; ++at) {
    const auto& of_face = face_corners[cell.order >> (2 * at) & 3U];
    std::uint64_t& in_face = events.slices_of_faces[at] = events.slices;
    for (std::size_t k = 0; k < 3; ++k) {
      const CellSetup::Sides& sides = setup.sides[corners[of_face[k]]];
      in_face &= sides.before & sides.behind;
    }
  }
  if (cells.constant) return events;
  const std::vector<double>& values = frame.events->values;
  std::array<double, 4> own{};
  for (std::size_t k = 0; k < 4; ++k) own[k] = cells.values[0][corners[k]];
  const auto [low, high] = std::ranges::minmax(own);
  events.first = static_cast<std::int32_t>(std::ranges::upper_bound(values, low) - values.begin());
  for (events.end = events.first; events.end < frame.events->contours(); ++events.end) {
    const double value = values[static_cast<std::size_t>(events.end)];
    if (high < value) break;
    std::array<float, 4> u{};
    for (std::size_t k = 0; k < 4; ++k) u[k] = u_of(own[k], value, frame.inverse_domain, 0);
    screen.contours.push_back(contour_in(frame, corners, setup, cell, u));
  }
  return events;
}

}  // namespace

void cut_by_slices(const CellFrame& frame, const Box& box, const Tetrahedra& cells, CellSetup& setup) {
  setup.sides.clear();
  setup.is_cut.clear();
  const std::vector<Slice>& slices = frame.view->slices;
  const dvec3 middle = 0.5 * (box.low + box.high), half = 0.5 * box.extent();
  const double margin = 1e-9 * glm::length(half);
  for (std::size_t i = 0; i < slices.size(); ++i) {
    const Plane& plane = slices[i].plane;
    if (std::abs(plane.distance(middle)) > glm::dot(glm::abs(plane.normal), half) + margin) continue;
    setup.sides.resize(cells.points.size(), {0, 0});
    for (std::size_t point = 0; point < cells.points.size(); ++point) {
      const double distance = plane.distance(cells.points[point]);
      if (distance <= margin) setup.sides[point].before |= std::uint64_t{1} << i;
      if (distance >= -margin) setup.sides[point].behind |= std::uint64_t{1} << i;
    }
  }
  if (setup.sides.empty()) return;
  setup.is_cut.assign(cells.size() + most_lanes, 0);
  for (std::size_t i = 0; i < cells.size(); ++i) setup.is_cut[i] = slices_through(setup, cells.corners[i]) != 0 ? 1 : 0;
}

void place_values(const CellFrame& frame, const Tetrahedra& cells, CellSetup& setup) {
  const auto to_u = [](const std::vector<double>& values, double low, double inverse, double origin,
                       std::vector<float>& all) {
    all.resize(values.size());
    for (std::size_t i = 0; i < values.size(); ++i) all[i] = u_of(values[i], low, inverse, origin);
  };
  std::vector<float>& u = setup.points.u;
  to_u(cells.values[0], frame.low, frame.inverse_domain, frame.function->origin, u);
  if (frame.contour_colors)
    to_u(cells.values.back(), frame.contour_low, frame.contour_inverse, frame.contour_colors->origin, setup.colors);
  if (!frame.opacity) return;
  to_u(cells.values[1], frame.opacity_low, frame.opacity_inverse, frame.opacity->origin, setup.opacities);
  // Slices show values whatever the opacity is.
  for (std::size_t i = 0; i < u.size() && frame.view->slices.empty(); ++i)
    if (std::isnan(setup.opacities[i])) u[i] = setup.opacities[i];
}

// Only points of cells that are seen: often they are few.
void place_points(const CellFrame& frame, const Box& box, const Tetrahedra& cells, CellSetup& setup,
                  CellsOnScreen& screen) {
  const View& view = *frame.view;
  const std::size_t count = cells.points.size();
  setup.is_used.assign(count, 0);
  for (const std::int32_t cell : setup.seen)
    for (const std::uint32_t point : cells.corners[static_cast<std::size_t>(cell)]) setup.is_used[point] = 1;
  setup.in_view.resize(count);
  for (std::size_t i = 0; i < count; ++i)
    if (setup.is_used[i] != 0) setup.in_view[i] = view.to_view(cells.points[i]);

  const double middle = 0.5 * (std::max(box.low.z, 0.0) + box.high.z);
  DepthOrigin& origin = screen.origin;
  origin = plane_of(frame, setup).value_or(DepthOrigin{nearness(view, middle)});
  screen.key_offset = static_cast<float>(origin.w - frame.farthest_nearness);

  PointsOnScreen& points = setup.points;
  points.places.resize(count);
  points.is_far_out.resize(count);
  points.has_far_out = false;
  for (std::size_t i = 0; i < count; ++i) {
    if (setup.is_used[i] == 0) continue;
    const dvec3& p = setup.in_view[i];
    const double inverse = 1 / p.z, scale = view.orthographic ? view.focal : view.focal * inverse;
    const double x = p.x * scale, y = p.y * scale;
    PointsOnScreen::Place& place = points.places[i];
    place.x = static_cast<float>(x);
    place.y = static_cast<float>(y);
    place.d = static_cast<float>((view.orthographic ? -p.z : inverse) - origin.w - origin.rise(x, y));
    place.w = static_cast<float>(view.orthographic ? 1 : inverse);
    const bool is_near = std::abs(place.x) <= frame.widest && std::abs(place.y) <= frame.widest;
    points.is_far_out[i] = is_near && p.z > frame.nearest ? 0 : 1;
    points.has_far_out = points.has_far_out || points.is_far_out[i] != 0;
  }
}

void find_events(const CellFrame& frame, const Tetrahedra& cells, const CellSetup& setup, CellsOnScreen& screen) {
  screen.events.resize(screen.cells.size());
  std::uint32_t normals = 0;
  for (std::size_t i = 0; i < screen.cells.size(); ++i) {
    const auto number = static_cast<std::size_t>(setup.numbers[i]);
    CellOnScreen& on_screen = screen.cells[i];
    EventsOfCell& events = screen.events[i] = list_events(frame, cells, number, setup, on_screen, screen);
    const bool is_missing = frame.opacity && std::ranges::any_of(of_corners(cells, number, setup.opacities), is_nan);
    if (is_missing) events.end = events.first;
    events.normal_at = normals;
    if (events.has_contours()) ++normals;
    on_screen.has_events = events.has_contours() || events.slices != 0;
    on_screen.shows_matter = !is_missing && shows_matter(*frame.function, on_screen.low, on_screen.high);
    screen.slices |= events.slices;
  }
  screen.normals.resize(normals);
}

// In double precision, as everything cancels where the eye is far away.
void shade_cells(const CellFrame& frame, const Tetrahedra& cells, std::span<const dvec3> gradients,
                 const CellSetup& setup, CellsOnScreen& screen) {
  screen.shadings.resize(screen.cells.size());
  for (std::size_t i = 0; i < screen.cells.size(); ++i) {
    const bool has_contours = frame.events && screen.events[i].has_contours();
    if (!frame.has_shades() && !has_contours) continue;
    const auto number = static_cast<std::size_t>(setup.numbers[i]);
    const auto [a, b, c, d] = cells.corners[number];
    const CellInSpace cell({setup.in_view[a], setup.in_view[b], setup.in_view[c], setup.in_view[d]});
    CellShading& shading = screen.shadings[i];
    shading = {};
    const std::optional<dvec3> reference = set_reference(frame, cell, screen.origin, shading);
    if (frame.lighting)
      set_light(*frame.view, cell.gradient(of_corners(cells, number, cells.values[0])), reference, shading);
    const auto field = [&](const std::vector<float>& all) {
      const auto [p, q, r, s] = of_corners(cells, number, all);
      return field_in(*frame.view, cell, {p, q, r, s}, reference, screen.origin);
    };
    if (frame.opacity) shading.opacity = field(setup.opacities);
    if (!has_contours) continue;
    const std::array<std::array<double, 4>, 3> normals = normals_in(*frame.view, gradients, cells.corners[number]);
    for (std::size_t axis = 0; axis < 3; ++axis)
      screen.normals[screen.events[i].normal_at][axis] =
          field_in(*frame.view, cell, normals[axis], reference, screen.origin);
    if (!frame.contour_colors) continue;
    shading.has_color = std::ranges::none_of(of_corners(cells, number, setup.colors), is_nan);
    if (shading.has_color) shading.color = field(setup.colors);
  }
}

void sort_into_tiles(CellSetup& setup, CellsOnScreen& screen) {
  sort_keys(setup.keys, setup.sorted);
  if (setup.keys.empty()) return;
  const auto tiles_of = [&](std::uint32_t number) -> const TileBounds& {
    const bool has_found = CellsOnScreen::has_found(number);
    return has_found ? setup.found_tiles[number & ~CellsOnScreen::found_bit] : setup.tiles[number];
  };
  const auto visit_all = [&](const auto& use) {
    for (const auto* tiles : {&setup.tiles, &setup.found_tiles})
      for (const TileBounds& own : *tiles) use(own);
  };
  TileBounds all = tiles_of(static_cast<std::uint32_t>(setup.keys[0]));
  visit_all([&](const TileBounds& own) {
    all = {std::min(all.left, own.left), std::max(all.right, own.right), std::min(all.bottom, own.bottom),
           std::max(all.top, own.top)};
  });
  screen.tiles_left = all.left, screen.tiles_bottom = all.bottom;
  screen.tiles_across = all.right - all.left + 1, screen.tiles_up = all.top - all.bottom + 1;
  const auto visit = [&](const TileBounds& own, const auto& use) {
    for (int row = own.bottom; row <= own.top; ++row)
      for (int column = own.left; column <= own.right; ++column)
        use(static_cast<std::size_t>((row - all.bottom) * screen.tiles_across + column - all.left));
  };
  screen.begins.assign(static_cast<std::size_t>(screen.tiles_across) * static_cast<std::size_t>(screen.tiles_up) + 1,
                       0);
  visit_all([&](const TileBounds& own) { visit(own, [&](std::size_t tile) { ++screen.begins[tile + 1]; }); });
  std::partial_sum(screen.begins.begin(), screen.begins.end(), screen.begins.begin());
  screen.numbers.resize(screen.begins.back());
  setup.next.assign(screen.begins.begin(), screen.begins.end() - 1);
  for (const std::uint64_t key : setup.keys) {
    const auto number = static_cast<std::uint32_t>(key);
    visit(tiles_of(number), [&](std::size_t tile) { screen.numbers[setup.next[tile]++] = number; });
  }
}

}  // namespace splatvol::tiles
