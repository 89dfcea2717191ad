#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <limits>
#include <new>

#include "base/memory_limit.h"
#include "builder/scattered/insert_in_rounds.h"
#include "builder/scattered/scattered.h"
#include "builder/scattered/trimming.h"

namespace splatvol {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using VertexBase = CGAL::Triangulation_vertex_base_with_info_3<std::uint32_t, Kernel>;
using CellBase = CGAL::Delaunay_triangulation_cell_base_3<Kernel>;
using Structure = CGAL::Triangulation_data_structure_3<VertexBase, CellBase, CGAL::Parallel_tag>;
using Triangulation = CGAL::Delaunay_triangulation_3<Kernel, Structure>;

// The most memory that a point of a triangulation takes.
constexpr std::uint64_t point_bytes = 1200;

// CGAL decides between cospherical points by a symbolic perturbation, so there is only one triangulation: the order in
// which the threads insert does not matter.
Result<std::vector<Tetrahedron>> triangulate(std::span<const dvec3> positions,
                                             const std::function<void(double)>& progress) {
  std::vector<std::pair<Kernel::Point_3, std::uint32_t>> points;
  CGAL::Bbox_3 box;
  for (const std::uint32_t i : distinct_points(positions)) {
    points.emplace_back(Kernel::Point_3(positions[i].x, positions[i].y, positions[i].z), i);
    box += points.back().first.bbox();
  }
  // If memory ends in one of CGAL's threads, that thread keeps its locks, and the others wait for ever. So only one
  // thread works where memory may end.
  const std::uint64_t needed = points.size() * point_bytes;
  if (!is_addressable(needed)) throw std::bad_alloc();
  const bool is_scarce = free_address_space() / 4 < needed;
  constexpr int locks_per_axis = 50;
  Triangulation::Lock_data_structure locks(box, locks_per_axis);
  Triangulation triangulation(Kernel(), is_scarce ? nullptr : &locks);
  SPLATVOL_TRY(insert_in_rounds(std::move(points), triangulation, progress));
  std::vector<Tetrahedron> tetrahedra;
  if (triangulation.dimension() < 3) return tetrahedra;
  tetrahedra.reserve(triangulation.number_of_finite_cells());
  for (const auto cell : triangulation.finite_cell_handles()) {
    Tetrahedron& corners = tetrahedra.emplace_back();
    for (int k = 0; k < 4; ++k) corners[static_cast<std::size_t>(k)] = cell->vertex(k)->info();
    std::ranges::sort(corners);
  }
  SPLATVOL_TRY(check_interruption());
  tbb::parallel_sort(tetrahedra.begin(), tetrahedra.end());
  return tetrahedra;
}

void trim(std::span<const dvec3> positions, std::vector<Tetrahedron>& tetrahedra) {
  const auto radii = circumradii(positions, tetrahedra);
  const auto usual = usual_radii(positions.size(), tetrahedra, radii);
  std::size_t kept = 0;
  for (std::size_t t = 0; t < tetrahedra.size(); ++t) {
    const Tetrahedron corners = tetrahedra[t];
    if (radii[t] <= largest_kept(usual, corners)) tetrahedra[kept++] = corners;
  }
  tetrahedra.resize(kept);
}

}  // namespace

Result<std::vector<Tetrahedron>> delaunay_tetrahedra(std::span<const dvec3> positions,
                                                     const std::function<void(double)>& progress) {
  // There are about seven times as many tetrahedra, and their numbers must fit too.
  if (positions.size() > std::numeric_limits<std::uint32_t>::max() / 8)
    return fail(ErrorCode::unsupported, "{} points are too many for a Delaunay triangulation", positions.size());
  SPLATVOL_TRY_ASSIGN(tetrahedra, triangulate(positions, progress));
  SPLATVOL_TRY(check_interruption());
  trim(positions, tetrahedra);
  if (is_flat(positions, tetrahedra)) tetrahedra.clear();
  return tetrahedra;
}

}  // namespace splatvol
