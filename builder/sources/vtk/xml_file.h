// XML files as trees of elements.
#pragma once

#include <vtkSmartPointer.h>
#include <vtkXMLDataElement.h>
#include <vtkXMLDataParser.h>

#include <string>

#include "base/error.h"

namespace splatvol {

/// Parses the XML file at `path`; its data behind AppendedData is left out. The root element is there. Fails if the
/// file is damaged or no XML. Fails also if elements are nested deeper than 64 levels: functions that walk the tree,
/// and VTK's own destructors, would exhaust the stack. Safe on untrusted files.
[[nodiscard]] Result<vtkSmartPointer<vtkXMLDataParser>> parse_xml(const std::string& path);

}  // namespace splatvol
