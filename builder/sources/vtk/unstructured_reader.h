// .vtu files of a version that VTK 9.1 does not know yet.
#pragma once

class vtkXMLReader;
template <class T>
class vtkSmartPointer;

namespace splatvol {

/// VTK's reader of unstructured grids, and what file version 2.3 adds: polyhedra in arrays of their own. Damage to
/// these is reported as VTK reports its own errors.
[[nodiscard]] vtkSmartPointer<vtkXMLReader> make_unstructured_reader();

}  // namespace splatvol
