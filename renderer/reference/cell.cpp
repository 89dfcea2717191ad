#include "renderer/reference/cell.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

/// Pixels. Far above the rounding error of a projected coordinate, and small enough to cost no time.
constexpr double bounds_margin = 1e-6;

/// As a share of the largest value at a face's vertices.
constexpr double rounding_of_values = 1e-14;

constexpr int edges[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};

/// The vertices of the face opposite each vertex.
constexpr int faces[4][3] = {{1, 2, 3}, {0, 2, 3}, {0, 1, 3}, {0, 1, 2}};

/// The edges ij, jk and ik of each face, whose vertices are i, j, k.
constexpr int face_edges[4][3] = {{3, 5, 4}, {1, 5, 2}, {0, 4, 2}, {0, 3, 1}};

/// Returns the faces that the ray meets, as bits, for the signs of the six edges as bits (1: positive).
constexpr std::array<unsigned char, 64> make_face_table() {
  std::array<unsigned char, 64> table{};
  for (int signs = 0; signs < 64; ++signs) {
    for (int face = 0; face < 4; ++face) {
      const auto [ij_edge, jk_edge, ik_edge] = face_edges[face];
      const bool ij = signs >> ij_edge & 1;
      const bool jk = signs >> jk_edge & 1;
      const bool ik = signs >> ik_edge & 1;
      if (ij == jk && ij != ik) table[signs] |= static_cast<unsigned char>(1 << face);
    }
  }
  return table;
}

constexpr std::array<unsigned char, 64> face_table = make_face_table();

/// Returns a d - b c with an error of a few units in the last place (Kahan).
double determinant(double a, double b, double c, double d) {
  const double p = a * d;
  const double q = b * c;
  return (p - q) + (std::fma(a, d, -p) - std::fma(b, c, -q));
}

/// The bounds along one image axis: lowest and highest x / z (perspective) or x (orthographic).
struct Extent {
  double low = infinity;
  double high = -infinity;

  void add(double value) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
};

/// Extends the bounds for the edge from `front` (z > 0) to `back` (z <= 0). At the eye's plane its projection runs to
/// infinity, to the side on which the edge passes the eye.
void add_crossing_edge(const dvec3& front, const dvec3& back, Extent& x, Extent& y) {
  const int side_x = determinant_sign(back.x, back.z, front.x, front.z);
  const int side_y = determinant_sign(back.y, back.z, front.y, front.z);
  if (side_x != 0) x.add(side_x * infinity);
  if (side_y != 0) y.add(side_y * infinity);
}

/// Returns the first and last pixel whose centre lies in the extent, on an axis of `count` pixels.
std::array<int, 2> pixel_range(const Extent& extent, double focal, int count) {
  const double low = std::ceil(extent.low * focal + 0.5 * count - 0.5 - bounds_margin);
  const double high = std::floor(extent.high * focal + 0.5 * count - 0.5 + bounds_margin);
  return {static_cast<int>(std::clamp(low, 0.0, static_cast<double>(count))),
          static_cast<int>(std::clamp(high, -1.0, count - 1.0))};
}

}  // namespace

dvec3 gradient_direction(const CellCorners& corners, const std::array<double, 4>& values) {
  dmat3 sides;
  dvec3 rises;
  double size = 0;
  double rise = 0;
  for (int i = 0; i < 3; ++i) {
    sides[i] = corners[i + 1] - corners[0];
    rises[i] = values[i + 1] - values[0];
    for (int axis = 0; axis < 3; ++axis) size = std::max(size, std::abs(sides[i][axis]));
    rise = std::max(rise, std::abs(rises[i]));
  }
  if (size == 0 || rise == 0) return dvec3(0);

  // The gradient times the cell's volume: this needs no division, which a flat cell could not have. Sizes near 1 keep
  // products from overflowing.
  for (int i = 0; i < 3; ++i) sides[i] /= size;
  rises /= rise;
  const dvec3 gradient = rises[0] * glm::cross(sides[1], sides[2]) + rises[1] * glm::cross(sides[2], sides[0]) +
                         rises[2] * glm::cross(sides[0], sides[1]);
  const double length = std::hypot(gradient.x, gradient.y, gradient.z);
  return length == 0 ? dvec3(0) : gradient / length;
}

PixelRay pixel_ray(const View& view, int x, int y) {
  return {(x + 0.5 - 0.5 * view.width) / view.focal, (y + 0.5 - 0.5 * view.height) / view.focal};
}

PixelRectangle pixel_bounds(const View& view, const CellCorners& corners) {
  if (std::ranges::none_of(corners, [](const dvec3& corner) { return corner.z > 0; })) return {0, -1, 0, -1};

  Extent x;
  Extent y;
  for (const dvec3& corner : corners) {
    if (!view.orthographic && corner.z <= 0) continue;
    const double depth = view.orthographic ? 1 : corner.z;
    x.add(corner.x / depth);
    y.add(corner.y / depth);
  }
  for (const auto& [i, j] : edges) {
    if (view.orthographic || (corners[i].z > 0) == (corners[j].z > 0)) continue;
    const bool i_in_front = corners[i].z > 0;
    add_crossing_edge(corners[i_in_front ? i : j], corners[i_in_front ? j : i], x, y);
  }

  const auto [x0, x1] = pixel_range(x, view.focal, view.width);
  const auto [y0, y1] = pixel_range(y, view.focal, view.height);
  return {x0, x1, y0, y1};
}

