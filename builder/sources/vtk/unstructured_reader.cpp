#include <vtkDataArraySelection.h>
#include <vtkIdTypeArray.h>
#include <vtkObjectFactory.h>
#include <vtkSmartPointer.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLDataElement.h>
#include <vtkXMLUnstructuredGridReader.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <span>
#include <utility>

#include "builder/sources/vtk/xml_reader.h"

namespace splatvol {
namespace {

/// Extends vtkXMLUnstructuredGridReader to pieces with arrays of their own, and to file version 2.3. This lists the
/// points of each face and the faces of each polyhedron, both as an array of ends and an array of indices. VTK 9.1
/// knows only the older face stream.
class UnstructuredReader final : public vtkXMLUnstructuredGridReader {
 public:
  static UnstructuredReader* New();
  vtkTypeMacro(UnstructuredReader, vtkXMLUnstructuredGridReader)

      protected : UnstructuredReader() {
    // The arrays that it knows are those of the first piece.
    this->PointDataArraySelection->SetUnknownArraySetting(1);
    this->CellDataArraySelection->SetUnknownArraySetting(1);
  }

  /// Reads no piece without points: VTK's writer gives it no element of points, which VTK's reader asks for.
  void SetupOutputTotals() override {
    this->Superclass::SetupOutputTotals();
    if (this->EndPiece == this->StartPiece + 1 && this->NumberOfPoints[this->StartPiece] == 0)
      this->EndPiece = this->StartPiece;
  }

  /// Makes the arrays of the piece that is read. VTK makes those of the first piece for all, and fills them by their
  /// order. Requires that one piece is read at once.
  void SetupOutputData() override {
    const auto swap_pieces = [this] {
      for (vtkXMLDataElement** elements : {this->PointDataElements, this->CellDataElements, this->PointElements})
        std::swap(elements[0], elements[this->StartPiece]);
    };
    swap_pieces();
    this->Superclass::SetupOutputData();
    swap_pieces();
  }

  int ReadPieceData() override {
    if (!this->Superclass::ReadPieceData()) return 0;
    vtkXMLDataElement* cells = this->CellElements[this->Piece];
    return !this->FindDataArrayWithName(cells, "polyhedron_offsets") || read_faces(cells);
  }

 private:
  vtkSmartPointer<vtkIdTypeArray> read_ids(vtkXMLDataElement* cells, const char* name, vtkIdType count) {
    vtkXMLDataElement* element = this->FindDataArrayWithName(cells, name);
    vtkAbstractArray* array = element ? this->CreateArray(element) : nullptr;
    if (!array) return nullptr;
    array->SetNumberOfTuples(count);
    const bool complete = count == 0 || this->ReadArrayValues(element, 0, array, 0, count);
    vtkDataArray* numbers = vtkDataArray::SafeDownCast(array);
    if (!complete || !numbers) {
      array->Delete();
      return nullptr;
    }
    auto ids = vtkSmartPointer<vtkIdTypeArray>::New();
    ids->DeepCopy(numbers);
    array->Delete();
    return ids;
  }

  /// Whether an array can hold the ends of lists: not negative, not decreasing, and the last no larger than the number
  /// of values that a file of this size could hold.
  bool are_ends(vtkIdTypeArray* ends) const {
    if (!ends) return false;
    const std::span values(ends->GetPointer(0), static_cast<std::size_t>(ends->GetNumberOfValues()));
    if (values.empty()) return true;
    const auto largest = static_cast<vtkIdType>(most_values_per_byte * std::filesystem::file_size(this->FileName));
    return values.front() >= 0 && std::ranges::is_sorted(values) && values.back() <= largest;
  }

  static vtkIdType last(vtkIdTypeArray* ends) {
    return ends->GetNumberOfValues() == 0 ? 0 : ends->GetValue(ends->GetNumberOfValues() - 1);
  }

  int read_faces(vtkXMLDataElement* cells) {
    const vtkIdType cell_count = this->NumberOfCells[this->Piece];
    const auto cell_ends = read_ids(cells, "polyhedron_offsets", cell_count);
    if (!are_ends(cell_ends)) return fail_faces("polyhedron_offsets");
    const auto cell_faces = read_ids(cells, "polyhedron_to_faces", last(cell_ends));
    if (!cell_faces) return fail_faces("polyhedron_to_faces");

    // The file does not declare the number of faces; each face belongs to a cell.
    vtkIdType face_count = 0;
    for (vtkIdType i = 0; i < cell_faces->GetNumberOfValues(); ++i) {
      if (cell_faces->GetValue(i) < 0) return fail_faces("polyhedron_to_faces");
      face_count = std::max(face_count, cell_faces->GetValue(i) + 1);
    }
    if (face_count > last(cell_ends)) return fail_faces("polyhedron_to_faces");
    const auto face_ends = read_ids(cells, "face_offsets", face_count);
    if (!are_ends(face_ends)) return fail_faces("face_offsets");
    const auto points = read_ids(cells, "face_connectivity", last(face_ends));
    if (!points) return fail_faces("face_connectivity");

    set_face_stream(cell_ends, cell_faces, face_ends, points);
    return 1;
  }

  /// Sets the form of VTK 9.1: for each polyhedron the number of its faces, then the size and points of each face.
  void set_face_stream(vtkIdTypeArray* cell_ends, vtkIdTypeArray* cell_faces, vtkIdTypeArray* face_ends,
                       vtkIdTypeArray* points) {
    vtkUnstructuredGrid* grid = vtkUnstructuredGrid::SafeDownCast(this->GetCurrentOutput());
    const vtkNew<vtkIdTypeArray> stream, locations;
    for (vtkIdType cell = 0; cell < cell_ends->GetNumberOfValues(); ++cell) {
      const vtkIdType first = cell == 0 ? 0 : cell_ends->GetValue(cell - 1);
      const vtkIdType count = cell_ends->GetValue(cell) - first;
      locations->InsertNextValue(count == 0 ? -1 : stream->GetNumberOfValues());
      if (count == 0) continue;
      stream->InsertNextValue(count);
      for (vtkIdType i = first; i < first + count; ++i) {
        const vtkIdType face = cell_faces->GetValue(i);
        const vtkIdType begin = face == 0 ? 0 : face_ends->GetValue(face - 1);
        const vtkIdType end = face_ends->GetValue(face);
        stream->InsertNextValue(end - begin);
        for (vtkIdType k = begin; k < end; ++k) stream->InsertNextValue(points->GetValue(k));
      }
    }
    grid->SetCells(grid->GetCellTypesArray(), grid->GetCells(), locations, stream);
  }

  int fail_faces(const char* array) {
    vtkErrorMacro("the polyhedra's array \"" << array << "\" is missing, damaged or of the wrong length");
    return 0;
  }

  static constexpr std::uintmax_t most_values_per_byte = 1100;  // zlib's best ratio
};
vtkStandardNewMacro(UnstructuredReader);

}  // namespace

vtkSmartPointer<vtkXMLReader> make_unstructured_reader() { return vtkSmartPointer<UnstructuredReader>::New(); }

}  // namespace splatvol
