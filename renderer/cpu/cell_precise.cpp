// Cells that rays meet in double precision, and contours in cells.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "renderer/common.h"
#include "renderer/cpu/cell_frame.h"

namespace splatvol::tiles {
namespace {

// The values on the eye's plane: in perspective those at the eye.
void set_eye_plane(const CellFrame& frame, const std::array<dvec3, 4>& p, const std::array<float, 4>& u,
                   ContourInCell& plane) {
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

// s on a face whose corners have places on the screen. On one that is seen edge-on, the first corner counts.
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

bool set_up_precise(const CellFrame& frame, const std::array<std::uint32_t, 4>& corners, const CellSetup& setup,
                    const std::array<float, 4>& u, const std::array<float, 4>& opacities, CellOnScreen& cell,
                    CellsOnScreen& screen) {
  PreciseCell precise{{}, u, opacities, frame.slack, false};
  bool is_far_out = false;
  for (std::size_t k = 0; k < 4; ++k) {
    const std::uint32_t corner = corners[k];
    precise.corners[k] = setup.in_view[corner];
    precise.is_behind = precise.is_behind || precise.corners[k].z <= frame.nearest;
    is_far_out = is_far_out || setup.points.is_far_out[corner] != 0;
    const PointsOnScreen::Place& place = setup.points.places[corner];
    const float distance = std::max(std::abs(place.x), std::abs(place.y));
    precise.slack = std::max(precise.slack, 1e-6F * distance);  // as its places are rounded
  }
  if (precise.is_behind) precise.slack = std::numeric_limits<float>::infinity();
  if (is_far_out && !bound_pixels(frame, precise.corners, cell)) return false;
  for (CellOnScreen::Face& face : cell.faces) face = {};
  cell.fronts = 4;  // rays may enter by any face
  cell.order = 0b11100100;
  cell.precise = static_cast<std::int32_t>(screen.precise.size());
  screen.precise.push_back(precise);
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
  if (cell.precise >= 0) set_eye_plane(frame, p, u, contour);
  return contour;
}

}  // namespace splatvol::tiles