int determinant_sign(double a, double b, double c, double d) {
  const double p = a * d;
  const double q = b * c;
  if (p != q) return p > q ? 1 : -1;

  // The rounded products are equal. The rounding error of each is one double, exactly.
  const double rest_p = std::fma(a, d, -p);
  const double rest_q = std::fma(b, c, -q);
  return (rest_p > rest_q) - (rest_p < rest_q);
}

bool CellCrosser::select_row(double b) {
  for (int i = 0; i < 4; ++i) w_[i] = corners_[i].y - b * zeta(i);
  const auto [low, high] = std::ranges::minmax(w_);
  return low <= 0 && high >= 0;
}

int CellCrosser::edge_sign(int i, int j) const {
  // E itself, then its largest change when the ray turns to (a + e1, b + e2), e1 >> e2.
  if (const int sign = determinant_sign(u_[i], w_[i], u_[j], w_[j])) return sign;
  if (const int sign = determinant_sign(w_[i], zeta(i), w_[j], zeta(j))) return sign;
  if (const int sign = determinant_sign(zeta(i), u_[i], zeta(j), u_[j])) return sign;
  if (orthographic_) return 0;

  // The edge's line passes through the eye, and so do all rays: the eye moves by (e3, e4), e2 >> e3 >> e4 >> e1 e4 >>
  // e2 e3.
  if (w_[i] != w_[j]) return w_[i] > w_[j] ? 1 : -1;
  if (u_[i] != u_[j]) return u_[i] < u_[j] ? 1 : -1;
  return (zeta(i) > zeta(j)) - (zeta(i) < zeta(j));
}

unsigned CellCrosser::faces_hit_exactly() const {
  int sign[6];
  for (int edge = 0; edge < 6; ++edge) sign[edge] = edge_sign(edges[edge][0], edges[edge][1]);
  unsigned hit = 0;
  for (int face = 0; face < 4; ++face) {
    const auto [ij, jk, ik] = face_edges[face];
    if (sign[ij] != 0 && sign[ij] == sign[jk] && sign[ij] == -sign[ik]) hit |= 1U << face;
  }
  return hit;
}

CellCrosser::FaceHit CellCrosser::hit_face(int opposite) const {
  const auto [i, j, k] = faces[opposite];
  const auto [low, high] = std::minmax({values_[i], values_[j], values_[k]});
  const double rounding = rounding_of_values * std::max(std::abs(low), std::abs(high));

  // Barycentric weights. If the face is seen edge on, the first turn of the ray that shows it gives them.
  const auto weigh = [&](const auto& p, const auto& q) -> std::optional<FaceHit> {
    const double weight_i = determinant(p(j), q(j), p(k), q(k));
    const double weight_j = determinant(p(k), q(k), p(i), q(i));
    const double weight_k = determinant(p(i), q(i), p(j), q(j));
    const double sum = weight_i + weight_j + weight_k;
    if (sum == 0) return std::nullopt;
    return FaceHit{(weight_i * corners_[i].z + weight_j * corners_[j].z + weight_k * corners_[k].z) / sum,
                   std::clamp((weight_i * values_[i] + weight_j * values_[j] + weight_k * values_[k]) / sum, low, high),
                   rounding};
  };
  const auto u = [&](int vertex) { return u_[vertex]; };
  const auto w = [&](int vertex) { return w_[vertex]; };
  const auto z = [&](int vertex) { return zeta(vertex); };
  if (const auto hit = weigh(u, w)) return *hit;
  if (const auto hit = weigh(w, z)) return *hit;
  if (const auto hit = weigh(z, u)) return *hit;
  return {corners_[i].z, values_[i], rounding};
}

std::optional<Crossing> CellCrosser::cross(double a) {
  for (int i = 0; i < 4; ++i) u_[i] = corners_[i].x - a * zeta(i);

  unsigned signs = 0;
  bool is_exact = true;
  for (int edge = 0; edge < 6; ++edge) {
    const auto [i, j] = edges[edge];
    const double p = u_[i] * w_[j];
    const double q = u_[j] * w_[i];
    signs |= static_cast<unsigned>(p > q) << edge;
    is_exact = is_exact && p != q;
  }
  const unsigned hit = is_exact ? face_table[signs] : faces_hit_exactly();
  if (hit == 0) return std::nullopt;

  FaceHit found[4];
  int count = 0;
  for (int face = 0; face < 4; ++face)
    if (hit >> face & 1) found[count++] = hit_face(face);
  if (count != 2) return std::nullopt;
  if (found[1].depth < found[0].depth) std::swap(found[0], found[1]);
  return Crossing{found[0].depth, found[1].depth, found[0].value, found[1].value, found[0].rounding, found[1].rounding};
}

}  // namespace splatvol
