#include "builder/scattered/cell_rays.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <utility>

namespace splatvol {
namespace {

// The inverse of the length of a ray that nothing ends.
constexpr float longest_ray = 1e-30F;

// What makes up for rounding of squares.
constexpr float rounding = 1 + 2e-6F;

// The least ratio of the determinant of the cell's covariance, in the coordinates of the shape, to that of a ball with
// the same trace.
constexpr double least_roundness = 0.12;

// The root of a covariance, by Cholesky: a matrix L with L L^T = C. Thin directions get a least thickness.
dmat3 root_of(const SymmetricMatrix& c) {
  const double least = 1e-6 * (c.xx + c.yy + c.zz);
  const double a = std::sqrt(std::max(c.xx, least)), b = c.xy / a, d = c.xz / a;
  const double e = std::sqrt(std::max(c.yy - b * b, least)), f = (c.yz - b * d) / e;
  const double g = std::sqrt(std::max(c.zz - d * d - f * f, least));
  return {dvec3(a, b, d), dvec3(0, e, f), dvec3(0, 0, g)};  // by columns
}

double determinant(const SymmetricMatrix& c) {
  return c.xx * (c.yy * c.zz - c.yz * c.yz) - c.xy * (c.xy * c.zz - c.yz * c.xz) + c.xz * (c.xy * c.yz - c.yy * c.xz);
}

using Face = std::array<std::size_t, 3>;

// Directions, and triangles between directions side by side.
struct DirectionMesh {
  std::vector<dvec3> vertices;
  std::vector<Face> faces;

  // The number of a direction, which is added if there is none such.
  std::size_t number_of(const dvec3& direction) {
    const auto same =
        std::ranges::find_if(vertices, [&](const dvec3& v) { return glm::distance(v, direction) < 1e-6; });
    const auto number = static_cast<std::size_t>(same - vertices.begin());
    if (same == vertices.end()) vertices.push_back(direction);
    return number;
  }
};

DirectionMesh divided_icosahedron() {
  DirectionMesh mesh;
  auto& [vertices, faces] = mesh;
  const double g = std::numbers::phi;
  for (int axis = 0; axis < 3; ++axis)
    for (int signs = 0; signs < 4; ++signs) {
      dvec3 corner(0);
      corner[axis] = (signs & 1) != 0 ? 1 : -1;
      corner[(axis + 1) % 3] = (signs & 2) != 0 ? g : -g;
      mesh.number_of(glm::normalize(corner));
    }
  const double edge = 2 / std::sqrt(1 + g * g);
  const auto are_neighbours = [&](std::size_t a, std::size_t b) {
    return glm::distance(vertices[a], vertices[b]) < 1.01 * edge;
  };
  for (std::size_t a = 0; a < 12; ++a)
    for (std::size_t b = a + 1; b < 12; ++b)
      for (std::size_t c = b + 1; c < 12; ++c)
        if (are_neighbours(a, b) && are_neighbours(b, c) && are_neighbours(a, c)) faces.push_back({a, b, c});
  for (int level = 0; level < 2; ++level) {
    std::vector<Face> finer;
    for (const Face& face : faces) {
      const std::size_t a = face[0], b = face[1], c = face[2];
      const auto middle = [&](std::size_t i, std::size_t j) {
        return mesh.number_of(glm::normalize(vertices[i] + vertices[j]));
      };
      const std::size_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
    }
    faces = std::move(finer);
  }
  return mesh;
}

}  // namespace

// The vertices of an icosahedron whose faces are divided into 16 triangles each.
struct CellRays::Sphere {
  Directions<many> directions{};       // of one ray of each pair; then zeros
  std::array<Floats, many> weights{};  // solid angles
  using Triangle = std::array<std::uint16_t, 3>;
  std::vector<Triangle> triangles;  // rays side by side; those of the other side have numbers from many * lanes on

