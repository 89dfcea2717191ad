#include "builder/mesh/moments.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include "tests/builder/support/meshes.h"
#include "tests/support/random.h"

namespace splatvol::test {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

// Mass, mean and covariance of (x, y, z, v), computed the long way: raw moments about the origin in extended precision.
using Real = long double;
class RawMoments {
 public:
  // Adds a tetrahedron with a linear value: E[y y^T] = (sum y_i y_i^T + sum y_i sum y_j^T) / 20.
  void add_tetrahedron(const std::array<std::array<Real, 4>, 4>& corners) {
    Real edges[3][3];
    for (int k = 0; k < 3; ++k)
      for (int i = 0; i < 3; ++i) edges[k][i] = corners[at(k + 1)][at(i)] - corners[0][at(i)];
    const Real volume = std::abs(edges[0][0] * (edges[1][1] * edges[2][2] - edges[1][2] * edges[2][1]) -
                                 edges[0][1] * (edges[1][0] * edges[2][2] - edges[1][2] * edges[2][0]) +
                                 edges[0][2] * (edges[1][0] * edges[2][1] - edges[1][1] * edges[2][0])) /
                        6;
    mass_ += volume;
    for (int i = 0; i < 4; ++i) {
      Real sum_i = 0;
      for (const auto& c : corners) sum_i += c[at(i)];
      first_[i] += volume * sum_i / 4;
      for (int j = 0; j < 4; ++j) {
        Real sum_j = 0, products = 0;
        for (const auto& c : corners) {
          sum_j += c[at(j)];
          products += c[at(i)] * c[at(j)];
        }
        second_[i][j] += volume * (products + sum_i * sum_j) / 20;
      }
    }
  }

  double mass() const { return static_cast<double>(mass_); }
  double mean(int i) const { return static_cast<double>(first_[i] / mass_); }
  double covariance(int i, int j) const {
    return static_cast<double>(second_[i][j] / mass_ - first_[i] / mass_ * (first_[j] / mass_));
  }

 private:
  static std::size_t at(int i) { return static_cast<std::size_t>(i); }
  Real mass_ = 0, first_[4] = {}, second_[4][4] = {};
};

std::array<Real, 4> corner(const dvec3& p, double value) { return {p.x, p.y, p.z, value}; }

std::array<Real, 4> middle(const std::vector<std::array<Real, 4>>& points) {
  std::array<Real, 4> sum{};
  for (const auto& p : points)
    for (std::size_t i = 0; i < 4; ++i) sum[i] += p[i] / static_cast<Real>(points.size());
  return sum;
}

// The quarter of a tetrahedron where L0 is the largest: six tetrahedra of its barycentric subdivision, round corner 0.
RawMoments quarter(const std::array<std::array<Real, 4>, 4>& c, double& low, double& high) {
  RawMoments moments;
  low = std::numeric_limits<double>::infinity(), high = -low;
  std::array<std::size_t, 3> others = {1, 2, 3};
  do {
    const auto [a, b, d] = others;
    const std::array<std::array<Real, 4>, 4> part = {c[0], middle({c[0], c[a]}), middle({c[0], c[a], c[b]}),
                                                     middle({c[0], c[a], c[b], c[d]})};
    moments.add_tetrahedron(part);
    for (const auto& p : part) {
      low = std::min(low, static_cast<double>(p[3]));
      high = std::max(high, static_cast<double>(p[3]));
    }
  } while (std::ranges::next_permutation(others).found);
  return moments;
}

double covariance_of(const SymmetricMatrix& s, int i, int j) {
  const double m[3][3] = {{s.xx, s.xy, s.xz}, {s.xy, s.yy, s.yz}, {s.xz, s.yz, s.zz}};
  return m[i][j];
}

// The tolerance is relative to the standard deviations.
void expect_equal(const SpatialMoments& moments, const dvec3& point, const RawMoments& exact, double tolerance) {
  EXPECT_NEAR(moments.mass / exact.mass(), 1, tolerance);
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(point[i] + moments.centroid[i], exact.mean(i), tolerance * std::sqrt(exact.covariance(i, i)));
    for (int j = 0; j < 3; ++j)
      EXPECT_NEAR(covariance_of(moments.covariance, i, j), exact.covariance(i, j),
                  tolerance * std::sqrt(exact.covariance(i, i) * exact.covariance(j, j)));
  }
}

void expect_equal(const ValueMoments& moments, const dvec3& point, const RawMoments& exact, double tolerance) {
  EXPECT_NEAR(moments.mass / exact.mass(), 1, tolerance);
  const double deviation = std::sqrt(exact.covariance(3, 3));
  EXPECT_NEAR(moments.mean, exact.mean(3), tolerance * deviation);
  EXPECT_NEAR(moments.variance, exact.covariance(3, 3), tolerance * deviation * deviation);
  for (int i = 0; i < 3; ++i) {
    const double spread = std::sqrt(exact.covariance(i, i));
    EXPECT_NEAR(point[i] + moments.centroid[i], exact.mean(i), tolerance * spread);
    EXPECT_NEAR(moments.covariance[i], exact.covariance(i, 3), tolerance * spread * deviation);
  }
}

