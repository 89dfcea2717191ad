#include "builder/sources/vtk/xml_arrays.h"

#include <algorithm>
#include <string_view>

#include "builder/sources/vtk/attributes.h"
#include "builder/sources/vtk/xml_file.h"

namespace splatvol {
namespace {

std::string_view text_of(vtkXMLDataElement& element, const char* attribute) {
  const char* text = element.GetAttribute(attribute);
  return text ? text : "";
}

/// Whether an array is one of ids: PointData and CellData name these.
bool is_of_ids(vtkXMLDataElement& data, std::string_view array) {
  return text_of(data, "GlobalIds") == array || text_of(data, "PedigreeIds") == array;
}

/// The unit as VTK writes it (the key UNITS_LABEL).
std::string unit_of(vtkXMLDataElement& array) {
  for (int i = 0; i < array.GetNumberOfNestedElements(); ++i) {
    vtkXMLDataElement& key = *array.GetNestedElement(i);
    if (text_of(key, "name") == "UNITS_LABEL" && key.GetCharacterData()) return key.GetCharacterData();
  }
  return {};
}

/// Adds the arrays of PointData or CellData.
void add_arrays(vtkXMLDataElement& data, bool of_cells, std::vector<ArrayShape>& arrays) {
  for (int i = 0; i < data.GetNumberOfNestedElements(); ++i) {
    vtkXMLDataElement& array = *data.GetNestedElement(i);
    const std::string_view name = text_of(array, "Name");
    if (name.empty() || text_of(array, "type") == "String" || is_bookkeeping(name) || is_of_ids(data, name)) continue;
    int components = 1;
    array.GetScalarAttribute("NumberOfComponents", components);
    arrays.push_back({std::string(name), std::max(components, 1), of_cells, unit_of(array)});
  }
}

bool has_any(vtkXMLDataElement& piece, const char* count) {
  double number = 0;
  return piece.GetScalarAttribute(count, number) != 0 && number > 0;
}

/// Whether a piece counts: pieces of structured grids state no number of points.
bool is_used(vtkXMLDataElement& piece, bool but_surfaces) {
  if (but_surfaces && (has_any(piece, "NumberOfPolys") || has_any(piece, "NumberOfStrips"))) return false;
  return text_of(piece, "NumberOfPoints").empty() || has_any(piece, "NumberOfPoints");
}

}  // namespace

Result<std::vector<std::vector<ArrayShape>>> xml_arrays(const std::string& path, bool but_surfaces) {
  SPLATVOL_TRY_ASSIGN(parser, parse_xml(path));
  std::vector<std::vector<ArrayShape>> pieces;
  vtkXMLDataElement& root = *parser->GetRootElement();
  for (int g = 0; g < root.GetNumberOfNestedElements(); ++g) {
    vtkXMLDataElement& grid = *root.GetNestedElement(g);
    for (int p = 0; p < grid.GetNumberOfNestedElements(); ++p) {
      vtkXMLDataElement& piece = *grid.GetNestedElement(p);
      if (piece.GetName() != std::string_view("Piece") || !is_used(piece, but_surfaces)) continue;
      std::vector<ArrayShape>& arrays = pieces.emplace_back();
      for (int i = 0; i < piece.GetNumberOfNestedElements(); ++i) {
        vtkXMLDataElement& data = *piece.GetNestedElement(i);
        const std::string_view name = data.GetName();
        if (name == "PointData" || name == "CellData") add_arrays(data, name == "CellData", arrays);
      }
    }
  }
  return pieces;
}

}  // namespace splatvol
