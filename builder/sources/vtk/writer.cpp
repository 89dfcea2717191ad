#include "builder/sources/vtk/writer.h"

#include <vtkCellArray.h>
#include <vtkCellType.h>
#include <vtkErrorCode.h>
#include <vtkFloatArray.h>
#include <vtkNew.h>
#include <vtkObject.h>
#include <vtkObjectFactory.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkSmartPointer.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLUnstructuredGridWriter.h>

#include <algorithm>

#include "base/file.h"

namespace splatvol {
namespace {

vtkNew<vtkUnstructuredGrid> make_grid(std::span<const dvec3> points,
                                      std::span<const std::array<std::uint32_t, 4>> tetrahedra,
                                      std::span<const PointArray> arrays) {
  const vtkNew<vtkCellArray> cells;
  cells->AllocateExact(static_cast<vtkIdType>(tetrahedra.size()), static_cast<vtkIdType>(4 * tetrahedra.size()));
  for (const auto& [a, b, c, d] : tetrahedra) cells->InsertNextCell({a, b, c, d});

  vtkNew<vtkUnstructuredGrid> grid;
  const vtkNew<vtkPoints> positions;
  positions->SetDataTypeToDouble();
  positions->SetNumberOfPoints(static_cast<vtkIdType>(points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) positions->SetPoint(static_cast<vtkIdType>(i), &points[i].x);
  grid->SetPoints(positions);
  grid->SetCells(VTK_TETRA, cells);
  for (const PointArray& array : arrays) {
    const vtkNew<vtkFloatArray> values;
    values->SetName(array.name.c_str());
    values->SetNumberOfComponents(array.components);
    values->SetNumberOfTuples(static_cast<vtkIdType>(points.size()));
    std::ranges::copy(array.values, values->GetPointer(0));
    grid->GetPointData()->AddArray(values);
  }
  return grid;
}

// Writes the mark of an export, if the file is one.
class Writer final : public vtkXMLUnstructuredGridWriter {
 public:
  static Writer* New();

  bool is_export = false;

 protected:
  // VTK's function begins the file with the XML declaration and the first element. The mark stands between them, so the
  // declaration is written here; VTK writes none for data that are not encoded.
  int StartFile() override {
    if (!is_export || EncodeAppendedData == 0) return vtkXMLUnstructuredGridWriter::StartFile();
    *Stream << "<?xml version=\"1.0\"?>\n" << vtk_export_mark << '\n';
    EncodeAppendedDataOff();
    const int started = vtkXMLUnstructuredGridWriter::StartFile();
    EncodeAppendedDataOn();
    return started;
  }
};
vtkStandardNewMacro(Writer);

// Keeps VTK from printing dumps of its objects.
class Silence {
 public:
  Silence() { vtkObject::GlobalWarningDisplayOff(); }
  Silence(const Silence&) = delete;
  Silence& operator=(const Silence&) = delete;
  ~Silence() { vtkObject::SetGlobalWarningDisplay(before_); }

 private:
  int before_ = vtkObject::GetGlobalWarningDisplay();
};

}  // namespace

Status write_vtu(const std::string& path, std::span<const dvec3> points,
                 std::span<const std::array<std::uint32_t, 4>> tetrahedra, std::span<const PointArray> arrays,
                 const VtuOptions& options) {
  const auto grid = make_grid(points, tetrahedra, arrays);
  SPLATVOL_TRY_ASSIGN(file, AtomicFile::create(path, AtomicFile::Unnamed::if_possible, options.replace));
  const vtkNew<Writer> writer;
  writer->is_export = options.is_export;
  writer->SetFileName(file.path_to_write().c_str());
  writer->SetHeaderTypeToUInt64();
  writer->SetInputData(grid);
  const Silence silence;
  const bool written = writer->Write() != 0;
  const unsigned long error = writer->GetErrorCode();
  if (error == vtkErrorCode::OutOfDiskSpaceError)
    return fail(ErrorCode::io, "{}: cannot write: no space left, or a limit on the size of files", path);
  if (!written || error != vtkErrorCode::NoError) return fail(ErrorCode::io, "{}: VTK's writer failed", path);
  return file.commit();
}

}  // namespace splatvol