// The gradient S^-1 c, from the numbers that the file stores.
dvec3 gradient_of(const ValueMoments& value, const SpatialMoments& moments) {
  const SplatShape shape = shape_of(moments);
  const SplatValue splat = value_of(value, shape);
  const dmat3 axes = glm::mat3_cast(shape.orientation);
  dvec3 gradient(0);
  for (int k = 0; k < 3; ++k)
    if (shape.deviations[k] > 0) gradient += splat.correlation[k] * splat.deviation / shape.deviations[k] * axes[k];
  return gradient;
}

template <class Moments>
Moments merge_all(const Mesh& mesh, const std::vector<Moments>& moments) {
  Moments sum;
  for (std::size_t i = 0; i < moments.size(); ++i) merge(sum, moments[i], mesh.points[i] - mesh.points[0]);
  return sum;
}

RawMoments whole(const Mesh& mesh, const std::vector<double>& values) {
  RawMoments moments;
  for (const Tetrahedron& t : mesh.tetrahedra)
    moments.add_tetrahedron({corner(mesh.points[t[0]], values[t[0]]), corner(mesh.points[t[1]], values[t[1]]),
                             corner(mesh.points[t[2]], values[t[2]]), corner(mesh.points[t[3]], values[t[3]])});
  return moments;
}

TEST(VertexMaterial, IsTheQuarterWhereTheVertexIsNearest) {
  const Mesh mesh = random_tetrahedra(50);
  std::mt19937_64 random(2);
  std::normal_distribution<double> normal;
  std::vector<double> values(mesh.points.size());
  for (double& v : values) v = normal(random);
  const auto moments = moments_of(mesh);
  const auto value_moments = value_moments_of(mesh, values);
  for (std::size_t t = 0; t < mesh.tetrahedra.size(); ++t)
    for (std::size_t own = 0; own < 4; ++own) {
      std::array<std::array<Real, 4>, 4> corners;
      for (std::size_t k = 0; k < 4; ++k) {
        const std::uint32_t v = mesh.tetrahedra[t][(own + k) % 4];
        corners[k] = corner(mesh.points[v], values[v]);
      }
      double low, high;
      const RawMoments exact = quarter(corners, low, high);
      const std::uint32_t v = mesh.tetrahedra[t][own];
      expect_equal(moments[v], mesh.points[v], exact, 1e-11);  // 1e-15, times (position / deviation)^2
      expect_equal(value_moments[v], mesh.points[v], exact, 1e-11);
      EXPECT_NEAR(value_moments[v].min, low, 1e-14);
      EXPECT_NEAR(value_moments[v].max, high, 1e-14);
    }
}

TEST(VertexMaterial, AddsUpToTheMesh) {
  for (const double share : {0.0, 0.2, 0.45}) {  // the last inverts some tetrahedra
    const Mesh mesh = jittered(6, share);
    const auto values = sample(mesh, [](dvec3 p) { return std::sin(5 * p.x) + p.y * p.z; });
    const RawMoments exact = whole(mesh, values);
    expect_equal(merge_all(mesh, moments_of(mesh)), mesh.points[0], exact, 1e-13);
    expect_equal(merge_all(mesh, value_moments_of(mesh, values)), mesh.points[0], exact, 1e-13);
    EXPECT_NEAR(exact.mass(), test::volume(mesh), 1e-13);
  }
}

// Any mesh gives a linear field's gradient g at every vertex and in every cluster: S and c are sums over the same
// parts, and each part has c = S g.
TEST(VertexMaterial, LinearFieldsHaveTheirExactGradient) {
  const dvec3 gradient(1, -2, 0.5);
  const glm::dquat turn = glm::normalize(glm::dquat(1, 0.3, -0.2, 0.7));
  struct Case {
    const char* name;
    Mesh mesh;
    double tolerance;  // relative
  };
  std::vector<Case> cases = {
      {"random tetrahedra", random_tetrahedra(200), 1e-6},  // some are almost flat
      {"jittered", jittered(7, 0.3), 1e-12},
      {"aspect 1e4", jittered(7, 0.3), 1e-6},  // rounding of 1e-16 times the square of the aspect
      {"tiny", jittered(4, 0.3), 1e-12},
      {"huge", jittered(4, 0.3), 1e-12}};
  for (dvec3& p : cases[2].mesh.points) p = turn * (p * dvec3(1, 1, 1e-4));
  for (dvec3& p : cases[3].mesh.points) p *= 1e-60;
  for (dvec3& p : cases[4].mesh.points) p *= 1e60;
  for (const auto& [name, mesh, tolerance] : cases) {
    const auto values = sample(mesh, [&](dvec3 p) { return glm::dot(gradient, p); });
    const auto moments = moments_of(mesh);
    const auto value_moments = value_moments_of(mesh, values);
    double worst = 0;
    for (std::size_t i = 0; i < moments.size(); ++i)
      worst = std::max(worst, glm::length(gradient_of(value_moments[i], moments[i]) - gradient));
    EXPECT_LT(worst, tolerance * glm::length(gradient)) << name;
    const dvec3 of_all = gradient_of(merge_all(mesh, value_moments), merge_all(mesh, moments));
    EXPECT_LT(glm::length(of_all - gradient), tolerance * glm::length(gradient)) << name;
  }
}

