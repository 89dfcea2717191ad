// All that needs CGAL, whose headers take long to compile.
#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Spatial_sort_traits_adapter_3.h>
#include <CGAL/Triangulation_cell_base_with_info_3.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>
#include <CGAL/property_map.h>
#include <CGAL/spatial_sort.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <array>
#include <limits>
#include <new>
#include <utility>

#include "base/interruption.h"
#include "base/memory_limit.h"
#include "builder/scattered/delaunay_edges.h"
#include "builder/scattered/growing_delaunay.h"
#include "builder/scattered/scattered.h"
#include "builder/scattered/trimming.h"

namespace splatvol {
namespace {

struct CellInfo {
  double radius = -1;  // not known yet
  double mark = 0;
};

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using VertexBase = CGAL::Triangulation_vertex_base_with_info_3<std::uint32_t, Kernel>;
using CellBase = CGAL::Delaunay_triangulation_cell_base_3<Kernel>;
using MarkedCellBase = CGAL::Triangulation_cell_base_with_info_3<CellInfo, Kernel, CellBase>;

// For one thread, and for all of TBB's.
using Triangulation =
    CGAL::Delaunay_triangulation_3<Kernel, CGAL::Triangulation_data_structure_3<VertexBase, MarkedCellBase>>;
using ParallelTriangulation =
    CGAL::Delaunay_triangulation_3<Kernel,
                                   CGAL::Triangulation_data_structure_3<VertexBase, CellBase, CGAL::Parallel_tag>>;

// Inserts points with their numbers. Fails with ErrorCode::cancelled if this thread's stop is requested: looks for one
// before each round of 2^17 points, and tells `progress` the share that is inserted then; it may be empty. The points
// of a round lie near each other, as in one insertion of all points.
template <class AnyTriangulation>
Status insert_in_rounds(std::vector<std::pair<typename AnyTriangulation::Point, std::uint32_t>> points,
                        AnyTriangulation& triangulation, const std::function<void(double)>& progress = {}) {
  constexpr std::size_t round_points = std::size_t{1} << 17;
  using Position = CGAL::First_of_pair_property_map<std::pair<typename AnyTriangulation::Point, std::uint32_t>>;
  using Traits = CGAL::Spatial_sort_traits_adapter_3<typename AnyTriangulation::Geom_traits, Position>;
  if (points.size() > round_points)
    CGAL::spatial_sort<typename AnyTriangulation::Concurrency_tag>(points.begin(), points.end(), Traits());
  for (std::size_t begin = 0; begin < points.size(); begin += round_points) {
    SPLATVOL_TRY(check_interruption());
    if (progress) progress(static_cast<double>(begin) / static_cast<double>(points.size()));
    const auto at = [&](std::size_t i) { return points.begin() + static_cast<std::ptrdiff_t>(i); };
    triangulation.insert(at(begin), at(std::min(points.size(), begin + round_points)));
  }
  return {};
}

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
  // If memory ends in one of CGAL's threads, that thread keeps its locks, and the others wait for ever. Where memory
  // may end, one thread works alone.
  const std::uint64_t needed = points.size() * point_bytes;
  if (!is_addressable(needed)) throw std::bad_alloc();
  const bool is_scarce = free_address_space() / 4 < needed;
  constexpr int locks_per_axis = 50;
  ParallelTriangulation::Lock_data_structure locks(box, locks_per_axis);
  ParallelTriangulation triangulation(Kernel(), is_scarce ? nullptr : &locks);
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

double circumradius(const Triangulation::Cell& cell) {
  std::array<dvec3, 4> positions;
  for (int k = 0; k < 4; ++k) {
    const auto& p = cell.vertex(k)->point();
    positions[static_cast<std::size_t>(k)] = {p.x(), p.y(), p.z()};
  }
  return splatvol::circumradius(positions, {0, 1, 2, 3});
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

std::vector<Edge> delaunay_edges(std::span<const dvec3> positions) {
  Triangulation triangulation;
  Triangulation::Vertex_handle last;
  for (std::uint32_t i = 0; i < positions.size(); ++i) {
    const dvec3& p = positions[i];
    last = triangulation.insert(Kernel::Point_3(p.x, p.y, p.z), last);
    last->info() = i;
  }
  std::vector<Edge> edges;
  if (triangulation.dimension() < 1) return edges;
  for (const auto& [cell, a, b] : triangulation.finite_edges())
    edges.push_back({cell->vertex(a)->info(), cell->vertex(b)->info()});
  return edges;
}

class GrowingDelaunay::Impl {
 public:
  Triangulation triangulation;
  std::uint32_t points = 0;
  std::vector<Triangulation::Cell_handle> handles;
};

GrowingDelaunay::GrowingDelaunay() : impl_(std::make_unique<Impl>()) {}
GrowingDelaunay::~GrowingDelaunay() = default;

Status GrowingDelaunay::insert(std::span<const dvec3> positions) {
  std::vector<std::pair<Kernel::Point_3, std::uint32_t>> points;
  points.reserve(positions.size());
  for (const std::uint32_t i : distinct_points(positions))
    points.emplace_back(Kernel::Point_3(positions[i].x, positions[i].y, positions[i].z), impl_->points + i);
  impl_->points += static_cast<std::uint32_t>(positions.size());
  return insert_in_rounds(std::move(points), impl_->triangulation);
}

std::vector<GrowingDelaunay::Cell> GrowingDelaunay::cells() {
  const Triangulation& triangulation = impl_->triangulation;
  impl_->handles.clear();
  std::vector<Cell> cells;
  if (triangulation.dimension() < 3) return cells;
  cells.reserve(triangulation.number_of_cells());
  impl_->handles.reserve(triangulation.number_of_cells());
  std::vector<Triangulation::Cell_handle> outer;
  for (const auto cell : triangulation.all_cell_handles()) {
    if (triangulation.is_infinite(cell)) {
      outer.push_back(cell);
      continue;
    }
    CellInfo& info = cell->info();
    if (info.radius < 0) info.radius = circumradius(*cell);
    Cell& copy = cells.emplace_back(Cell{{}, info.radius, info.mark});
    for (int k = 0; k < 4; ++k) copy.corners[static_cast<std::size_t>(k)] = cell->vertex(k)->info();
    impl_->handles.push_back(cell);
  }
  for (const auto cell : outer) {
    Cell& copy =
        cells.emplace_back(Cell{{0, 0, 0, Cell::none}, std::numeric_limits<double>::infinity(), cell->info().mark});
    const int infinite = cell->index(triangulation.infinite_vertex());
    for (int k = 0; k < 3; ++k)
      copy.corners[static_cast<std::size_t>(k)] = cell->vertex(Triangulation::vertex_triple_index(infinite, k))->info();
    impl_->handles.push_back(cell);
  }
  return cells;
}

void GrowingDelaunay::set_mark(std::size_t cell, double mark) { impl_->handles[cell]->info().mark = mark; }

}  // namespace splatvol
