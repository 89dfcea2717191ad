// .vtu files of version 2.3, which VTK 9.1 does not know.
#pragma once

class vtkXMLReader;
template <class T>
class vtkSmartPointer;

namespace splatvol {

/// Makes VTK's reader of unstructured grids, extended to file version 2.3: polyhedra in arrays of their own. It reports
/// damage to these arrays like VTK's own errors.
[[nodiscard]] vtkSmartPointer<vtkXMLReader> make_unstructured_reader();

}  // namespace splatvol