// The root mean square of the gradient's error over the inner vertices, at their centroids.
double gradient_error(std::uint32_t cells, double jitter) {
  const Mesh mesh = jittered(cells, jitter);
  const auto values = sample(mesh, [](dvec3 p) { return p.x * p.x - 2 * p.y * p.z + 0.5 * p.x * p.z; });
  const auto moments = moments_of(mesh);
  const auto value_moments = value_moments_of(mesh, values);
  const std::uint32_t side = cells + 1;
  double sum = 0, count = 0;
  for (std::uint32_t i = 0; i < mesh.points.size(); ++i) {
    const auto inner = [&](std::uint32_t k) { return k > 0 && k < cells; };
    if (!inner(i % side) || !inner(i / side % side) || !inner(i / side / side)) continue;
    const dvec3 p = mesh.points[i] + moments[i].centroid;
    const dvec3 exact(2 * p.x + 0.5 * p.z, -2 * p.z, -2 * p.y + 0.5 * p.x);
    const dvec3 error = gradient_of(value_moments[i], moments[i]) - exact;
    sum += glm::dot(error, error);
    ++count;
  }
  return std::sqrt(sum / count);
}

TEST(VertexMaterial, QuadraticFieldsHaveTheirGradientToFirstOrderAtLeast) {
  // Linear interpolation leaves an error of the order of the spacing. It cancels if all vertices have the same cells
  // round them.
  EXPECT_LT(gradient_error(8, 0), 1e-12);
  const double coarse = gradient_error(8, 0.2), fine = gradient_error(16, 0.2), finest = gradient_error(32, 0.2);
  const double order = std::log2(coarse / finest) / 2;
  RecordProperty("order", std::to_string(order));
  EXPECT_GT(order, 0.95) << coarse << " " << fine << " " << finest;
  EXPECT_LT(coarse, 0.1);  // gradients reach 2.8
}

TEST(VertexMaterial, KeepsItsShapeAtAnyPlaceAndScale) {
  // Coordinates are multiples of 2^-20, so that a shift by 10^7 is exact. Only rounding may change.
  Mesh mesh = jittered(5, 0.3);
  for (dvec3& p : mesh.points) p = glm::round(p * 0x1p20) * 0x1p-20;
  const auto values = sample(mesh, [](dvec3 p) { return std::cos(3 * p.x) * p.y; });
  const auto moments = moments_of(mesh);
  const auto value_moments = value_moments_of(mesh, values);
  const auto expect_scaled = [&](const Mesh& other, double scale) {
    const auto other_moments = moments_of(other);
    const auto other_values = value_moments_of(other, values);
    for (std::size_t i = 0; i < moments.size(); ++i) {
      EXPECT_NEAR(other_moments[i].mass / (moments[i].mass * scale * scale * scale), 1, 1e-12);
      for (int j = 0; j < 3; ++j) {
        const double expected = moments[i].centroid[j] * scale, size = std::sqrt(moments[i].covariance.xx) * scale;
        EXPECT_NEAR(other_moments[i].centroid[j], expected, 1e-12 * size);
        EXPECT_NEAR(other_values[i].covariance[j], value_moments[i].covariance[j] * scale,
                    1e-12 * size * std::sqrt(value_moments[i].variance));
        for (int k = 0; k < 3; ++k)
          EXPECT_NEAR(covariance_of(other_moments[i].covariance, j, k),
                      covariance_of(moments[i].covariance, j, k) * scale * scale, 1e-12 * size * size);
      }
    }
    const SpatialMoments all = merge_all(mesh, moments), other_all = merge_all(other, other_moments);
    EXPECT_NEAR(other_all.covariance.xy / (all.covariance.xx * scale * scale), all.covariance.xy / all.covariance.xx,
                1e-12);
  };
  Mesh moved = mesh;
  for (dvec3& p : moved.points) p += dvec3(1e7, -1e7, 1e7);
  expect_scaled(moved, 1);
  for (const double scale : {1e-6, 1e6}) {
    Mesh scaled = mesh;
    for (dvec3& p : scaled.points) p *= scale;
    expect_scaled(scaled, scale);
  }
}

