#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "builder/scattered.h"

namespace splatvol {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using VertexBase = CGAL::Triangulation_vertex_base_with_info_3<std::uint32_t, Kernel>;
using CellBase = CGAL::Delaunay_triangulation_cell_base_3<Kernel>;
using Structure = CGAL::Triangulation_data_structure_3<VertexBase, CellBase, CGAL::Parallel_tag>;
using Triangulation = CGAL::Delaunay_triangulation_3<Kernel, Structure>;

// A tetrahedron is kept while its circumradius is at most this many times the usual one at a corner: over 2, thin
// bodies fill up; under it, points at random lose tetrahedra inside.
constexpr double max_radius_ratio = 2;

// CGAL settles cospherical points by a symbolic perturbation, so there is one triangulation whatever the order in which
// the threads insert.
std::vector<Tetrahedron> triangulate(std::span<const dvec3> positions) {
  std::vector<std::pair<Kernel::Point_3, std::uint32_t>> points;
  CGAL::Bbox_3 box;
  for (const std::uint32_t i : distinct_points(positions)) {
    points.emplace_back(Kernel::Point_3(positions[i].x, positions[i].y, positions[i].z), i);
    box += points.back().first.bbox();
  }
  constexpr int locks_per_axis = 50;
  Triangulation::Lock_data_structure locks(box, locks_per_axis);
  const Triangulation triangulation(points.begin(), points.end(), &locks);
  std::vector<Tetrahedron> tetrahedra;
  if (triangulation.dimension() < 3) return tetrahedra;
  tetrahedra.reserve(triangulation.number_of_finite_cells());
  for (const auto cell : triangulation.finite_cell_handles()) {
    Tetrahedron& corners = tetrahedra.emplace_back();
    for (int k = 0; k < 4; ++k) corners[static_cast<std::size_t>(k)] = cell->vertex(k)->info();
    std::ranges::sort(corners);
  }
  tbb::parallel_sort(tetrahedra.begin(), tetrahedra.end());
  return tetrahedra;
}

// Infinite where the corners lie on a plane as far as rounding can tell.
double circumradius(std::span<const dvec3> positions, const Tetrahedron& corners) {
  const dvec3 &p = positions[corners[0]], a = positions[corners[1]] - p, b = positions[corners[2]] - p,
              c = positions[corners[3]] - p;
  const dvec3 bc = glm::cross(b, c);
  const double radius =
      glm::length(glm::dot(a, a) * bc + glm::dot(b, b) * glm::cross(c, a) + glm::dot(c, c) * glm::cross(a, b)) /
      (2 * std::abs(glm::dot(a, bc)));
  return std::isnan(radius) ? std::numeric_limits<double>::infinity() : radius;
}

// The tetrahedra at each point: those of point i from begins[i] to begins[i + 1].
struct Stars {
  std::vector<std::size_t> begins;
  std::vector<std::uint32_t> tetrahedra;

  Stars(std::size_t points, std::span<const Tetrahedron> all) : begins(points + 1), tetrahedra(4 * all.size()) {
    for (const Tetrahedron& corners : all)
      for (const std::uint32_t corner : corners) ++begins[corner];
    std::inclusive_scan(begins.begin(), begins.end(), begins.begin());
    for (std::size_t t = all.size(); t-- > 0;)
      for (const std::uint32_t corner : all[t]) tetrahedra[--begins[corner]] = static_cast<std::uint32_t>(t);
  }
  [[nodiscard]] std::span<const std::uint32_t> of(std::size_t point) const {
    return std::span(tetrahedra).subspan(begins[point], begins[point + 1] - begins[point]);
  }
};

// The lower quartile of what `append` puts together for each point; 0 where that is nothing.
template <class Append>
std::vector<double> lower_quartiles(std::size_t points, const Append& append) {
  std::vector<double> result(points, 0.0);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, points, 1024), [&](const auto& range) {
    std::vector<double> items;
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      items.clear();
      append(i, items);
      if (items.empty()) continue;
      const auto middle = items.begin() + static_cast<std::ptrdiff_t>((items.size() - 1) / 4);
      std::ranges::nth_element(items, middle);
      result[i] = *middle;
    }
  });
  return result;
}

// As an alpha shape whose alpha follows the points. In a boundary layer every circumradius is about the larger spacing,
// in a hole it is that of the hole. Half of the tetrahedra at a point of the boundary may lie outside, so the usual
// circumradius at a point is the lower quartile; and where nearly all do, at edges, its neighbours know better.
void trim(std::span<const dvec3> positions, std::vector<Tetrahedron>& tetrahedra) {
  std::vector<double> radii(tetrahedra.size());
  tbb::parallel_for(std::size_t{0}, tetrahedra.size(),
                    [&](std::size_t t) { radii[t] = circumradius(positions, tetrahedra[t]); });
  const Stars stars(positions.size(), tetrahedra);
  const auto own = lower_quartiles(positions.size(), [&](std::size_t i, std::vector<double>& items) {
    for (const std::uint32_t t : stars.of(i)) items.push_back(radii[t]);
  });
  const auto usual = lower_quartiles(positions.size(), [&](std::size_t i, std::vector<double>& items) {
    for (const std::uint32_t t : stars.of(i))
      for (const std::uint32_t corner : tetrahedra[t]) items.push_back(own[corner]);
  });
  std::size_t kept = 0;
  for (std::size_t t = 0; t < tetrahedra.size(); ++t) {
    const Tetrahedron corners = tetrahedra[t];
    const double largest = std::max({usual[corners[0]], usual[corners[1]], usual[corners[2]], usual[corners[3]]});
    if (radii[t] <= max_radius_ratio * largest) tetrahedra[kept++] = corners;
  }
  tetrahedra.resize(kept);
}

// Whether rounding alone keeps the points apart from a plane. Layers of cells, however thin, hold far more.
bool is_flat(std::span<const dvec3> positions, std::span<const Tetrahedron> tetrahedra) {
  double volumes = 0, cubes = 0;
  for (const Tetrahedron& corners : tetrahedra) {
    const dvec3 &p = positions[corners[0]], a = positions[corners[1]] - p, b = positions[corners[2]] - p,
                c = positions[corners[3]] - p;
    volumes += std::abs(glm::dot(a, glm::cross(b, c)));
    const double longest = std::sqrt(std::max({glm::dot(a, a), glm::dot(b, b), glm::dot(c, c)}));
    cubes += longest * longest * longest;
  }
  return volumes <= 1e-10 * cubes;
}

}  // namespace

Result<std::vector<Tetrahedron>> delaunay_tetrahedra(std::span<const dvec3> positions) {
  // There are about seven times as many tetrahedra, whose numbers have to fit too.
  if (positions.size() > std::numeric_limits<std::uint32_t>::max() / 8)
    return fail(ErrorCode::unsupported, "{} points are too many for a Delaunay triangulation", positions.size());
  std::vector<Tetrahedron> tetrahedra = triangulate(positions);
  trim(positions, tetrahedra);
  if (is_flat(positions, tetrahedra)) tetrahedra.clear();
  return tetrahedra;
}

}  // namespace splatvol
