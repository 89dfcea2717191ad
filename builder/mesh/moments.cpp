#include "builder/mesh/moments.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <optional>
#include <utility>

namespace splatvol {
namespace {

// Moments of the barycentric coordinates over the quarter where L0 is the largest. With two others, La and Lb: E[La],
// E[La La] - E[La Lb], and E[La Lb].
constexpr double mean_share = 23.0 / 144;
constexpr double own_square = (161.0 - 97.0) / 4320;
constexpr double common_square = 97.0 / 4320;

constexpr double third = 1.0 / 3;

SymmetricMatrix operator*(double factor, const SymmetricMatrix& a) {
  return {factor * a.xx, factor * a.yy, factor * a.zz, factor * a.xy, factor * a.xz, factor * a.yz};
}

SymmetricMatrix operator+(const SymmetricMatrix& a, const SymmetricMatrix& b) {
  return {a.xx + b.xx, a.yy + b.yy, a.zz + b.zz, a.xy + b.xy, a.xz + b.xz, a.yz + b.yz};
}

SymmetricMatrix square(const dvec3& d) { return {d.x * d.x, d.y * d.y, d.z * d.z, d.x * d.y, d.x * d.z, d.y * d.z}; }

// A quarter of the tetrahedron's volume; 0 if the tetrahedron is flat, or too large for double precision.
double quarter_mass(std::span<const dvec3> positions, const Tetrahedron& corners) {
  std::array<dvec3, 3> edges;
  for (std::size_t k = 0; k < 3; ++k) edges[k] = positions[corners[k + 1]] - positions[corners[0]];
  const double mass = std::abs(glm::dot(edges[0], glm::cross(edges[1], edges[2]))) / 24;
  const double squares = glm::dot(edges[0], edges[0]) + glm::dot(edges[1], edges[1]) + glm::dot(edges[2], edges[2]);
  return std::isfinite(mass) && std::isfinite(squares) ? mass : 0;
}

// The quarter of a tetrahedron that one of its vertices owns. Everything is relative to this vertex, so that a position
// far from the origin costs no precision.
struct Quarter {
  std::array<std::uint32_t, 3> others;
  std::array<dvec3, 3> edges;
  double mass;
  double weight;  // share of the mass that the vertex owns

