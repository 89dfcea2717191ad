// Cells with a corner behind the eye, or far outside of the picture.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "renderer/common.h"
#include "renderer/cpu/cell_frame.h"

namespace splatvol::tiles {
namespace {

// A plane through three corners of which one may be behind the eye: in double precision, by their places in space.
struct PlaneInSpace {
  CellOnScreen::Face face;
  CellOnScreen::Reference reference;
  bool is_positive;  // as the area on the screen would be
};

PlaneInSpace plane_in_space(const CellFrame& frame, const std::array<dvec3, 3>& p, const std::array<double, 3>& u,
                            const DepthOrigin& origin) {
  const View& view = *frame.view;
  const dvec3 q = p[1] - p[0], r = p[2] - p[0], normal = glm::cross(q, r);
  const double square = std::max(glm::dot(normal, normal), std::numeric_limits<double>::min());
  const dvec3 gradient = ((u[1] - u[0]) * glm::cross(r, normal) + (u[2] - u[0]) * glm::cross(normal, q)) / square;
  const auto not_below = [](double x, double least) { return std::abs(x) < least ? std::copysign(least, x) : x; };
  const auto number = [](double x) { return static_cast<float>(std::clamp(x, -1e18, 1e18)); };
  const auto w_at = [&](const dvec2& pixel) { return origin.w + origin.rise(pixel.x, pixel.y); };
  const auto moved = [&](double d, double a, double b) {
    return number(d + (a - origin.wx) * ray_shift_x + (b - origin.wy) * ray_shift_y);
  };
  const double focal = view.focal, tiny = std::numeric_limits<double>::min();
  // A plane that is seen edge-on, or has the eye in it, is steep as a whole: its direction counts.
  if (view.orthographic) {
    const double steepest = 1e-9 * std::max(std::abs(normal.x), std::abs(normal.y));
    const double across = not_below(normal.z, std::max(steepest, tiny)), offset = glm::dot(normal, p[0]);
    const double a = normal.x / across / focal, b = normal.y / across / focal, z = offset / across;
    return {{number(a - origin.wx), number(b - origin.wy), number(gradient.x / focal - gradient.z * a),
             number(gradient.y / focal - gradient.z * b), moved(-z - w_at(dvec2(0)), a, b)},
            {0, 0, number(u[0] + glm::dot(gradient, dvec3(0, 0, z) - p[0]))},
            across > 0};
  }
  const double steepest = 1e-3 * frame.nearest * glm::length(normal);
  const double offset = not_below(glm::dot(normal, p[0]), std::max(steepest, tiny)), along = glm::dot(gradient, p[0]);
  const double a = normal.x / offset / focal, b = normal.y / offset / focal, c = normal.z / offset;
  // 1/z at the reference must not be 0: of a few pixels, the one where it is largest.
  const double x_end = frame.middle_x, y_end = frame.middle_y;
  dvec2 at(0);
  for (const dvec2 other : {dvec2(x_end, y_end), dvec2(-x_end, y_end), dvec2(x_end, -y_end), dvec2(-x_end, -y_end)})
    if (std::abs(a * other.x + b * other.y + c) > std::abs(a * at.x + b * at.y + c)) at = other;
  const double inverse_z = not_below(a * at.x + b * at.y + c, tiny);
  const double in_u = (glm::dot(gradient, dvec3(at / focal, 1)) - along * inverse_z) / inverse_z;
  return {{number(a - origin.wx), number(b - origin.wy), number(gradient.x / focal - (along + in_u) * a),
           number(gradient.y / focal - (along + in_u) * b), moved(inverse_z - w_at(at), a, b)},
          {static_cast<float>(at.x), static_cast<float>(at.y), number(u[0] + in_u)},
          offset > 0};
}

// The values on the eye's plane: in perspective those at the eye. `plane`: FarOut or ContourInCell.
template <class Plane>
void set_eye_plane(const CellFrame& frame, const std::array<dvec3, 4>& p, const std::array<float, 4>& u, Plane& plane) {
  const dvec3 q = p[1] - p[0], r = p[2] - p[0], s = p[3] - p[0];
  const dvec3 sum = double{u[1] - u[0]} * glm::cross(r, s) + double{u[2] - u[0]} * glm::cross(s, q) +
                    double{u[3] - u[0]} * glm::cross(q, r);
  const double volume = glm::dot(q, glm::cross(r, s));
  const dvec3 gradient = volume == 0 ? dvec3(0) : sum / volume;
  plane.eye_u = nearest_float(u[0] - glm::dot(gradient, p[0]));
  if (!frame.view->orthographic) return;
  plane.eye_e = nearest_float(gradient.x / frame.view->focal);
  plane.eye_f = nearest_float(gradient.y / frame.view->focal);
}

// s on a face whose corners have places on the screen. On one that is seen edge-on, rays
// meet the first corner only, as in plane_through() of cell_setup.cpp.
void set_near_face(const CellFrame& frame, const std::array<dvec3, 3>& p, const std::array<double, 3>& u,
                   ContourInCell::Face& face) {
  const View& view = *frame.view;
  std::array<dvec2, 3> at;
  std::array<double, 3> s;
  for (std::size_t k = 0; k < 3; ++k) {
    const double w = view.orthographic ? 1 : 1 / p[k].z;
    at[k] = dvec2(p[k]) * (view.focal * w);
    s[k] = u[k] * w;
  }
  face.x = at[0].x, face.y = at[0].y;
  face.largest_s = nearest_float(std::max({std::abs(s[0]), std::abs(s[1]), std::abs(s[2])}));
  const dvec2 q = at[1] - at[0], r = at[2] - at[0];
  const double area = q.x * r.y - q.y * r.x;
  face.s = s[0];
  if (std::abs(area) <= 1e-6 * (std::abs(q.x * r.y) + std::abs(q.y * r.x))) return;
  face.e = ((s[1] - s[0]) * r.y - (s[2] - s[0]) * q.y) / area;
  face.f = ((s[2] - s[0]) * q.x - (s[1] - s[0]) * r.x) / area;
}

// The same if a corner is behind the eye or far outside of the picture, in perspective: from the picture's middle.
void set_far_face(const CellFrame& frame, const std::array<dvec3, 3>& p, const std::array<double, 3>& u,
                  ContourInCell::Face& face) {
  const dvec3 q = p[1] - p[0], r = p[2] - p[0], normal = glm::cross(q, r);
  const double square = glm::dot(normal, normal), offset = glm::dot(normal, p[0]);
  face.x = face.y = 0;
  if (square == 0 || offset == 0) return;
  const dvec3 gradient = ((u[1] - u[0]) * glm::cross(r, normal) + (u[2] - u[0]) * glm::cross(normal, q)) / square;
  const dvec3 slope = (u[0] - glm::dot(gradient, p[0])) / offset * normal + gradient;
  face.s = slope.z, face.e = slope.x / frame.view->focal, face.f = slope.y / frame.view->focal;
  face.largest_s =
      nearest_float(std::abs(face.s) + std::abs(face.e) * frame.middle_x + std::abs(face.f) * frame.middle_y);
}

// The pixels that a cell may cover; false: none.
bool bound_pixels(const CellFrame& frame, const std::array<dvec3, 4>& corners, CellOnScreen& cell) {
  const View& view = *frame.view;
  dvec2 low(1e9), high(-1e9);
  const auto reach = [&](const dvec3& p) {
    const dvec2 at = dvec2(p) * (view.orthographic ? view.focal : view.focal / p.z);
    low = glm::min(low, at), high = glm::max(high, at);
  };
  const double nearest = frame.nearest;
  for (const dvec3& p : corners) {
    if (view.orthographic || p.z > nearest) reach(p);
    if (view.orthographic || p.z <= nearest) continue;
    for (const dvec3& q : corners)
      if (q.z <= nearest) reach(glm::mix(q, p, (nearest - q.z) / (p.z - q.z)));
  }
  const auto pixel = [](double x, double first, double last) {
    return static_cast<std::int32_t>(std::clamp(x, first, last));
  };
  cell.left = pixel(std::ceil(low.x + frame.middle_x - frame.slack), 0, view.width);
  cell.right = pixel(std::floor(high.x + frame.middle_x + frame.slack), -1, view.width - 1);
  cell.bottom = pixel(std::ceil(low.y + frame.middle_y - frame.slack), 0, view.height);
  cell.top = pixel(std::floor(high.y + frame.middle_y + frame.slack), -1, view.height - 1);
  return cell.left <= cell.right && cell.bottom <= cell.top;
}

}  // namespace

bool set_up_far_out(const CellFrame& frame, const std::array<std::uint32_t, 4>& corners, const CellSetup& setup,
                    const FacesOfCell& faces, const std::array<float, 4>& u, CellOnScreen& cell,
                    CellsOnScreen& screen) {
  const PointsOnScreen& points = setup.points;
  std::array<dvec3, 4> p;
  for (std::size_t k = 0; k < 4; ++k) p[k] = setup.in_view[corners[k]];
  if (!bound_pixels(frame, p, cell)) return false;
  FarOut far_out{};
  std::size_t fronts = 0, backs = 4;
  unsigned order = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    const auto [a, b, c, opposite] = face_corners[k];
    PlaneInSpace plane{faces.planes[k], {points.x[corners[a]], points.y[corners[a]], u[a]}, !faces.is_negative[k]};
    if ((points.is_far_out[corners[a]] | points.is_far_out[corners[b]] | points.is_far_out[corners[c]]) != 0)
      plane = plane_in_space(frame, {p[a], p[b], p[c]}, {u[a], u[b], u[c]}, screen.origin);
    const double side = glm::dot(glm::cross(p[b] - p[a], p[c] - p[a]), p[opposite] - p[a]);
    const std::size_t at = plane.is_positive == (side > 0) ? fronts++ : --backs;
    cell.faces[at] = plane.face;
    far_out.references[at] = plane.reference;
    order |= static_cast<unsigned>(k) << (2 * at);
  }
  cell.fronts = static_cast<std::uint8_t>(fronts);
  cell.order = static_cast<std::uint8_t>(order);
  cell.far_out = static_cast<std::int32_t>(screen.far_out.size());
  set_eye_plane(frame, p, u, far_out);
  screen.far_out.push_back(far_out);
  return true;
}

