#include "builder/sources/vtk/xml_arrays.h"

#include <algorithm>
#include <string_view>

#include "builder/sources/data_sets.h"
#include "builder/sources/read_text.h"
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

bool has_any(vtkXMLDataElement& piece, const char* count) {
  double number = 0;
  return piece.GetScalarAttribute(count, number) != 0 && number > 0;
}

/// Pieces of structured grids state no number of points.
bool has_points(vtkXMLDataElement& piece) {
  return text_of(piece, "NumberOfPoints").empty() || has_any(piece, "NumberOfPoints");
}

}  // namespace

void add_arrays(vtkXMLDataElement& data, std::vector<ArrayShape>& arrays) {
  const std::string_view element = data.GetName();
  const bool of_cells = element.ends_with("CellData");
  if (!is_one_of(element, {"PointData", "CellData", "PPointData", "PCellData"})) return;
  for (int i = 0; i < data.GetNumberOfNestedElements(); ++i) {
    vtkXMLDataElement& array = *data.GetNestedElement(i);
    const std::string_view name = text_of(array, "Name");
    if (name.empty() || text_of(array, "type") == "String" || is_bookkeeping(name) || is_of_ids(data, name)) continue;
    int components = 1;
    array.GetScalarAttribute("NumberOfComponents", components);
    arrays.push_back({std::string(name), std::max(components, 1), of_cells, unit_of(array)});
  }
}

std::vector<XmlPiece> pieces_of(vtkXMLDataElement& root) {
  std::vector<XmlPiece> pieces;
  for (int g = 0; g < root.GetNumberOfNestedElements(); ++g) {
    vtkXMLDataElement& grid = *root.GetNestedElement(g);
    for (int p = 0; p < grid.GetNumberOfNestedElements(); ++p) {
      vtkXMLDataElement& element = *grid.GetNestedElement(p);
      if (element.GetName() != std::string_view("Piece")) continue;
      XmlPiece& piece = pieces.emplace_back();
      piece.has_points = has_points(element);
      piece.is_surface = has_any(element, "NumberOfPolys") || has_any(element, "NumberOfStrips");
      for (int i = 0; i < element.GetNumberOfNestedElements(); ++i)
        add_arrays(*element.GetNestedElement(i), piece.arrays);
    }
  }
  return pieces;
}

Result<std::vector<XmlPiece>> xml_arrays(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(parser, parse_xml(path));
  return pieces_of(*parser->GetRootElement());
}

}  // namespace splatvol
