#include "builder/sources/surfaces/surface_file.h"

#include <vtkCellArray.h>
#include <vtkCellArrayIterator.h>
#include <vtkCompositeDataIterator.h>
#include <vtkCompositeDataSet.h>
#include <vtkGLTFReader.h>
#include <vtkNew.h>
#include <vtkOBJReader.h>
#include <vtkPLYReader.h>
#include <vtkPolyData.h>
#include <vtkPolyDataReader.h>
#include <vtkSTLReader.h>
#include <vtkSmartPointer.h>
#include <vtkTriangleFilter.h>
#include <vtkXMLPolyDataReader.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <span>

#include "base/replaceable.h"
#include "builder/mesh/usable_numbers.h"
#include "builder/sources/read_text.h"
#include "builder/sources/surfaces/gltf_checks.h"
#include "builder/sources/surfaces/surface_checks.h"
#include "builder/sources/vtk/legacy_checks.h"
#include "builder/sources/vtk/messages.h"
#include "builder/sources/vtk/xml_checks.h"

namespace splatvol {
namespace {

template <class Reader>
vtkSmartPointer<vtkAlgorithm> make_reader(const std::string& path) {
  const vtkNew<Reader> reader;
  reader->SetFileName(path.c_str());
  return reader.GetPointer();
}

bool is_gltf(const std::string& path) { return has_extension(path, ".gltf") || has_extension(path, ".glb"); }

/// Null: a file of another kind.
vtkSmartPointer<vtkAlgorithm> reader_of(const std::string& path) {
  if (has_extension(path, ".stl")) {
    auto reader = make_reader<vtkSTLReader>(path);
    // Triangles are drawn one by one, so it does not matter that each has points of its own.
    vtkSTLReader::SafeDownCast(reader)->MergingOff();
    return reader;
  }
  if (has_extension(path, ".obj")) return make_reader<vtkOBJReader>(path);
  if (has_extension(path, ".ply")) return make_reader<vtkPLYReader>(path);
  if (is_gltf(path)) return make_reader<vtkGLTFReader>(path);
  if (has_extension(path, ".vtp")) return make_reader<vtkXMLPolyDataReader>(path);
  if (has_extension(path, ".vtk")) return make_reader<vtkPolyDataReader>(path);
  return nullptr;
}

Result<LastLine> check_file(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(start, read_text(path, byte_order_mark.size()));  // whose errors name the reason
  if (start == byte_order_mark && !has_extension(path, ".vtp")) return fail_byte_order_mark(path);
  if (has_extension(path, ".obj")) return check_obj(path);
  if (has_extension(path, ".ply")) return check_ply(path);
  if (has_extension(path, ".stl")) SPLATVOL_TRY(check_stl(path));
  if (has_extension(path, ".vtp")) SPLATVOL_TRY(check_xml(path));
  if (has_extension(path, ".vtk")) SPLATVOL_TRY(legacy_arrays(path));
  if (is_gltf(path)) SPLATVOL_TRY(check_gltf(path));
  return LastLine::ended;
}

/// Gives the reader of a .ply file the file's text with the end of a line, which the file lacks.
Status end_last_line(const std::string& path, vtkAlgorithm& reader) {
  SPLATVOL_TRY_ASSIGN(text, read_text(path));
  auto& ply = *vtkPLYReader::SafeDownCast(&reader);
  ply.ReadFromInputStringOn();
  ply.SetInputString(text + '\n');
  return {};
}

Status append(vtkPolyData& data, TriangleMesh& mesh) {
  const vtkNew<vtkTriangleFilter> filter;
  filter->SetInputData(&data);
  filter->PassVertsOff();
  filter->PassLinesOff();
  filter->Update();
  vtkPolyData& triangles = *filter->GetOutput();
  if (!triangles.GetPoints() || !triangles.GetPolys()) return {};
  const auto first = mesh.points.size();
  const auto count = static_cast<std::size_t>(triangles.GetNumberOfPoints());
  if (count > std::numeric_limits<std::uint32_t>::max() - first)
    return fail(ErrorCode::unsupported, "more than 4294967295 points");
  mesh.points.resize(first + count);
  for (std::size_t i = 0; i < count; ++i) triangles.GetPoint(static_cast<vtkIdType>(i), &mesh.points[first + i].x);
  const auto cells = vtk::TakeSmartPointer(triangles.GetPolys()->NewIterator());
  for (cells->GoToFirstCell(); !cells->IsDoneWithTraversal(); cells->GoToNextCell()) {
    vtkIdType corners = 0;
    const vtkIdType* points = nullptr;
    cells->GetCurrentCell(corners, points);
    if (corners != 3) continue;
    std::array<std::uint32_t, 3> triangle{};
    for (std::size_t k = 0; k < 3; ++k) {
      if (points[k] < 0 || static_cast<std::size_t>(points[k]) >= count)
        return fail(ErrorCode::invalid_data, "a triangle names point {} of {}", points[k], count);
      triangle[k] = static_cast<std::uint32_t>(first + static_cast<std::size_t>(points[k]));
    }
    if (std::ranges::all_of(triangle, [&](std::uint32_t point) { return is_usable_position(mesh.points[point]); }))
      mesh.triangles.push_back(triangle);
  }
  // No triangle has the others.
  for (dvec3& point : std::span(mesh.points).subspan(first))
    if (!is_usable_position(point)) point = dvec3(0);
  return {};
}

/// The parts of a glTF scene stand where its nodes put them.
Status append_all(vtkDataObject* data, TriangleMesh& mesh) {
  if (auto* poly = vtkPolyData::SafeDownCast(data)) return append(*poly, mesh);
  auto* composite = vtkCompositeDataSet::SafeDownCast(data);
  if (!composite) return {};
  const auto parts = vtk::TakeSmartPointer(composite->NewIterator());
  for (parts->InitTraversal(); !parts->IsDoneWithTraversal(); parts->GoToNextItem())
    if (auto* poly = vtkPolyData::SafeDownCast(parts->GetCurrentDataObject())) SPLATVOL_TRY(append(*poly, mesh));
  return {};
}

}  // namespace

Result<TriangleMesh> read_surface_file(const std::string& path) {
  const auto reader = reader_of(path);
  if (!reader)
    return fail(ErrorCode::unsupported, "{}: no surface: take a .stl, .obj, .ply, .gltf, .glb, .vtp or .vtk file",
                path);
  SPLATVOL_TRY_ASSIGN(last_line, check_file(path));
  if (last_line != LastLine::ended && has_extension(path, ".ply")) SPLATVOL_TRY(end_last_line(path, *reader));
  TriangleMesh mesh;
  mesh.open_end = last_line == LastLine::open_number;
  Status appended;
  SPLATVOL_TRY(run_vtk(path, [&] {
    reader->Update();
    appended = append_all(reader->GetOutputDataObject(0), mesh);
  }));
  if (!appended) return fail_in(path, appended.error());
  if (mesh.triangles.empty()) return fail(ErrorCode::invalid_data, "{}: holds no triangles", path);
  return mesh;
}

}  // namespace splatvol