ContourInCell contour_in(const CellFrame& frame, const std::array<std::uint32_t, 4>& corners, const CellSetup& setup,
                         const CellOnScreen& cell, const std::array<float, 4>& u) {
  std::array<dvec3, 4> p;
  for (std::size_t k = 0; k < 4; ++k) p[k] = setup.in_view[corners[k]];
  ContourInCell contour{};
  for (std::size_t at = 0; at < 4; ++at) {
    const auto [a, b, c, opposite] = face_corners[cell.order >> (2 * at) & 3U];
    ContourInCell::Face& face = contour.faces[at];
    const bool is_far_out = (setup.points.is_far_out[corners[a]] | setup.points.is_far_out[corners[b]] |
                             setup.points.is_far_out[corners[c]]) != 0;
    if (is_far_out && !frame.view->orthographic)
      set_far_face(frame, {p[a], p[b], p[c]}, {u[a], u[b], u[c]}, face);
    else
      set_near_face(frame, {p[a], p[b], p[c]}, {u[a], u[b], u[c]}, face);
    face.low = std::min({u[a], u[b], u[c]}), face.high = std::max({u[a], u[b], u[c]});
    face.whole_x = static_cast<float>(std::floor(face.x)), face.whole_y = static_cast<float>(std::floor(face.y));
    face.rest_x = static_cast<float>(face.x - std::floor(face.x));
    face.rest_y = static_cast<float>(face.y - std::floor(face.y));
    face.single_s = nearest_float(face.s), face.single_e = nearest_float(face.e), face.single_f = nearest_float(face.f);
  }
  if (cell.far_out >= 0) set_eye_plane(frame, p, u, contour);
  return contour;
}

}  // namespace splatvol::tiles
