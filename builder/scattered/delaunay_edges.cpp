#include "builder/scattered/delaunay_edges.h"

#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>

namespace splatvol {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using VertexBase = CGAL::Triangulation_vertex_base_with_info_3<std::uint32_t, Kernel>;
using CellBase = CGAL::Delaunay_triangulation_cell_base_3<Kernel>;
using Triangulation =
    CGAL::Delaunay_triangulation_3<Kernel, CGAL::Triangulation_data_structure_3<VertexBase, CellBase>>;

}  // namespace

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

}  // namespace splatvol