TEST(VertexMaterial, OrientationDoesNotMatterAndFlatCellsGiveNothing) {
  const Mesh mesh = jittered(3, 0.2);
  Mesh other = mesh;
  for (std::size_t t = 0; t < other.tetrahedra.size(); t += 2)
    std::swap(other.tetrahedra[t][0], other.tetrahedra[t][1]);
  other.tetrahedra.push_back({0, 0, 1, 2});  // collapsed
  other.points.push_back(mesh.points[0] + 2.0 * (mesh.points[1] - mesh.points[0]));
  other.tetrahedra.push_back({0, 1, 5, static_cast<std::uint32_t>(mesh.points.size())});  // three corners on one line
  const auto moments = moments_of(mesh);
  const auto other_moments = moments_of(other);
  EXPECT_LT(other_moments.back().mass, 1e-17);  // rounding
  for (std::size_t i = 0; i < moments.size(); ++i) EXPECT_NEAR(other_moments[i].mass / moments[i].mass, 1, 1e-12);
  EXPECT_NEAR(merge_all(other, other_moments).mass, test::volume(mesh), 1e-12);
}

TEST(VertexMaterial, OneTetrahedronGivesEachVertexAQuarterOfTheVolume) {
  const std::vector<dvec3> points = {{0, 0, 0}, {1, 0, 0}, {0, 2, 0}, {0, 0, 3}, {5, 5, 5}};
  const std::vector<Tetrahedron> tetrahedra = {{0, 1, 2, 3}};
  const auto moments = moments_of({points, tetrahedra});
  for (std::size_t i = 0; i < 4; ++i) EXPECT_DOUBLE_EQ(moments[i].mass, 0.25);
  EXPECT_DOUBLE_EQ(moments[0].centroid.z, 3 * 23.0 / 144);
  // The fifth point is in no cell.
  EXPECT_EQ(moments[4].mass, 0);
  EXPECT_EQ(shape_of(moments[4]).deviations, dvec3(0));
  EXPECT_EQ(value_of({}, shape_of(moments[4])).coverage, 0);
}

TEST(VertexMaterial, WithoutPointsOrCellsThereIsNone) {
  EXPECT_TRUE(moments_of({}).empty());
  EXPECT_EQ(moments_of({std::vector<dvec3>(3), {}})[2].mass, 0);
}

TEST(VertexMaterial, CellsBeyondDoublePrecisionGiveNothing) {
  for (const double scale : {1e160, 1e110, 1e-200}) {
    const std::vector<dvec3> points = {{0, 0, 0}, {scale, 0, 0}, {0, scale, 0}, {0, 0, scale}};
    const std::vector<Tetrahedron> tetrahedra = {{0, 1, 2, 3}};
    const auto moments = moments_of({points, tetrahedra});
    EXPECT_EQ(moments[0].mass, 0);
    EXPECT_EQ(shape_of(moments[0]).deviations, dvec3(0));
  }
}

TEST(VertexMaterial, MissingValuesLeaveOutTheirTetrahedra) {
  const Mesh mesh = jittered(4, 0.2);
  auto values = sample(mesh, [](dvec3 p) { return 3 + p.x; });
  values[62] = nan;  // in the middle
  const auto moments = moments_of(mesh);
  const auto value_moments = value_moments_of(mesh, values);
  EXPECT_EQ(value_moments[62].mass, 0);
  EXPECT_GT(value_moments[62].min, value_moments[62].max);
  std::size_t partly = 0;
  double missing = 0;
  for (const Tetrahedron& t : mesh.tetrahedra)
    if (std::ranges::count(t, 62u) > 0) missing += whole({mesh.points, {t}}, values).mass();
  for (std::size_t i = 0; i < moments.size(); ++i) {
    const SplatValue value = value_of(value_moments[i], shape_of(moments[i]));
    EXPECT_NEAR(value.coverage, value_moments[i].mass / moments[i].mass, 1e-15);
    if (value.coverage > 0 && value.coverage < 1) ++partly;
    for (int k = 0; k < 3; ++k) EXPECT_LE(std::abs(value.correlation[k]), 1);
  }
  EXPECT_EQ(partly, 14u);  // its neighbours
  EXPECT_NEAR(merge_all(mesh, value_moments).mass + missing, merge_all(mesh, moments).mass, 1e-12);
}

void expect_same(double a, double b) { EXPECT_TRUE(a == b || (std::isnan(a) && std::isnan(b))) << a << " " << b; }

void expect_same(const dvec3& a, const dvec3& b) {
  for (int k = 0; k < 3; ++k) expect_same(a[k], b[k]);
}

// The quarter of a tetrahedron that a vertex owns, and its share of all that the vertex owns.
struct Quarter {
  std::array<std::uint32_t, 3> others;
  std::array<dvec3, 3> edges;
  double mass, weight;
};

double quarter_mass(const Mesh& mesh, const Tetrahedron& corners) {
  std::array<dvec3, 3> edges;
  for (std::size_t k = 0; k < 3; ++k) edges[k] = mesh.points[corners[k + 1]] - mesh.points[corners[0]];
  return std::abs(glm::dot(edges[0], glm::cross(edges[1], edges[2]))) / 24;
}

