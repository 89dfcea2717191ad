#include "builder/sources/vtk/patch.h"

#include <vtkCellType.h>
#include <vtkDataSet.h>
#include <vtkIdList.h>
#include <vtkNew.h>

#include <algorithm>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <span>
#include <unordered_map>
#include <vector>

#include "builder/mesh/tetrahedra.h"
#include "builder/mesh/usable_numbers.h"
#include "builder/sources/vtk/messages.h"

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
  if (type == VTK_PIXEL && count == 4) return {pick({0, 1, 3, 2})};
  if (type == VTK_BIQUADRATIC_QUAD && count == 9)
    return {pick({0, 4, 8, 7}), pick({4, 1, 5, 8}), pick({8, 5, 2, 6}), pick({7, 8, 6, 3})};
  if ((type == VTK_QUADRATIC_TRIANGLE && count == 6) || (type == VTK_QUADRATIC_QUAD && count == 8)) {
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
  if (type == VTK_TRIANGLE_STRIP) {
    std::vector<Face> parts;
    for (std::size_t k = 0; k + 2 < count; ++k)
      parts.push_back(k % 2 == 0 ? pick({k, k + 1, k + 2}) : pick({k + 1, k, k + 2}));
    return parts;
  }
  if (type == VTK_TRIANGLE || type == VTK_QUAD || type == VTK_POLYGON) return {points};
  // Of other cells only the corners, which come first.
  const bool triangle = type == VTK_LAGRANGE_TRIANGLE || type == VTK_BIQUADRATIC_TRIANGLE;
  const bool quadrilateral = type == VTK_LAGRANGE_QUADRILATERAL || type == VTK_QUADRATIC_LINEAR_QUAD;
  const std::size_t corners = triangle ? 3 : quadrilateral ? 4 : 0;
  if (corners == 0 || corners > count) return {};
  return {Face(points.begin(), points.begin() + static_cast<std::ptrdiff_t>(corners))};
}

/// Copies the points that the cells of a data set name, each once.
class NamedPoints {
 public:
  NamedPoints(vtkDataSet& data, TriangleMesh& mesh) : data_(data), mesh_(mesh) {}

  /// Returns the number of a point in the mesh.
  std::uint32_t number_of(vtkIdType id) {
    const auto number = static_cast<std::uint32_t>(mesh_.points.size());
    const auto [found, is_new] = numbers_.try_emplace(id, number);
    if (!is_new) return found->second;
    if (mesh_.points.size() >= std::numeric_limits<std::uint32_t>::max())
      throw ReaderError("a patch has more than 2^32 - 1 points");
    data_.GetPoint(id, &mesh_.points.emplace_back().x);
    return number;
  }

 private:
  vtkDataSet& data_;
  TriangleMesh& mesh_;
  std::unordered_map<vtkIdType, std::uint32_t> numbers_;
};

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

void append_surface_cells(vtkDataSet& data, TriangleMesh& mesh) {
  NamedPoints named(data, mesh);
  const vtkNew<vtkIdList> ids;
  std::vector<SurfaceCell> cells;
  for (vtkIdType cell = 0; cell < data.GetNumberOfCells(); ++cell) {
    data.GetCellPoints(cell, ids);
    const std::span<const vtkIdType> points(ids->GetPointer(0), static_cast<std::size_t>(ids->GetNumberOfIds()));
    if (std::ranges::any_of(points, [&](vtkIdType id) { return id < 0 || id >= data.GetNumberOfPoints(); })) continue;
    Face face;
    for (const vtkIdType id : points) face.push_back(named.number_of(id));
    cells.push_back({data.GetCellType(cell), std::move(face)});
  }
  append_cells(cells, mesh);
}

}  // namespace splatvol