  Sphere();
};

CellRays::Sphere::Sphere() {
  DirectionMesh mesh = divided_icosahedron();
  const std::vector<dvec3>& vertices = mesh.vertices;
  const std::vector<Face>& faces = mesh.faces;
  std::vector<double> solid_angles(vertices.size());
  for (const Face& face : faces) {
    const dvec3 &a = vertices[face[0]], &b = vertices[face[1]], &c = vertices[face[2]];
    const double angle =
        2 * std::atan2(std::abs(glm::dot(a, glm::cross(b, c))), 1 + glm::dot(a, b) + glm::dot(b, c) + glm::dot(c, a));
    for (const std::size_t v : face) solid_angles[v] += angle / 3;
  }
  std::vector<std::uint16_t> rays(vertices.size());
  std::size_t pairs = 0;
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    const dvec3& d = vertices[v];
    const std::size_t opposite = mesh.number_of(-d);
    if (opposite < v) continue;
    directions.x[pairs / lanes][pairs % lanes] = static_cast<float>(d.x);
    directions.y[pairs / lanes][pairs % lanes] = static_cast<float>(d.y);
    directions.z[pairs / lanes][pairs % lanes] = static_cast<float>(d.z);
    weights[pairs / lanes][pairs % lanes] = static_cast<float>(solid_angles[v]);
    rays[v] = static_cast<std::uint16_t>(pairs);
    rays[opposite] = static_cast<std::uint16_t>(many * lanes + pairs);
    ++pairs;
  }
  for (const Face& face : faces) triangles.push_back({rays[face[0]], rays[face[1]], rays[face[2]]});
}

// Half of the directions on a spiral over the sphere; the others are opposite.
const CellRays::Directions<CellRays::few>& CellRays::few_directions() {
  static const Directions<few> directions = [] {
    Directions<few> made;
    for (std::size_t i = 0; i < few * lanes; ++i) {
      const double z = (static_cast<double>(i) + 0.5) / static_cast<double>(few * lanes);
      const double angle = static_cast<double>(i) * std::numbers::pi * (3 - std::sqrt(5.0));
      const double r = std::sqrt(1 - z * z);
      made.x[i / lanes][i % lanes] = static_cast<float>(r * std::cos(angle));
      made.y[i / lanes][i % lanes] = static_cast<float>(r * std::sin(angle));
      made.z[i / lanes][i % lanes] = static_cast<float>(z);
    }
    return made;
  }();
  return directions;
}

const CellRays::Sphere& CellRays::sphere() {
  static const Sphere made;
  return made;
}

dmat3 CellRays::shape_of(const SpatialMoments& moments) {
  SymmetricMatrix about_point = moments.covariance;
  add_square(about_point, 1, moments.centroid);
  return std::sqrt(5.0) * root_of(about_point);
}

void CellRays::reset(const dmat3& shape) {
  shape_ = shape;
  planes_.clear();
  const Directions<few>& u = few_directions();
  const auto s = [&](int column, int row) { return static_cast<float>(shape[column][row]); };
  for (std::size_t i = 0; i < few; ++i) {
    few_.x[i] = s(0, 0) * u.x[i] + s(1, 0) * u.y[i] + s(2, 0) * u.z[i];
    few_.y[i] = s(0, 1) * u.x[i] + s(1, 1) * u.y[i] + s(2, 1) * u.z[i];
    few_.z[i] = s(0, 2) * u.x[i] + s(1, 2) * u.y[i] + s(2, 2) * u.z[i];
  }
  for (auto& side : few_inverse_) side.fill(Floats{} + longest_ray);
}

void CellRays::add(const dvec3& dual, std::uint32_t label) {
  const Plane plane{static_cast<float>(glm::dot(shape_[0], dual)), static_cast<float>(glm::dot(shape_[1], dual)),
                    static_cast<float>(glm::dot(shape_[2], dual)), label};
  const Directions<few>& u = few_directions();
  for (std::size_t i = 0; i < few; ++i) {
    const Floats near = plane.x * u.x[i] + plane.y * u.y[i] + plane.z * u.z[i];
    few_inverse_[0][i] = near > few_inverse_[0][i] ? near : few_inverse_[0][i];
    few_inverse_[1][i] = -near > few_inverse_[1][i] ? -near : few_inverse_[1][i];
  }
  planes_.push_back(plane);
}

void CellRays::update() {
  Floats longest{};
  for (std::size_t side = 0; side < 2; ++side)
    for (std::size_t i = 0; i < few; ++i) {
      const Floats length = (side == 0 ? 1.0F : -1.0F) / few_inverse_[side][i];
      const std::size_t to = side * few + i;
      end_x_[to] = length * few_.x[i];
      end_y_[to] = length * few_.y[i];
      end_z_[to] = length * few_.z[i];
      end_square_[to] = end_x_[to] * end_x_[to] + end_y_[to] * end_y_[to] + end_z_[to] * end_z_[to];
      longest = end_square_[to] > longest ? end_square_[to] : longest;
    }
  float most = 0;
  for (std::size_t l = 0; l < lanes; ++l) most = std::max(most, longest[l]);
  reach_ = 4 * rounding * most;
}