std::vector<Quarter> quarters_of(const Mesh& mesh, std::uint32_t vertex) {
  std::vector<Quarter> quarters;
  double mass = 0;
  for (const Tetrahedron& corners : mesh.tetrahedra) {
    const auto own = static_cast<std::size_t>(std::ranges::find(corners, vertex) - corners.begin());
    for (auto named = std::ranges::count(corners, vertex); named > 0; --named) {
      Quarter& quarter = quarters.emplace_back();
      for (std::size_t k = 0; k < 3; ++k) {
        quarter.others[k] = corners[(own + 1 + k) % 4];
        quarter.edges[k] = mesh.points[quarter.others[k]] - mesh.points[vertex];
      }
      quarter.mass = quarter_mass(mesh, corners);
      mass += quarter.mass;
    }
  }
  for (Quarter& quarter : quarters) quarter.weight = mass > 0 ? quarter.mass / mass : 0;
  return quarters;
}

constexpr double mean_share = 23.0 / 144, own_square = (161.0 - 97.0) / 4320, common_square = 97.0 / 4320;

// The moments of a vertex's material, one quarter after the other.
SpatialMoments moments_alone(std::span<const Quarter> quarters) {
  SpatialMoments sums;
  const auto squares = [](const dvec3& d) { return d * d; };
  const auto products = [](const dvec3& d) { return dvec3(d.x * d.y, d.x * d.z, d.y * d.z); };
  dvec3 diagonal(0), beside(0);
  for (const Quarter& quarter : quarters) {
    if (!(quarter.mass > 0)) continue;
    const auto& [a, b, c] = quarter.edges;
    const dvec3 sum = a + b + c;
    sums.mass += quarter.mass;
    sums.centroid += quarter.weight * sum;
    diagonal += quarter.weight * own_square * (squares(a) + squares(b) + squares(c));
    diagonal += quarter.weight * common_square * squares(sum);
    beside += quarter.weight * own_square * (products(a) + products(b) + products(c));
    beside += quarter.weight * common_square * products(sum);
  }
  sums.centroid *= mean_share;
  diagonal -= squares(sums.centroid);
  beside -= products(sums.centroid);
  sums.covariance = {diagonal.x, diagonal.y, diagonal.z, beside.x, beside.y, beside.z};
  return sums;
}

// Adds what a quarter has of a value. `rise`: from the value at the vertex, `own`, to those at the other corners.
void add_value(ValueMoments& sums, const Quarter& quarter, const dvec3& rise, double own) {
  const double total = rise.x + rise.y + rise.z, weight = quarter.weight;
  if (!std::isfinite(total) || !(quarter.mass > 0)) return;
  const auto& [a, b, c] = quarter.edges;
  sums.mass += quarter.mass;
  sums.centroid += weight * (a + b + c);
  sums.mean += weight * total;
  sums.variance += weight * (own_square * glm::dot(rise, rise) + common_square * total * total);
  sums.covariance += weight * own_square * (rise.x * a + rise.y * b + rise.z * c);
  sums.covariance += weight * common_square * total * (a + b + c);
  for (const double corner : {0.0, rise.x / 2, rise.y / 2, rise.z / 2, 1.0 / 3 * (rise.x + rise.y),
                              1.0 / 3 * (rise.y + rise.z), 1.0 / 3 * (rise.z + rise.x), total / 4}) {
    sums.min = std::min(sums.min, own + corner);
    sums.max = std::max(sums.max, own + corner);
  }
}

VertexValue value_alone(std::span<const Quarter> quarters, std::span<const double> values, double own) {
  VertexValue value;
  ValueMoments& sums = value.moments;
  double mass = 0;
  for (const Quarter& quarter : quarters) {
    const dvec3 rise(values[quarter.others[0]] - own, values[quarter.others[1]] - own, values[quarter.others[2]] - own);
    mass += quarter.mass;
    add_value(sums, quarter, rise, own);
    for (int k = 0; k < 3; ++k) {
      const dvec3& edge = quarter.edges[static_cast<std::size_t>(k)];
      const dvec3 difference = rise[k] / glm::dot(edge, edge) * edge;
      if (std::isfinite(difference.x + difference.y + difference.z)) value.gradient += difference;
    }
  }
  if (!(sums.mass > 0)) return value;
  const double share = mass / sums.mass;
  sums.centroid *= share * mean_share;
  sums.mean *= share * mean_share;
  sums.variance = share * sums.variance - sums.mean * sums.mean;
  sums.covariance = share * sums.covariance - sums.mean * sums.centroid;
  sums.mean += own;
  return value;
}

