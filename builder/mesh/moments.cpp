#include "builder/mesh/moments.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <new>
#include <numeric>
#include <utility>

#include "builder/mesh/lanes.h"

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

// Quarters of the tetrahedra's volumes; 0 if a tetrahedron is flat, or too large for double precision.
Lanes quarter_masses(const TetrahedronLanes& corners) {
  const LaneVectors ab = corners.b - corners.a, ac = corners.c - corners.a, ad = corners.d - corners.a;
  const Lanes mass = magnitude(dot(ab, cross(ac, ad))) / 24;
  const Lanes squares = dot(ab, ab) + dot(ac, ac) + dot(ad, ad);
  return is_finite(mass) & is_finite(squares) ? mass : Lanes{};
}

// Quarters of four vertices side by side, one of each. Everything is relative to the vertex, so that a position far
// from the origin costs no precision.
struct LaneQuarter {
  LaneVectors edges[3];
  LaneVectors sum;  // of the edges
  Lanes mass, weight;

  // `of_vertices`: the masses of all their quarters.
  LaneQuarter(const LaneVectors& a, const LaneVectors& b, const LaneVectors& c, const Lanes& own_mass,
              const Lanes& of_vertices)
      : edges{a, b, c}, sum(a + b + c), mass(own_mass), weight(of_vertices > 0 ? own_mass / of_vertices : Lanes{}) {}
};

// Numbers, or positions, side by side.
inline Lanes gather(std::span<const double> numbers, const std::array<std::uint32_t, lanes>& at) {
  return Lanes{numbers[at[0]], numbers[at[1]], numbers[at[2]], numbers[at[3]]};
}
inline LaneVectors gather(std::span<const dvec3> positions, const std::array<std::uint32_t, lanes>& at) {
  return lanes_of(positions[at[0]], positions[at[1]], positions[at[2]], positions[at[3]]);
}

// Adds `term` in the lanes that count.
inline void add(Lanes& sum, const LaneBits& counts, const Lanes& term) { sum = counts ? sum + term : sum; }
inline void add(LaneVectors& sum, const LaneBits& counts, const LaneVectors& term) {
  add(sum.x, counts, term.x), add(sum.y, counts, term.y), add(sum.z, counts, term.z);
}

// Sums over quarters, as SpatialMoments before and after finish(). The mass is known before.
struct LaneSpace {
  Lanes mass{};
  LaneVectors centroid{};
  LaneVectors squares{}, products{};  // of the covariance: xx, yy, zz; xy, xz, yz

  [[nodiscard]] SpatialMoments moments(std::size_t l) const {
    return {
        mass[l], centroid[l], {squares.x[l], squares.y[l], squares.z[l], products.x[l], products.y[l], products.z[l]}};
  }
};

inline LaneVectors squares_of(const LaneVectors& d) { return {d.x * d.x, d.y * d.y, d.z * d.z}; }
inline LaneVectors products_of(const LaneVectors& d) { return {d.x * d.y, d.x * d.z, d.y * d.z}; }

// Adds raw moments about the vertex, times the quarter's weight. The vertex lies at its material, so that little
// cancels when they become central moments.
inline void add(LaneSpace& sums, const LaneQuarter& quarter) {
  const LaneBits counts = quarter.mass > 0;
  const auto& [a, b, c] = quarter.edges;
  const Lanes own = quarter.weight * own_square, common = quarter.weight * common_square;
  add(sums.centroid, counts, quarter.weight * quarter.sum);
  add(sums.squares, counts, own * (squares_of(a) + squares_of(b) + squares_of(c)));
  add(sums.products, counts, own * (products_of(a) + products_of(b) + products_of(c)));
  add(sums.squares, counts, common * squares_of(quarter.sum));
  add(sums.products, counts, common * products_of(quarter.sum));
}

inline void finish(LaneSpace& sums) {
  sums.centroid = (Lanes{} + mean_share) * sums.centroid;
  sums.squares = sums.squares - squares_of(sums.centroid);
  sums.products = sums.products - products_of(sums.centroid);
}