  [[nodiscard]] dvec3 sum() const { return edges[0] + edges[1] + edges[2]; }
};

// Adds raw moments about the vertex, times the quarter's weight. The vertex lies at its material, so that little
// cancels when they become central moments.
void add(SpatialMoments& sums, const Quarter& quarter) {
  const dvec3 sum = quarter.sum();
  sums.mass += quarter.mass;
  sums.centroid += quarter.weight * sum;
  sums.covariance =
      sums.covariance +
      quarter.weight * own_square * (square(quarter.edges[0]) + square(quarter.edges[1]) + square(quarter.edges[2]));
  sums.covariance = sums.covariance + quarter.weight * common_square * square(sum);
}

void finish(SpatialMoments& sums) {
  sums.centroid *= mean_share;
  sums.covariance = sums.covariance + -1.0 * square(sums.centroid);
}

// Adds the moments of a value, which is relative to the value at the vertex.
void add(ValueMoments& sums, const Quarter& quarter, std::span<const double> values, double own) {
  dvec3 rise;
  for (std::size_t k = 0; k < 3; ++k) rise[static_cast<int>(k)] = values[quarter.others[k]] - own;
  const double total = rise.x + rise.y + rise.z;
  if (!std::isfinite(total)) return;
  const dvec3 sum = quarter.sum();
  const double weight = quarter.weight;
  sums.mass += quarter.mass;
  sums.centroid += weight * sum;
  sums.mean += weight * total;
  sums.variance += weight * (own_square * glm::dot(rise, rise) + common_square * total * total);
  sums.covariance +=
      weight * own_square * (rise.x * quarter.edges[0] + rise.y * quarter.edges[1] + rise.z * quarter.edges[2]);
  sums.covariance += weight * common_square * total * sum;

  // A linear value is extreme at a corner of the quarter: the vertex, or the middle of an edge, a face or the
  // tetrahedron.
  double low = 0, high = 0;
  for (const double corner : {rise.x / 2, rise.y / 2, rise.z / 2, third * (rise.x + rise.y), third * (rise.y + rise.z),
                              third * (rise.z + rise.x), total / 4}) {
    low = std::min(low, corner);
    high = std::max(high, corner);
  }
  sums.min = std::min(sums.min, own + low);
  sums.max = std::max(sums.max, own + high);
}

// `mass`: of all material that the vertex owns, with and without a value.
void finish(ValueMoments& sums, double mass, double own) {
  if (!(sums.mass > 0)) return;
  const double share = mass / sums.mass;
  sums.centroid *= share * mean_share;
  sums.mean *= share * mean_share;
  sums.variance = share * sums.variance - sums.mean * sums.mean;
  sums.covariance = share * sums.covariance - sums.mean * sums.centroid;
  sums.mean += own;
}

// Numbers of different matrices or attributes, side by side: the processor waits for their roots and quotients only
// once.
constexpr std::size_t lanes = shapes_at_once;
using Lanes [[gnu::vector_size(lanes * sizeof(double))]] = double;
using LaneBits [[gnu::vector_size(lanes * sizeof(double))]] = std::int64_t;

constexpr LaneBits sign_bit = LaneBits{} + std::numeric_limits<std::int64_t>::min();

inline void take_root(Lanes& x) {
  for (std::size_t l = 0; l < lanes; ++l) x[l] = std::sqrt(x[l]);
}
inline Lanes magnitude(const Lanes& x) { return std::bit_cast<Lanes>(std::bit_cast<LaneBits>(x) & ~sign_bit); }
inline bool any(const LaneBits& mask) {
  std::int64_t all = 0;
  for (std::size_t l = 0; l < lanes; ++l) all |= mask[l];
  return all != 0;
}

static_assert(lanes == ValueTable::lanes);

inline Lanes lanes_of(const ValueTable::Row& row) { return std::bit_cast<Lanes>(row); }

// A quarter, with all that does not depend on values.
struct MeasuredQuarter {
  Quarter quarter;
  dvec3 sum;      // of the edges
  dvec3 squares;  // of the edges' lengths
};

// Sums over the quarters of a vertex, as ValueMoments and a gradient before finish().
struct LaneSums {
  Lanes mass{}, mean{}, variance{};
  Lanes min = Lanes{} + std::numeric_limits<double>::infinity();
  Lanes max = Lanes{} - std::numeric_limits<double>::infinity();
  Lanes centroid[3] = {}, covariance[3] = {}, gradient[3] = {};

  [[nodiscard]] VertexValue value(std::size_t lane) const {
    VertexValue result;
    ValueMoments& moments = result.moments;
    moments.mass = mass[lane], moments.mean = mean[lane], moments.variance = variance[lane];
    moments.min = min[lane], moments.max = max[lane];
    for (int k = 0; k < 3; ++k) {
      moments.centroid[k] = centroid[k][lane];
      moments.covariance[k] = covariance[k][lane];
      result.gradient[k] = gradient[k][lane];
    }
    return result;
  }
};

inline LaneBits is_finite(const Lanes& x) { return x - x == 0; }

// As the add() of one value, in the same order of operations.
inline void add_moments(LaneSums& sums, const MeasuredQuarter& measured, const Lanes (&rise)[3], const Lanes& own) {
  const Lanes total = rise[0] + rise[1] + rise[2];
  const LaneBits counts = is_finite(total);
  const auto add = [&](Lanes& to, const Lanes& term) { to = counts ? to + term : to; };
  const Quarter& quarter = measured.quarter;
  const double weight = quarter.weight;
  add(sums.mass, Lanes{} + quarter.mass);
  add(sums.mean, weight * total);
  add(sums.variance, weight * (own_square * (rise[0] * rise[0] + rise[1] * rise[1] + rise[2] * rise[2]) +
                               common_square * total * total));
  for (int k = 0; k < 3; ++k) {
    add(sums.centroid[k], Lanes{} + weight * measured.sum[k]);
    add(sums.covariance[k],
        weight * own_square *
            (rise[0] * quarter.edges[0][k] + rise[1] * quarter.edges[1][k] + rise[2] * quarter.edges[2][k]));
    add(sums.covariance[k], weight * common_square * total * measured.sum[k]);
  }
  Lanes low{}, high{};
  for (const Lanes& corner : {rise[0] / 2, rise[1] / 2, rise[2] / 2, third * (rise[0] + rise[1]),
                              third * (rise[1] + rise[2]), third * (rise[2] + rise[0]), total / 4}) {
    low = corner < low ? corner : low;
    high = corner > high ? corner : high;
  }
  low += own, high += own;
  sums.min = (counts & (low < sums.min)) ? low : sums.min;
  sums.max = (counts & (high > sums.max)) ? high : sums.max;
}

inline void add_gradient(LaneSums& sums, const MeasuredQuarter& measured, const Lanes (&rise)[3]) {
  for (int e = 0; e < 3; ++e) {
    const Lanes slope = rise[e] / measured.squares[e];
    const dvec3& edge = measured.quarter.edges[static_cast<std::size_t>(e)];
    const Lanes difference[3] = {slope * edge.x, slope * edge.y, slope * edge.z};
    const LaneBits counts = is_finite(difference[0] + difference[1] + difference[2]);
    for (int k = 0; k < 3; ++k) sums.gradient[k] = counts ? sums.gradient[k] + difference[k] : sums.gradient[k];
  }
}

// Spreads numbers that are often near each other over a hash table.
constexpr std::size_t hash_of(std::uint32_t vertex) { return vertex * std::size_t{0x9e3779b97f4a7c15} >> 32; }

// Symmetric matrices while they become diagonal: at the end, eigenvalues, and eigenvectors as columns.
struct Decomposition {
  Lanes diagonal[3] = {};
  Lanes beside[3] = {};  // [k]: the entry in neither row k nor column k
  Lanes vectors[3][3] = {};

