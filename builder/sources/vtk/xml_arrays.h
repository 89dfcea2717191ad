// The arrays that the header of an XML file announces.
#pragma once

#include <string>
#include <vector>

#include "base/error.h"
#include "builder/sources/array_union.h"

class vtkXMLDataElement;

namespace splatvol {

/// A piece of an XML file, as its header describes it.
struct XmlPiece {
  std::vector<ArrayShape>
      arrays;  // those that give attributes, as array_shapes lists them when the piece has been read
  bool has_points = false;
  bool is_surface = false;  // it has polygons or strips
};

/// Adds the arrays of a PointData or CellData element, or of the PPointData or PCellData of a parallel file. Other
/// elements have none.
void add_arrays(vtkXMLDataElement& element, std::vector<ArrayShape>& arrays);

/// Lists the pieces of the file whose root is given, in their order.
[[nodiscard]] std::vector<XmlPiece> pieces_of(vtkXMLDataElement& root);

/// The same for the file at `path`. Reads no appended data. Fails if the file is no whole XML file; trusts nothing else
/// in it.
[[nodiscard]] Result<std::vector<XmlPiece>> xml_arrays(const std::string& path);

}  // namespace splatvol