// Sums over quarters, as ValueMoments and a gradient before and after finish(), and the value at the vertex.
struct LaneSums {
  Lanes own{};
  Lanes mass{}, mean{}, variance{};
  Lanes min = Lanes{} + std::numeric_limits<double>::infinity();
  Lanes max = Lanes{} - std::numeric_limits<double>::infinity();
  LaneVectors centroid{}, covariance{}, gradient{};

  [[nodiscard]] VertexValue value(std::size_t l) const {
    return {{mass[l], centroid[l], mean[l], variance[l], covariance[l], min[l], max[l]}, gradient[l]};
  }
};

// Adds the moments of a value. `rise`: from the value at the vertex to those at the other corners.
inline void add_moments(LaneSums& sums, const LaneQuarter& quarter, const LaneVectors& rise) {
  const Lanes total = rise.x + rise.y + rise.z;
  const LaneBits counts = is_finite(total) & (quarter.mass > 0);
  const auto& [a, b, c] = quarter.edges;
  const Lanes& weight = quarter.weight;
  const Lanes own = weight * own_square, common = weight * common_square;
  add(sums.mass, counts, quarter.mass);
  add(sums.mean, counts, weight * total);
  add(sums.variance, counts, weight * (own_square * dot(rise, rise) + common_square * total * total));
  add(sums.centroid, counts, weight * quarter.sum);
  add(sums.covariance, counts, own * (rise.x * a + rise.y * b + rise.z * c));
  add(sums.covariance, counts, common * total * quarter.sum);

  // A linear value is extreme at a corner of the quarter: the vertex, or the middle of an edge, a face or the
  // tetrahedron.
  Lanes low{}, high{};
  const auto include = [&](const Lanes& corner) {
    low = corner < low ? corner : low;
    high = corner > high ? corner : high;
  };
  include(rise.x / 2), include(rise.y / 2), include(rise.z / 2);
  include(third * (rise.x + rise.y)), include(third * (rise.y + rise.z)), include(third * (rise.z + rise.x));
  include(total / 4);
  low += sums.own, high += sums.own;
  sums.min = (counts & (low < sums.min)) ? low : sums.min;
  sums.max = (counts & (high > sums.max)) ? high : sums.max;
}

inline void add_gradient(LaneSums& sums, const LaneQuarter& quarter, const LaneVectors& rise) {
  const auto add_along = [&](const LaneVectors& edge, const Lanes& rise_along) {
    const LaneVectors difference = rise_along / dot(edge, edge) * edge;
    add(sums.gradient, is_finite(difference.x + difference.y + difference.z), difference);
  };
  add_along(quarter.edges[0], rise.x), add_along(quarter.edges[1], rise.y), add_along(quarter.edges[2], rise.z);
}

// `mass`: of all material that each vertex owns, with and without a value.
inline void finish(LaneSums& sums, const Lanes& mass) {
  const LaneBits any = sums.mass > 0;
  const Lanes share = any ? mass / sums.mass : Lanes{};
  sums.centroid = share * mean_share * sums.centroid;
  sums.mean *= share * mean_share;
  sums.variance = share * sums.variance - sums.mean * sums.mean;
  sums.covariance = share * sums.covariance - sums.mean * sums.centroid;
  sums.mean = any ? sums.mean + sums.own : sums.mean;
}

// Symmetric matrices while they become diagonal: at the end, eigenvalues, and eigenvectors as columns.
struct Decomposition {
  Lanes diagonal[3];
  Lanes beside[3];  // [k]: the entry in neither row k nor column k
  Lanes vectors[3][3];