  void set(std::size_t lane, const SymmetricMatrix& m) {
    diagonal[0][lane] = m.xx, diagonal[1][lane] = m.yy, diagonal[2][lane] = m.zz;
    beside[0][lane] = m.yz, beside[1][lane] = m.xz, beside[2][lane] = m.xy;
    for (const int k : {0, 1, 2}) vectors[k][k][lane] = 1;
  }
  [[nodiscard]] std::array<double, 3> values(std::size_t lane) const {
    return {diagonal[0][lane], diagonal[1][lane], diagonal[2][lane]};
  }
  [[nodiscard]] dvec3 axis(std::size_t lane, std::size_t k) const {
    return {vectors[k][0][lane], vectors[k][1][lane], vectors[k][2][lane]};
  }
};

// Rotates so that the entry in row p and column q becomes 0; r is the third axis. Returns false if it is negligible in
// all lanes already.
bool rotate(Decomposition& m, int p, int q, int r) {
  constexpr double epsilon = std::numeric_limits<double>::epsilon() / 4, negligible = epsilon * epsilon;
  Lanes& pivot = m.beside[r];
  const LaneBits turns = pivot * pivot > negligible * magnitude(m.diagonal[p] * m.diagonal[q]);
  if (!any(turns)) return false;
  const Lanes rise = m.diagonal[q] - m.diagonal[p], twice = 2 * pivot;
  Lanes hypotenuse = rise * rise + twice * twice;
  take_root(hypotenuse);
  const LaneBits sign = std::bit_cast<LaneBits>(rise) & sign_bit;
  const Lanes signed_twice = std::bit_cast<Lanes>(std::bit_cast<LaneBits>(twice) ^ sign);
  const Lanes t = turns ? signed_twice / (magnitude(rise) + hypotenuse) : Lanes{};
  Lanes secant = 1 + t * t;
  take_root(secant);
  const Lanes cosine = 1 / secant, sine = t * cosine;
  m.diagonal[p] -= t * pivot;
  m.diagonal[q] += t * pivot;
  pivot = turns ? Lanes{} : pivot;
  const auto turn = [&](Lanes& a, Lanes& b) {
    const Lanes old = a;
    a = cosine * old - sine * b;
    b = sine * old + cosine * b;
  };
  turn(m.beside[q], m.beside[p]);
  for (int k = 0; k < 3; ++k) turn(m.vectors[p][k], m.vectors[q][k]);
  return true;
}

// The cyclic Jacobi method, which keeps the small eigenvalues of graded matrices. Requires entries far from overflow. A
// lane does not depend on the others.
void diagonalize(Decomposition& m) {
  constexpr int sweeps = 32;  // about 5 are used; rounding noise must not keep it going
  bool rotated = true;
  for (int sweep = 0; rotated && sweep < sweeps; ++sweep) {
    rotated = rotate(m, 0, 1, 2);
    rotated = rotate(m, 0, 2, 1) || rotated;
    rotated = rotate(m, 1, 2, 0) || rotated;
  }
}

using AxisOrder = std::array<std::uint8_t, 3>;

// Sorts in descending order, stable. The library's stable sort would allocate.
AxisOrder descending(const std::array<double, 3>& values) {
  AxisOrder order = {0, 1, 2};
  for (const auto& [a, b] : {std::pair<std::size_t, std::size_t>{0, 1}, {1, 2}, {0, 1}})
    if (values[order[b]] > values[order[a]]) std::swap(order[a], order[b]);
  return order;
}

// The rotation that turns x and y onto these axes, and z onto the axis that makes them right-handed.
glm::dquat orientation(const dvec3& first, const dvec3& second) {
  return glm::normalize(glm::quat_cast(dmat3(first, second, glm::cross(first, second))));
}

// The rotation that turns x, y and z onto the same axes in descending order of these numbers, ties in their old order.
const glm::dquat& orientation_along_axes(double x, double y, double z) {
  static const auto table = [] {
    std::array<glm::dquat, 8> all{};  // [whether y > x, z > y, z > x], in bits
    const dmat3 axes(1);
    all[0] = orientation(axes[0], axes[1]);
    all[1] = orientation(axes[1], axes[0]);
    all[2] = orientation(axes[0], axes[2]);
    all[5] = orientation(axes[1], axes[2]);
    all[6] = orientation(axes[2], axes[0]);
    all[7] = orientation(axes[2], axes[1]);
    return all;
  }();
  return table[static_cast<std::size_t>(y > x) | static_cast<std::size_t>(z > y) << 1 |
               static_cast<std::size_t>(z > x) << 2];
}

bool has_extent(const SpatialMoments& moments) {
  const SymmetricMatrix& s = moments.covariance;
  return moments.mass > 0 && std::max({s.xx, s.yy, s.zz}) >= std::numeric_limits<double>::min();
}

// True for the boxes of scattered points, and for material without extent.
bool is_along_axes(const SpatialMoments& moments) {
  const SymmetricMatrix& s = moments.covariance;
  return (s.xy == 0 && s.xz == 0 && s.yz == 0) || !has_extent(moments);
}

SplatShape shape_along_axes(const SpatialMoments& moments) {
  SplatShape shape{.mass = moments.mass};
  if (!has_extent(moments)) return shape;
  const SymmetricMatrix& s = moments.covariance;
  const double low = std::min(s.xx, s.yy), high = std::max(s.xx, s.yy);
  shape.deviations.x = std::sqrt(std::max(high, s.zz));
  shape.deviations.y = std::sqrt(std::max(0.0, std::max(low, std::min(high, s.zz))));
  shape.deviations.z = std::sqrt(std::max(0.0, std::min(low, s.zz)));
  shape.orientation = orientation_along_axes(s.xx, s.yy, s.zz);
  return shape;
}

}  // namespace

void merge(SpatialMoments& a, const SpatialMoments& b, const dvec3& shift) {
  if (!(b.mass > 0)) return;
  const double mass = a.mass + b.mass, of_a = a.mass / mass, of_b = b.mass / mass;
  const dvec3 between = b.centroid + shift - a.centroid;
  a.covariance = of_a * a.covariance + of_b * b.covariance + of_a * of_b * square(between);
  a.centroid += of_b * between;
  a.mass = mass;
}

void merge(ValueMoments& a, const ValueMoments& b, const dvec3& shift) {
  if (!(b.mass > 0)) return;
  const double mass = a.mass + b.mass, of_a = a.mass / mass, of_b = b.mass / mass;
  const dvec3 between = b.centroid + shift - a.centroid;
  const double rise = b.mean - a.mean;
  a.variance = of_a * a.variance + of_b * b.variance + of_a * of_b * rise * rise;
  a.covariance = of_a * a.covariance + of_b * b.covariance + of_a * of_b * rise * between;
  a.centroid += of_b * between;
  a.mean += of_b * rise;
  a.mass = mass;
  a.min = std::min(a.min, b.min);
  a.max = std::max(a.max, b.max);
}

IndexLists tetrahedra_at_points(std::size_t points, std::span<const Tetrahedron> tetrahedra) {
  IndexLists lists;
  lists.assign(points, [&](const auto& add) {
    for (std::uint32_t t = 0; t < tetrahedra.size(); ++t)
      for (const std::uint32_t corner : tetrahedra[t]) add(corner, t);
  });
  return lists;
}

VertexMaterial::VertexMaterial(std::span<const dvec3> positions, std::span<const Tetrahedron> tetrahedra)
    : positions_(positions),
      tetrahedra_(tetrahedra),
      incident_(tetrahedra_at_points(positions.size(), tetrahedra)),
      masses_(tetrahedra.size()) {
  tbb::parallel_for(std::size_t{0}, tetrahedra.size(),
                    [&](std::size_t t) { masses_[t] = quarter_mass(positions, tetrahedra[t]); });
}

// Calls add_quarter(quarter) for each tetrahedron at a vertex; returns the mass of all quarters.
template <class Add>
double VertexMaterial::visit(std::size_t vertex, Add add_quarter) const {
  const std::span<const std::uint32_t> incident = incident_[vertex];
  double mass = 0;
  for (const std::uint32_t t : incident) mass += masses_[t];
  for (const std::uint32_t t : incident) {
    const Tetrahedron& corners = tetrahedra_[t];
    const auto own = static_cast<std::size_t>(std::ranges::find(corners, vertex) - corners.begin());
    Quarter quarter;
    for (std::size_t k = 0; k < 3; ++k) {
      quarter.others[k] = corners[(own + 1 + k) % 4];
      quarter.edges[k] = positions_[quarter.others[k]] - positions_[vertex];
    }
    quarter.mass = masses_[t];
    quarter.weight = mass > 0 ? masses_[t] / mass : 0;
    add_quarter(quarter);
  }
  return mass;
}

SpatialMoments VertexMaterial::moments(std::size_t vertex) const {
  SpatialMoments sums;
  visit(vertex, [&](const Quarter& quarter) {
    if (quarter.mass > 0) add(sums, quarter);
  });
  finish(sums);
  return sums;
}

ValueMoments VertexMaterial::value_moments(std::size_t vertex, std::span<const double> values) const {
  ValueMoments sums;
  const double mass = visit(vertex, [&](const Quarter& quarter) {
    if (quarter.mass > 0) add(sums, quarter, values, values[vertex]);
  });
  finish(sums, mass, values[vertex]);
  return sums;
}

dvec3 VertexMaterial::gradient(std::size_t vertex, std::span<const double> values) const {
  dvec3 gradient(0);
  visit(vertex, [&](const Quarter& quarter) {
    for (std::size_t k = 0; k < 3; ++k) {
      const double rise = values[quarter.others[k]] - values[vertex];
      const dvec3 difference = rise / glm::dot(quarter.edges[k], quarter.edges[k]) * quarter.edges[k];
      if (std::isfinite(difference.x + difference.y + difference.z)) gradient += difference;
    }
  });
  return gradient;
}

void VertexBlock::clear() {
  vertices_.clear();
  others_.clear();
  begins_.clear();
  std::ranges::fill(slots_, 0u);
}

// Doubles the hash table.
void VertexBlock::grow() {
  slots_.assign(std::max<std::size_t>(2 * slots_.size(), 1024), 0);
  const std::size_t mask = slots_.size() - 1;
  for (std::uint32_t number = 0; number < vertices_.size(); ++number) {
    std::size_t slot = hash_of(vertices_[number]) & mask;
    while (slots_[slot] != 0) slot = (slot + 1) & mask;
    slots_[slot] = number + 1;
  }
}

// Returns the vertex's new number, and gives it one if it has none.
std::uint32_t VertexBlock::number_of(std::uint32_t vertex) {
  if (2 * vertices_.size() >= slots_.size()) grow();
  const std::size_t mask = slots_.size() - 1;
  std::size_t slot = hash_of(vertex) & mask;
  for (; slots_[slot] != 0; slot = (slot + 1) & mask)
    if (vertices_[slots_[slot] - 1] == vertex) return slots_[slot] - 1;
  vertices_.push_back(vertex);
  slots_[slot] = static_cast<std::uint32_t>(vertices_.size());
  return slots_[slot] - 1;
}

void VertexMaterial::make_block(std::span<const std::uint32_t> vertices, VertexBlock& block) const {
  block.clear();
  for (const std::uint32_t vertex : vertices) block.number_of(vertex);
  for (const std::uint32_t vertex : vertices) {
    block.begins_.push_back(block.others_.size());
    for (const std::uint32_t t : incident_[vertex]) {
      const Tetrahedron& corners = tetrahedra_[t];
      const auto own = static_cast<std::size_t>(std::ranges::find(corners, vertex) - corners.begin());
      std::array<std::uint32_t, 3>& others = block.others_.emplace_back();
      for (std::size_t k = 0; k < 3; ++k) others[k] = block.number_of(corners[(own + 1 + k) % 4]);
    }
  }
}

SpatialMoments VertexMaterial::find_values(const VertexBlock& block, std::size_t number, const ValueTable& table,
                                           bool gradients, std::span<VertexValue> values) const {
  thread_local std::vector<MeasuredQuarter> quarters;
  quarters.clear();
  SpatialMoments space;
  const double mass = visit(block.vertices_[number], [&](const Quarter& quarter) {
    if (quarter.mass > 0) add(space, quarter);
    const auto& [a, b, c] = quarter.edges;
    MeasuredQuarter& measured = quarters.emplace_back(
        MeasuredQuarter{quarter, quarter.sum(), {glm::dot(a, a), glm::dot(b, b), glm::dot(c, c)}});
    measured.quarter.others = block.others_[block.begins_[number] + quarters.size() - 1];
  });
  finish(space);
  for (std::size_t first = 0; first < table.attributes(); first += lanes) {
    const std::span<const ValueTable::Row> rows = table.rows(first);
    const Lanes own = lanes_of(rows[number]);
    LaneSums sums;
    for (const MeasuredQuarter& measured : quarters) {
      const auto& [a, b, c] = measured.quarter.others;
      const Lanes rise[3] = {lanes_of(rows[a]) - own, lanes_of(rows[b]) - own, lanes_of(rows[c]) - own};
      if (measured.quarter.mass > 0) add_moments(sums, measured, rise, own);
      if (gradients) add_gradient(sums, measured, rise);
    }
    for (std::size_t lane = 0; lane < lanes && first + lane < table.attributes(); ++lane) {
      values[first + lane] = sums.value(lane);
      finish(values[first + lane].moments, mass, own[lane]);
    }
  }
  return space;
}

std::array<SplatShape, shapes_at_once> shapes_of(std::span<const SpatialMoments* const> moments) {
  std::array<SplatShape, shapes_at_once> shapes;
  std::array<double, shapes_at_once> scales{};  // 0: done
  std::optional<Decomposition> axes;            // most shapes of scattered points do without
  for (std::size_t l = 0; l < moments.size(); ++l) {
    const SymmetricMatrix& s = moments[l]->covariance;
    if (is_along_axes(*moments[l])) {
      shapes[l] = shape_along_axes(*moments[l]);
    } else {
      scales[l] = std::max({s.xx, s.yy, s.zz});
      if (!axes) axes.emplace();
      axes->set(l, 1 / scales[l] * s);
    }
  }
  if (!axes) return shapes;
  diagonalize(*axes);
  for (std::size_t l = 0; l < moments.size(); ++l) {
    if (scales[l] == 0) continue;
    const std::array<double, 3> values = axes->values(l);
    const AxisOrder order = descending(values);
    shapes[l].mass = moments[l]->mass;
    for (int k = 0; k < 3; ++k)
      shapes[l].deviations[k] = std::sqrt(std::max(0.0, values[order[k]])) * std::sqrt(scales[l]);
    shapes[l].orientation = orientation(axes->axis(l, order[0]), axes->axis(l, order[1]));
  }
  return shapes;
}

SplatShape shape_of(const SpatialMoments& moments) {
  return is_along_axes(moments) ? shape_along_axes(moments) : shapes_of(std::array{&moments})[0];
}

SplatValue value_of(const ValueMoments& value, const SplatShape& shape) {
  if (!(value.mass > 0)) return {};
  SplatValue result{.mean = value.mean, .deviation = std::sqrt(std::max(0.0, value.variance))};
  const dmat3 axes = glm::mat3_cast(shape.orientation);
  const auto correlation = [&](const dvec3& axis, double deviation) {
    const double largest = result.deviation * deviation;
    return largest > 0 ? std::clamp(glm::dot(axis, value.covariance) / largest, -1.0, 1.0) : 0;
  };
  const double x = correlation(axes[0], shape.deviations.x);
  const double y = correlation(axes[1], shape.deviations.y);
  const double z = correlation(axes[2], shape.deviations.z);
  result.correlation = {x, y, z};
  result.residual = std::sqrt(std::max(0.0, 1 - (x * x + y * y + z * z)));
  result.coverage = std::min(1.0, value.mass / shape.mass);
  return result;
}

}  // namespace splatvol