// Expects that a vertex's material is that of the vertex and each attribute alone, to the last bit.
void expect_alone(const Mesh& mesh, std::span<const std::vector<double>> values, std::size_t v,
                  const SpatialMoments& space, std::span<const VertexValue> found) {
  const auto quarters = quarters_of(mesh, static_cast<std::uint32_t>(v));
  const SpatialMoments alone = moments_alone(quarters);
  expect_same(space.mass, alone.mass);
  expect_same(space.centroid, alone.centroid);
  const SymmetricMatrix &s = space.covariance, &t = alone.covariance;
  expect_same({s.xx, s.yy, s.zz}, {t.xx, t.yy, t.zz});
  expect_same({s.xy, s.xz, s.yz}, {t.xy, t.xz, t.yz});
  for (std::size_t a = 0; a < values.size(); ++a) {
    const VertexValue expected = value_alone(quarters, values[a], values[a][v]);
    const ValueMoments &one = expected.moments, &all = found[a].moments;
    expect_same({all.mass, all.mean, all.variance}, {one.mass, one.mean, one.variance});
    expect_same({all.min, all.max, 0}, {one.min, one.max, 0});
    expect_same(all.centroid, one.centroid);
    expect_same(all.covariance, one.covariance);
    expect_same(found[a].gradient, expected.gradient);
  }
}

// With missing values, flat cells and vertices without cells.
TEST(VertexMaterial, AllAtOnceIsThatOfEachVertexAndAttribute) {
  Mesh mesh = jittered(4, 0.3);
  mesh.points[7] = mesh.points[8];
  mesh.tetrahedra.push_back({3, 9, 3, 20});
  mesh.points.resize(mesh.points.size() + 3, dvec3(0.5));
  const VertexMaterial material(mesh.points, mesh.tetrahedra);
  for (const std::size_t attributes : {1u, 2u, 3u, 6u}) {
    std::vector<std::vector<double>> values(attributes, std::vector<double>(mesh.points.size()));
    for (std::size_t a = 0; a < attributes; ++a)
      for (std::size_t v = 0; v < mesh.points.size(); ++v) {
        const dvec3& p = mesh.points[v];
        const bool missing = a % 2 == 1 && v % 11 == a;
        values[a][v] = missing ? std::numeric_limits<double>::quiet_NaN()
                               : std::sin(5 * p.x + static_cast<double>(a)) - p.y * p.z + (a == 4 ? 1e6 : 0);
      }
    VertexBlock block;
    std::size_t next = 0;
    material.find_values(0, mesh.points.size(), values, true, block,
                         [&](std::size_t v, const SpatialMoments& space, std::span<const VertexValue> found) {
                           EXPECT_EQ(v, next++);
                           expect_alone(mesh, values, v, space, found);
                         });
    EXPECT_EQ(next, mesh.points.size());
  }
}

// A block of a few vertices knows the values of these and of their neighbours alone. Its gradients may be left out.
TEST(VertexMaterial, BlocksHaveTheMaterialOfTheWhole) {
  const Mesh mesh = jittered(6, 0.3);
  const auto values = sample(mesh, [](dvec3 p) { return p.x * p.y + p.z; });
  const MeshMaterial whole = material_of(mesh, values);
  const VertexMaterial material(mesh.points, mesh.tetrahedra);
  VertexBlock block;
  ValueTable table;
  for (std::uint32_t first = 0; first + 5 <= mesh.points.size(); first += 37) {
    const std::array<std::uint32_t, 3> vertices = {first + 3, first, first + 4};
    material.make_block(vertices, block);
    ASSERT_TRUE(std::ranges::equal(block.vertices().first(3), vertices));
    EXPECT_LT(block.vertices().size(), mesh.points.size() / 2);
    table.resize(block.vertices().size(), 1);
    for (std::size_t i = 0; i < block.vertices().size(); ++i) table.column(0)[i] = values[block.vertices()[i]];
    block.find_values(table, false,
                      [&](std::size_t k, const SpatialMoments& space, std::span<const VertexValue> found) {
                        EXPECT_EQ(space.centroid, whole.moments[vertices[k]].centroid);
                        EXPECT_EQ(found[0].moments.mean, whole.value_moments[vertices[k]].mean);
                        EXPECT_EQ(found[0].moments.covariance, whole.value_moments[vertices[k]].covariance);
                        EXPECT_EQ(found[0].gradient, dvec3(0));
                      });
  }
}