  explicit Decomposition(const std::array<SymmetricMatrix, lanes>& of) {
    const auto gathered = [&](double SymmetricMatrix::*entry) {
      return Lanes{of[0].*entry, of[1].*entry, of[2].*entry, of[3].*entry};
    };
    using Matrix = SymmetricMatrix;
    diagonal[0] = gathered(&Matrix::xx), diagonal[1] = gathered(&Matrix::yy), diagonal[2] = gathered(&Matrix::zz);
    beside[0] = gathered(&Matrix::yz), beside[1] = gathered(&Matrix::xz), beside[2] = gathered(&Matrix::xy);
    for (int k = 0; k < 3; ++k)
      for (int i = 0; i < 3; ++i) vectors[k][i] = Lanes{} + (i == k ? 1.0 : 0.0);
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

// Finds the shapes of moments that are not along the axes.
void find_turned_shapes(std::span<const SpatialMoments* const> moments,
                        std::array<SplatShape, shapes_at_once>& shapes) {
  std::array<double, lanes> scales{};  // 0: along the axes, or none
  std::array<SymmetricMatrix, lanes> scaled{};
  for (std::size_t l = 0; l < moments.size(); ++l) {
    if (is_along_axes(*moments[l])) continue;
    const SymmetricMatrix& s = moments[l]->covariance;
    scales[l] = std::max({s.xx, s.yy, s.zz});
    scaled[l] = 1 / scales[l] * s;
  }
  Decomposition axes(scaled);
  diagonalize(axes);
  for (std::size_t l = 0; l < moments.size(); ++l) {
    if (scales[l] == 0) continue;
    const std::array<double, 3> values = axes.values(l);
    const AxisOrder order = descending(values);
    const auto deviation = [&](std::size_t k) {
      return std::sqrt(std::max(0.0, values[order[k]])) * std::sqrt(scales[l]);
    };
    shapes[l] = {.mass = moments[l]->mass,
                 .deviations = {deviation(0), deviation(1), deviation(2)},
                 .orientation = orientation(axes.axis(l, order[0]), axes.axis(l, order[1]))};
  }
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
  visit_side_by_side(positions, tetrahedra, [&](std::size_t t, std::size_t count, const TetrahedronLanes& corners) {
    const Lanes masses = quarter_masses(corners);
    for (std::size_t l = 0; l < count; ++l) masses_[t + l] = masses[l];
  });
}

void VertexBlock::clear(std::size_t mesh_vertices) {
  for (const std::uint32_t vertex : vertices_) numbers_[vertex] = 0;
  numbers_.resize(std::max(numbers_.size(), mesh_vertices));
  vertices_.clear();
  positions_.clear();
  masses_.clear();
  begins_.assign(1, 0);
}

// Returns the vertex's new number, and gives it one if it has none.
std::uint32_t VertexBlock::number_of(std::uint32_t vertex, std::span<const dvec3> positions) {
  std::uint32_t& number = numbers_[vertex];
  if (number == 0) {
    vertices_.push_back(vertex);
    positions_.push_back(positions[vertex]);
    number = static_cast<std::uint32_t>(vertices_.size());
  }
  return number - 1;
}

void VertexMaterial::make_block(std::span<const std::uint32_t> vertices, VertexBlock& block) const {
  block.clear(positions_.size());
  for (const std::uint32_t vertex : vertices) {
    block.number_of(vertex, positions_);
    block.begins_.push_back(block.begins_.back() + incident_[vertex].size());
  }
  block.quarters_.resize(block.begins_.back());
  VertexBlock::Quarter* quarter = block.quarters_.data();
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    const std::uint32_t vertex = vertices[v];
    if (v + 1 < vertices.size())
      for (const std::uint32_t t : incident_[vertices[v + 1]]) {
        __builtin_prefetch(&tetrahedra_[t]);
        __builtin_prefetch(&masses_[t]);
      }
    double mass = 0;
    for (const std::uint32_t t : incident_[vertex]) {
      const Tetrahedron& corners = tetrahedra_[t];
      const std::size_t own = place_of(vertex, corners);
      for (std::size_t k = 0; k < 3; ++k) quarter->others[k] = block.number_of(corners[(own + 1 + k) % 4], positions_);
      quarter->mass = masses_[t];
      mass += masses_[t];
      ++quarter;
    }
    block.masses_.push_back(mass);
  }
}

void VertexMaterial::find_values(std::size_t begin, std::size_t end, std::span<const std::vector<double>> values,
                                 bool gradients, VertexBlock& block, const VertexBlock::VisitVertex& visit) const {
  constexpr std::size_t at_once = 1024;
  std::vector<std::uint32_t> vertices;
  ValueTable table;
  for (std::size_t first = begin; first < end; first += at_once) {
    vertices.resize(std::min(at_once, end - first));
    std::iota(vertices.begin(), vertices.end(), static_cast<std::uint32_t>(first));
    make_block(vertices, block);
    table.resize(block.vertices().size(), values.size());
    for (std::size_t a = 0; a < values.size(); ++a)
      std::ranges::transform(block.vertices(), table.column(a).begin(), [&](std::uint32_t v) { return values[a][v]; });
    block.find_values(table, gradients, [&](std::size_t number, const SpatialMoments& space, const auto& found) {
      visit(first - begin + number, space, found);
    });
  }
}

void VertexBlock::find_values(const ValueTable& table, bool gradients, const VisitVertex& visit) const {
  std::vector<LaneSums> sums(table.attributes());
  std::vector<VertexValue> values(table.attributes());
  for (std::size_t first = 0; first < masses_.size(); first += lanes) {
    // A lane whose vertex has no more quarters gets one without extent and mass, which adds nothing.
    const std::size_t used = std::min(lanes, masses_.size() - first);
    std::array<std::uint32_t, lanes> numbers;
    std::array<Quarter, lanes> none;
    std::array<std::span<const Quarter>, lanes> quarters;
    std::size_t most = 0;
    for (std::size_t l = 0; l < lanes; ++l) {
      const auto number = numbers[l] = static_cast<std::uint32_t>(first + std::min(l, used - 1));
      none[l] = {{number, number, number}, 0};
      quarters[l] = std::span(quarters_).subspan(begins_[number], begins_[number + 1] - begins_[number]);
      most = std::max(most, quarters[l].size());
    }
    LaneSpace space{.mass = gather(std::span(masses_), numbers)};
    const LaneVectors own = gather(std::span(positions_), numbers);
    for (std::size_t a = 0; a < sums.size(); ++a) sums[a] = {.own = gather(table.column(a), numbers)};

    for (std::size_t q = 0; q < most; ++q) {
      std::array<const Quarter*, lanes> four;
      for (std::size_t l = 0; l < lanes; ++l) four[l] = q < quarters[l].size() ? &quarters[l][q] : &none[l];
      const auto corners = [&](std::size_t k) {
        return std::array{four[0]->others[k], four[1]->others[k], four[2]->others[k], four[3]->others[k]};
      };
      const std::array a = corners(0), b = corners(1), c = corners(2);
      const auto edge = [&](const auto& to) { return gather(std::span(positions_), to) - own; };
      const Lanes masses{four[0]->mass, four[1]->mass, four[2]->mass, four[3]->mass};
      const LaneQuarter quarter(edge(a), edge(b), edge(c), masses, space.mass);
      add(space, quarter);
      for (std::size_t i = 0; i < sums.size(); ++i) {
        const std::span<const double> column = table.column(i);
        const Lanes& value = sums[i].own;
        const LaneVectors rise{gather(column, a) - value, gather(column, b) - value, gather(column, c) - value};
        add_moments(sums[i], quarter, rise);
        if (gradients) add_gradient(sums[i], quarter, rise);
      }
    }
    finish(space);
    for (LaneSums& of_attribute : sums) finish(of_attribute, space.mass);
    for (std::size_t l = 0; l < used; ++l) {
      for (std::size_t i = 0; i < sums.size(); ++i) values[i] = sums[i].value(l);
      visit(first + l, space.moments(l), values);
    }
  }
}

void find_shapes(std::span<const SpatialMoments* const> moments, std::array<SplatShape, shapes_at_once>& shapes) {
  bool all_along_axes = true;  // most shapes of scattered points
  for (std::size_t l = 0; l < moments.size(); ++l) {
    if (is_along_axes(*moments[l]))  // made in its memory, so that nothing is copied
      new (&shapes[l]) SplatShape(shape_along_axes(*moments[l]));
    else
      all_along_axes = false;
  }
  if (!all_along_axes) find_turned_shapes(moments, shapes);
}

SplatShape shape_of(const SpatialMoments& moments) {
  if (is_along_axes(moments)) return shape_along_axes(moments);
  std::array<SplatShape, shapes_at_once> shapes;
  find_turned_shapes(std::array{&moments}, shapes);
  return shapes[0];
}

}  // namespace splatvol
