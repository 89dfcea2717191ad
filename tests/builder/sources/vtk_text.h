// Files of VTK as text, written without VTK.
#pragma once

#include <fmt/format.h>

#include <string>
#include <utility>
#include <vector>

#include "base/math.h"

namespace splatvol::test {

/// An XML file of one data set. `attributes`: of the data set's tag.
inline std::string vtk_file(const std::string& type, const std::string& content, const std::string& attributes = "",
                            const std::string& version = "1.0") {
  return fmt::format(
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"{0}\" version=\"{1}\" byte_order=\"LittleEndian\">\n<{0} {2}>\n{3}"
      "</{0}>\n</VTKFile>\n",
      type, version, attributes, content);
}

/// A .vtm with these files as blocks.
inline std::string vtm_file(const std::vector<std::string>& files) {
  std::string blocks;
  for (const std::string& file : files) blocks += "<DataSet file=\"" + file + "\"/>";
  return vtk_file("vtkMultiBlockDataSet", blocks);
}

struct VtkArray {
  std::string name;
  std::vector<double> values;
  int components = 1;
  std::string type = "Float64";
};

inline std::string data_arrays(const std::vector<VtkArray>& arrays) {
  std::string text;
  for (const VtkArray& array : arrays)
    text += fmt::format(
        "<DataArray type=\"{}\" Name=\"{}\" NumberOfComponents=\"{}\" format=\"ascii\">{}{}</DataArray>\n", array.type,
        array.name, array.components, fmt::join(array.values, " "), array.values.empty() ? "" : " ");
  return text;
}

struct VtkCell {
  int type;
  std::vector<int> points;
};

/// A .vtu.
struct VtuMesh {
  std::string version = "0.1";
  std::vector<dvec3> points = {};
  std::vector<VtkCell> cells = {};
  std::vector<VtkArray> point_data = {}, cell_data = {};
  std::string extra_cell_arrays = {};
  std::string coordinate_type = "Float64";

  [[nodiscard]] std::string piece() const {
    VtkArray coordinates{"Points", {}, 3, coordinate_type}, connectivity{"connectivity", {}, 1, "Int64"},
        offsets{"offsets", {}, 1, "Int64"}, types{"types", {}, 1, "UInt8"};
    for (const dvec3& p : points) coordinates.values.insert(coordinates.values.end(), {p.x, p.y, p.z});
    for (const VtkCell& cell : cells) {
      connectivity.values.insert(connectivity.values.end(), cell.points.begin(), cell.points.end());
      offsets.values.push_back(static_cast<double>(connectivity.values.size()));
      types.values.push_back(cell.type);
    }
    return fmt::format(
        "<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">\n<PointData>\n{}</PointData>\n<CellData>\n{}</CellData>\n"
        "<Points>\n{}</Points>\n<Cells>\n{}{}</Cells>\n</Piece>\n",
        points.size(), cells.size(), data_arrays(point_data), data_arrays(cell_data), data_arrays({coordinates}),
        data_arrays({connectivity, offsets, types}), extra_cell_arrays);
  }

  [[nodiscard]] std::string file() const { return file_of(piece()); }
  [[nodiscard]] std::string file_of(const std::string& pieces) const {
    return vtk_file("UnstructuredGrid", pieces, "", version);
  }
};

/// A tetrahedron that begins at x.
inline VtuMesh tetrahedron_at(double x, std::vector<VtkArray> point_data = {{"s", {1, 2, 3, 4}}},
                              std::vector<VtkArray> cell_data = {}) {
  return {.points = {{x, 0, 0}, {x + 1, 0, 0}, {x, 1, 0}, {x, 0, 1}},
          .cells = {{10, {0, 1, 2, 3}}},
          .point_data = std::move(point_data),
          .cell_data = std::move(cell_data)};
}

/// A legacy file in text.
inline std::string legacy_file(const std::string& data_set, const std::string& version = "3.0") {
  return "# vtk DataFile Version " + version + "\nt\nASCII\nDATASET " + data_set;
}

}  // namespace splatvol::test