TEST(VertexMaterial, PiecesAddUpToTheWhole) {
  const Mesh mesh = jittered(4, 0.2);
  const auto values = sample(mesh, [](dvec3 p) { return p.x * p.y + p.z; });
  Mesh left = mesh, right = mesh;
  const auto half = static_cast<std::ptrdiff_t>(mesh.tetrahedra.size() / 2);
  left.tetrahedra.erase(left.tetrahedra.begin() + half, left.tetrahedra.end());
  right.tetrahedra.erase(right.tetrahedra.begin(), right.tetrahedra.begin() + half);
  const auto moments = moments_of(mesh), b_moments = moments_of(right);
  const auto value_moments = value_moments_of(mesh, values), b_values = value_moments_of(right, values);
  const auto gradients = gradients_of(mesh, values), a_gradients = gradients_of(left, values),
             b_gradients = gradients_of(right, values);
  auto sum = moments_of(left);
  auto value_sum = value_moments_of(left, values);
  for (std::size_t i = 0; i < sum.size(); ++i) {
    merge(sum[i], b_moments[i], dvec3(0));
    merge(value_sum[i], b_values[i], dvec3(0));
    EXPECT_NEAR(sum[i].mass / moments[i].mass, 1, 1e-13);
    EXPECT_NEAR(sum[i].covariance.xy, moments[i].covariance.xy, 1e-13 * moments[i].covariance.xx);
    EXPECT_NEAR(value_sum[i].variance / value_moments[i].variance, 1, 1e-12);
    EXPECT_EQ(value_sum[i].min, value_moments[i].min);
    EXPECT_EQ(value_sum[i].max, value_moments[i].max);
    EXPECT_LT(glm::length(a_gradients[i] + b_gradients[i] - gradients[i]), 1e-12 * glm::length(gradients[i]));
  }
}

TEST(VertexGradients, PointAlongTheFieldsGradientWhereNeighboursSurroundTheVertex) {
  const Mesh mesh = jittered(6, 0.1);
  const dvec3 gradient = glm::normalize(dvec3(1, -2, 0.5));
  auto values = sample(mesh, [&](dvec3 p) { return 1e30 * glm::dot(gradient, p); });
  values[0] = nan;
  const auto gradients = gradients_of(mesh, values);
  EXPECT_EQ(gradients[0], dvec3(0));
  for (std::size_t i = 1; i < gradients.size(); ++i) {
    const dvec3 direction = glm::normalize(gradients[i]);
    EXPECT_GT(glm::dot(direction, gradient), 0) << i;
    // More edges of the lattice lie along (1, 1, 1) than across it, so the formula is not exact.
    const dvec3 p = mesh.points[i];
    if (glm::all(glm::lessThan(glm::abs(p - 0.5), dvec3(0.4)))) {
      EXPECT_GT(glm::dot(direction, gradient), 0.75) << i;
    }
  }
}

TEST(Merge, IsExactInAnyOrder) {
  std::mt19937_64 random(9);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const Mesh mesh = random_tetrahedra(40);
  std::vector<double> values(mesh.points.size());
  for (double& v : values) v = uniform(random);
  const auto moments = moments_of(mesh);
  const auto value_moments = value_moments_of(mesh, values);
  const RawMoments exact = whole(mesh, values);
  std::vector<std::size_t> order(moments.size());
  std::iota(order.begin(), order.end(), 0u);
  for (int round = 0; round < 5; ++round) {
    std::ranges::shuffle(order, random);
    // Two clusters about different points; one of them has no material at first.
    SpatialMoments a, b;
    ValueMoments va, vb;
    const dvec3 pa = mesh.points[order[0]], pb = mesh.points[order[1]];
    for (std::size_t k = 0; k < order.size(); ++k) {
      const std::size_t i = order[k];
      merge(k % 3 == 0 ? a : b, moments[i], mesh.points[i] - (k % 3 == 0 ? pa : pb));
      merge(k % 3 == 0 ? va : vb, value_moments[i], mesh.points[i] - (k % 3 == 0 ? pa : pb));
    }
    merge(a, b, pb - pa);
    merge(va, vb, pb - pa);
    expect_equal(a, pa, exact, 1e-13);
    expect_equal(va, pa, exact, 1e-13);
  }
}

TEST(Merge, NothingChangesNothing) {
  SpatialMoments a{2, {1, 2, 3}, {1, 2, 3, 0.1, 0.2, 0.3}};
  merge(a, {}, dvec3(100));
  EXPECT_EQ(a.mass, 2);
  EXPECT_EQ(a.centroid, dvec3(1, 2, 3));
  EXPECT_EQ(a.covariance.yz, 0.3);
  ValueMoments v;
  merge(v, {}, dvec3(1));
  EXPECT_EQ(v.mass, 0);
  EXPECT_GT(v.min, v.max);
}

SymmetricMatrix compose(const dmat3& axes, const dvec3& deviations) {
  const auto entry = [&](int i, int j) {
    double sum = 0;
    for (int k = 0; k < 3; ++k) sum += axes[k][i] * axes[k][j] * deviations[k] * deviations[k];
    return sum;
  };
  return {entry(0, 0), entry(1, 1), entry(2, 2), entry(0, 1), entry(0, 2), entry(1, 2)};
}

