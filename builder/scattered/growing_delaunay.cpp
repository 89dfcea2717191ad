#include "builder/scattered/growing_delaunay.h"

#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_cell_base_with_info_3.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>

#include <array>
#include <limits>
#include <utility>

#include "builder/scattered/insert_in_rounds.h"
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
using CellBase =
    CGAL::Triangulation_cell_base_with_info_3<CellInfo, Kernel, CGAL::Delaunay_triangulation_cell_base_3<Kernel>>;
using Structure = CGAL::Triangulation_data_structure_3<VertexBase, CellBase>;
using Triangulation = CGAL::Delaunay_triangulation_3<Kernel, Structure>;

double circumradius(const Triangulation::Cell& cell) {
  std::array<dvec3, 4> positions;
  for (int k = 0; k < 4; ++k) {
    const auto& p = cell.vertex(k)->point();
    positions[static_cast<std::size_t>(k)] = {p.x(), p.y(), p.z()};
  }
  return splatvol::circumradius(positions, {0, 1, 2, 3});
}

}  // namespace

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
