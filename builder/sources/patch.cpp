#include "builder/sources/patch.h"

#include <algorithm>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <span>
#include <unordered_map>
#include <vector>

#include "builder/mesh/cell_kinds.h"
#include "builder/mesh/tetrahedra.h"
#include "builder/mesh/usable_numbers.h"
#include "builder/sources/reader_error.h"

namespace splatvol {
namespace {

using Face = std::vector<std::uint32_t>;

/// The parts of a cell, by its own points: the linear faces that a cell with this face is cut into.
std::vector<Face> parts_of(int type, const Face& points) {
  const std::size_t count = points.size();
  const auto pick = [&](std::initializer_list<std::size_t> numbers) {
    Face face;
    for (const std::size_t number : numbers) face.push_back(points[number]);
    return face;
  };
  if (type == vtk_cell::pixel && count == 4) return {pick({0, 1, 3, 2})};
  if (type == vtk_cell::biquadratic_quadrilateral && count == 9)
    return {pick({0, 4, 8, 7}), pick({4, 1, 5, 8}), pick({8, 5, 2, 6}), pick({7, 8, 6, 3})};
  if ((type == vtk_cell::quadratic_triangle && count == 6) ||
      (type == vtk_cell::quadratic_quadrilateral && count == 8)) {
    // A cap for each corner, and the face between the nodes in the middle of the edges.
    const std::size_t corners = count / 2;
    std::vector<Face> parts;
    Face inner;
    for (std::size_t k = 0; k < corners; ++k) {
      parts.push_back(pick({corners + (k + corners - 1) % corners, k, corners + k}));
      inner.push_back(points[corners + k]);
    }
    parts.push_back(inner);
    return parts;
  }
  if (type == vtk_cell::triangle_strip) {
    std::vector<Face> parts;
    for (std::size_t k = 0; k + 2 < count; ++k)
      parts.push_back(k % 2 == 0 ? pick({k, k + 1, k + 2}) : pick({k + 1, k, k + 2}));
    return parts;
  }
  if (type == vtk_cell::triangle || type == vtk_cell::quadrilateral || type == vtk_cell::polygon) return {points};
  // Of other cells only the corners, which come first.
  const bool has_3 = type == vtk_cell::lagrange_triangle || type == vtk_cell::biquadratic_triangle;
  const bool has_4 = type == vtk_cell::lagrange_quadrilateral || type == vtk_cell::quadratic_linear_quadrilateral;
  const std::size_t corners = has_3 ? 3 : has_4 ? 4 : 0;
  if (corners == 0 || corners > count) return {};
  return {Face(points.begin(), points.begin() + static_cast<std::ptrdiff_t>(corners))};
}

}  // namespace

void append_cells(std::span<const SurfaceCell> cells, TriangleMesh& mesh) {
  std::vector<TetrahedronSplitter::Tetrahedron> no_tetrahedra;
  CellCensus census;
  TetrahedronSplitter splitter(mesh.points, no_tetrahedra, census);
  for (const auto& [type, points] : cells) {
    if (!std::ranges::all_of(points, [&](std::uint32_t p) { return is_usable_position(mesh.points[p]); })) continue;
    for (const Face& part : parts_of(type, points))
      for (const TetrahedronSplitter::Triangle& triangle : splitter.split_face(part))
        mesh.triangles.push_back(triangle);
  }
  for (dvec3& point : mesh.points)
    if (!is_usable_position(point)) point = dvec3(0);
}

void append_cells_of(std::span<const dvec3> points, std::vector<SurfaceCell> cells, TriangleMesh& mesh) {
  std::erase_if(cells, [&](const SurfaceCell& cell) {
    return std::ranges::any_of(cell.points, [&](std::uint32_t point) { return point >= points.size(); });
  });
  std::unordered_map<std::uint32_t, std::uint32_t> numbers;
  for (SurfaceCell& cell : cells)
    for (std::uint32_t& point : cell.points) {
      const auto [number, is_new] = numbers.try_emplace(point, static_cast<std::uint32_t>(mesh.points.size()));
      if (is_new) mesh.points.push_back(points[point]);
      point = number->second;
    }
  append_cells(cells, mesh);
}

void append_surface_cells(const DataSet& data, TriangleMesh& mesh) {
  if (data.point_count() > std::numeric_limits<std::uint32_t>::max())
    throw ReaderError("a patch has more than 2^32 - 1 points");
  std::vector<dvec3> positions(data.point_count());
  data.read_points(positions);
  std::vector<std::int64_t> ids;
  std::vector<SurfaceCell> cells;
  for (std::uint64_t cell = 0; cell < data.cell_count(); ++cell) {
    ids.clear();
    data.append_points(cell, ids);
    const auto is_there = [&](std::int64_t id) { return id >= 0 && static_cast<std::uint64_t>(id) < positions.size(); };
    if (std::ranges::all_of(ids, is_there)) cells.push_back({data.cell_type(cell), Face(ids.begin(), ids.end())});
  }
  append_cells_of(positions, std::move(cells), mesh);
}

}  // namespace splatvol