bool CellRays::may_shorten(const dvec3& low, const dvec3& high) const {
  const vec3 from(low), to(high);
  Integers found{};
  const Floats zero{};
  for (std::size_t i = 0; i < 2 * few; ++i) {
    const auto beyond = [&](const Floats& end, float a, float b) {
      const Floats below = a - end, above = end - b;
      const Floats outside = below > above ? below : above;
      return outside > zero ? outside : zero;
    };
    const Floats x = beyond(end_x_[i], from.x, to.x), y = beyond(end_y_[i], from.y, to.y),
                 z = beyond(end_z_[i], from.z, to.z);
    found |= x * x + y * y + z * z < end_square_[i] * rounding;
  }
  std::int32_t any = 0;
  for (std::size_t l = 0; l < lanes; ++l) any |= found[l];
  return any != 0;
}

void CellRays::cast() {
  const Directions<many>& u = sphere().directions;
  for (std::size_t side = 0; side < 2; ++side) {
    inverse_[side].fill(Floats{} + longest_ray);
    labels_[side].fill(Integers{});
  }
  for (std::size_t p = 0; p < planes_.size(); ++p) {
    const Plane& plane = planes_[p];
    const Integers number = Integers{} + static_cast<std::int32_t>(p);
    for (std::size_t i = 0; i < many; ++i) {
      const Floats near = plane.x * u.x[i] + plane.y * u.y[i] + plane.z * u.z[i];
      const Integers ends = near > inverse_[0][i], ends_other = -near > inverse_[1][i];
      inverse_[0][i] = ends ? near : inverse_[0][i];
      inverse_[1][i] = ends_other ? -near : inverse_[1][i];
      labels_[0][i] = ends ? number : labels_[0][i];
      labels_[1][i] = ends_other ? number : labels_[1][i];
    }
  }
}

// Adds up the sectors round the rays.
CellRays::Sums CellRays::sum_sectors() const {
  const Directions<many>& u = sphere().directions;
  Floats volume{}, x{}, y{}, z{}, xx{}, yy{}, zz{}, xy{}, xz{}, yz{};
  for (std::size_t i = 0; i < many; ++i) {
    const Floats& w = sphere().weights[i];
    const Floats a = 1.0F / inverse_[0][i], b = 1.0F / inverse_[1][i];
    const Floats a3 = w * a * a * a, b3 = w * b * b * b, first = a3 * a - b3 * b, second = a3 * a * a + b3 * b * b;
    volume += a3 + b3;
    x += first * u.x[i], y += first * u.y[i], z += first * u.z[i];
    const Floats sx = second * u.x[i], sy = second * u.y[i], sz = second * u.z[i];
    xx += sx * u.x[i], yy += sy * u.y[i], zz += sz * u.z[i];
    xy += sx * u.y[i], xz += sx * u.z[i], yz += sy * u.z[i];
  }
  const auto sum = [](const Floats& items) {
    double total = 0;
    for (std::size_t l = 0; l < lanes; ++l) total += static_cast<double>(items[l]);
    return total;
  };
  Sums sums{sum(volume) / 3, dvec3(sum(x), sum(y), sum(z)) / 4.0, {}};
  sums.second = {sum(xx) / 5, sum(yy) / 5, sum(zz) / 5, sum(xy) / 5, sum(xz) / 5, sum(yz) / 5};
  return sums;
}

// Adds up the tetrahedra between the point and the ends of three rays side by side. They are a little less than the
// cell, but no ray by itself counts for much.
CellRays::Sums CellRays::sum_tetrahedra() const {
  const Directions<many>& u = sphere().directions;
  std::array<dvec3, 2 * many * lanes> ends;
  for (std::size_t ray = 0; ray < ends.size(); ++ray) {
    const std::size_t side = ray / (many * lanes), i = ray % (many * lanes) / lanes, l = ray % lanes;
    ends[ray] =
        (side == 0 ? 1.0 : -1.0) / static_cast<double>(inverse_[side][i][l]) * dvec3(u.x[i][l], u.y[i][l], u.z[i][l]);
  }
  Sums sums;
  for (const auto& [i, j, k] : sphere().triangles) {
    const dvec3 &a = ends[i], &b = ends[j], &c = ends[k], sum = a + b + c;
    const double volume = std::abs(glm::dot(a, glm::cross(b, c))) / 6;
    sums.volume += volume;
    sums.first += volume / 4 * sum;
    for (const dvec3& v : {a, b, c, sum}) add_square(sums.second, volume / 20, v);
  }
  return sums;
}