TEST(ShapeOf, FindsThePrincipalAxesAtEveryRatioAndScale) {
  std::mt19937_64 random(4);
  std::normal_distribution<double> normal;
  for (const double scale : {1e-140, 1e-6, 1.0, 1e6, 1e140})
    for (const dvec3 ratios : {dvec3(1, 0.5, 0.25), dvec3(1, 1e-2, 1e-4), dvec3(1, 1, 1e-4), dvec3(1, 1e-4, 1e-4),
                               dvec3(1, 1, 1), dvec3(1, 1 - 1e-9, 1 - 2e-9)})
      for (int round = 0; round < 20; ++round) {
        const glm::dquat turn = glm::normalize(random_quaternion(normal, random));
        const dvec3 deviations = scale * ratios;
        const SymmetricMatrix s = compose(glm::mat3_cast(turn), deviations);
        const SplatShape shape = shape_of({3, {}, s});
        EXPECT_EQ(shape.mass, 3);
        EXPECT_NEAR(glm::length(shape.orientation), 1, 1e-14);
        for (int k = 0; k < 3; ++k)
          EXPECT_NEAR(shape.deviations[k] / deviations[k], 1,
                      1e-7);  // an error of 1e-15 in the largest square is 1e-7 of 1e-8
        EXPECT_GE(shape.deviations[0], shape.deviations[1]);
        EXPECT_GE(shape.deviations[1], shape.deviations[2]);
        const SymmetricMatrix back = compose(glm::mat3_cast(shape.orientation), shape.deviations);
        for (int i = 0; i < 3; ++i)
          for (int j = 0; j < 3; ++j)
            EXPECT_NEAR(covariance_of(back, i, j) / scale / scale, covariance_of(s, i, j) / scale / scale, 1e-14);
      }
}

TEST(ShapeOf, DegenerateMaterialHasDeviationsOfZero) {
  EXPECT_EQ(shape_of({1, {}, {}}).deviations, dvec3(0));
  EXPECT_EQ(shape_of({1, {}, {}}).orientation, glm::dquat(1, 0, 0, 0));
  EXPECT_EQ(shape_of({1, {}, {0, 4, 0, 0, 0, 0}}).deviations, dvec3(2, 0, 0));
  // A line and a plane that no axis is parallel to: the other deviations are rounding.
  const dvec3 line = shape_of({1, {}, {1, 4, 9, 2, 3, 6}}).deviations;
  EXPECT_NEAR(line.x, std::sqrt(14.0), 1e-14);
  EXPECT_LT(line.y, 1e-7);
  const dvec3 plane = shape_of({1, {}, {1, 1, 2, 0, 1, 1}}).deviations;
  EXPECT_NEAR(plane.x, std::sqrt(3.0), 1e-14);
  EXPECT_NEAR(plane.y, 1, 1e-14);
  EXPECT_LT(plane.z, 1e-7);
}

TEST(ValueOf, LinearFieldsLeaveNoResidualAndConstantOnesNoDeviation) {
  const Mesh mesh = jittered(4, 0.3);
  const auto moments = moments_of(mesh);
  const auto linear = value_moments_of(mesh, sample(mesh, [](dvec3 p) { return 5 + p.x - 3 * p.z; }));
  const auto constant = value_moments_of(mesh, std::vector<double>(mesh.points.size(), 101325.25));
  const auto curved = value_moments_of(mesh, sample(mesh, [](dvec3 p) { return std::sin(40 * p.x + 70 * p.y); }));
  for (std::size_t i = 0; i < moments.size(); ++i) {
    const SplatShape shape = shape_of(moments[i]);
    EXPECT_LT(value_of(linear[i], shape).residual, 1e-6);
    EXPECT_EQ(value_of(linear[i], shape).coverage, 1);
    const SplatValue flat = value_of(constant[i], shape);
    EXPECT_EQ(flat.mean, 101325.25);
    EXPECT_EQ(flat.deviation, 0);
    EXPECT_EQ(flat.correlation, dvec3(0));
    EXPECT_GT(value_of(curved[i], shape).residual, 0.1);

    // The residual is the rest of the variance after the linear part.
    const dvec3 gradient = gradient_of(curved[i], moments[i]);
    const double left = curved[i].variance - glm::dot(gradient, curved[i].covariance);
    EXPECT_NEAR(value_of(curved[i], shape).residual, std::sqrt(left / curved[i].variance), 1e-9);
  }
}

TEST(ValueOf, NearlySingularMaterialDoesNotBlowUp) {
  for (const double thickness : {0.0, 1e-200, 1e-17, 1e-9, 1e-6}) {
    const dmat3 axes = glm::mat3_cast(glm::normalize(glm::dquat(1, 0.5, 0.2, -0.4)));
    const SpatialMoments moments{1, {}, compose(axes, {1, 0.3, thickness})};
    // No value could have this covariance in such thin material.
    const ValueMoments value{.mass = 0.5, .mean = 3, .variance = 4, .covariance = axes * dvec3(1, 0.1, 1e-3)};
    const SplatValue splat = value_of(value, shape_of(moments));
    for (int k = 0; k < 3; ++k) EXPECT_LE(std::abs(splat.correlation[k]), 1);
    EXPECT_GE(splat.residual, 0);
    EXPECT_LE(splat.residual, 1);
    EXPECT_EQ(splat.coverage, 0.5);
    EXPECT_EQ(splat.deviation, 2);
  }
}

}  // namespace
}  // namespace splatvol::test