SpatialMoments CellRays::moments() {
  Sums sums = sum_sectors();
  const auto roundness = [&] {
    const SymmetricMatrix& s = sums.second;
    const double mean = (s.xx + s.yy + s.zz) / 3;
    return determinant(s) / (mean * mean * mean);
  };
  fits_ = roundness() >= least_roundness;
  if (!fits_) sums = sum_tetrahedra();
  const double share = 1 / sums.volume;
  SymmetricMatrix c;
  c = {share * sums.second.xx, share * sums.second.yy, share * sums.second.zz,
       share * sums.second.xy, share * sums.second.xz, share * sums.second.yz};
  // The shape follows from the moments about the point, where the rays begin.
  better_shape_ = shape_ * (std::sqrt(5.0) * root_of(c));
  const dvec3 centroid = share * sums.first;
  add_square(c, -1, centroid);
  SpatialMoments result;
  result.mass = sums.volume * std::abs(glm::determinant(shape_));
  result.centroid = shape_ * centroid;
  const dmat3 root = shape_ * root_of(c);
  for (int column = 0; column < 3; ++column) add_square(result.covariance, 1, root[column]);
  return result;
}

void CellRays::find_vertices(std::vector<Vertex>& vertices, std::vector<std::uint32_t>& labels) {
  constexpr std::size_t count = 2 * many * lanes;
  const Directions<many>& u = sphere().directions;
  std::array<float, count> squares;
  std::array<std::uint32_t, count> ends;
  const auto s = [&](int column, int row) { return static_cast<float>(shape_[column][row]); };
  for (std::size_t i = 0; i < many; ++i) {
    const Floats x = s(0, 0) * u.x[i] + s(1, 0) * u.y[i] + s(2, 0) * u.z[i];
    const Floats y = s(0, 1) * u.x[i] + s(1, 1) * u.y[i] + s(2, 1) * u.z[i];
    const Floats z = s(0, 2) * u.x[i] + s(1, 2) * u.y[i] + s(2, 2) * u.z[i];
    const Floats square = x * x + y * y + z * z;
    for (std::size_t side = 0; side < 2; ++side) {
      const Floats length = square / (inverse_[side][i] * inverse_[side][i]);
      std::memcpy(&squares[(side * many + i) * lanes], &length, sizeof(length));
      std::memcpy(&ends[(side * many + i) * lanes], &labels_[side][i], sizeof(Integers));
    }
  }
  // Most triangles lie at one plane or two.
  const std::vector<Sphere::Triangle>& triangles = sphere().triangles;
  std::array<std::uint16_t, triangle_count> corners;
  std::size_t found = 0;
  for (std::size_t t = 0; t < triangle_count; ++t) {
    const std::uint32_t a = ends[triangles[t][0]], b = ends[triangles[t][1]], c = ends[triangles[t][2]];
    corners[found] = static_cast<std::uint16_t>(t);
    found += static_cast<std::size_t>(a != b) & static_cast<std::size_t>(b != c) & static_cast<std::size_t>(a != c);
  }
  vertices.clear();
  for (std::size_t t = 0; t < found; ++t) {
    const auto& [a, b, c] = triangles[corners[t]];
    const std::uint16_t first = squares[b] > squares[a] ? b : a, ray = squares[c] > squares[first] ? c : first;
    vertices.push_back({squares[ray], ray, {planes_[ends[a]].label, planes_[ends[b]].label, planes_[ends[c]].label}});
  }
  used_.assign(planes_.size(), 0);
  for (std::size_t side = 0; side < 2; ++side)
    for (std::size_t pair = 0; pair < pair_count; ++pair) used_[ends[side * many * lanes + pair]] = 1;
  labels.clear();
  for (std::size_t p = 0; p < planes_.size(); ++p)
    if (used_[p] != 0) labels.push_back(planes_[p].label);
}

dvec3 CellRays::end(const Vertex& vertex) const {
  const Directions<many>& u = sphere().directions;
  const std::size_t side = vertex.ray / (many * lanes), pair = vertex.ray % (many * lanes), i = pair / lanes,
                    l = pair % lanes;
  const double length = (side == 0 ? 1.0 : -1.0) / static_cast<double>(inverse_[side][i][l]);
  return length * (shape_ * dvec3(u.x[i][l], u.y[i][l], u.z[i][l]));
}

}  // namespace splatvol
