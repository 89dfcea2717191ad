#include "builder/sources/vtk/xml_reader.h"

#include <fmt/format.h>
#include <vtkDataSet.h>
#include <vtkSmartPointer.h>
#include <vtkXMLImageDataReader.h>
#include <vtkXMLPolyDataReader.h>
#include <vtkXMLRectilinearGridReader.h>
#include <vtkXMLStructuredGridReader.h>
#include <vtkXMLUnstructuredGridReader.h>

#include <algorithm>
#include <filesystem>
#include <utility>

#include "builder/sources/loaded_data_sets.h"
#include "builder/sources/mesh_data.h"
#include "builder/sources/vtk/data_set.h"
#include "builder/sources/vtk/messages.h"
#include "builder/sources/vtk/xml_arrays.h"
#include "builder/sources/vtk/xml_checks.h"
#include "builder/sources/vtk/xml_file.h"

namespace splatvol {
namespace {

Result<ArraysOfParts> list_arrays(const InputFile& file) {
  SPLATVOL_TRY_ASSIGN(pieces, xml_arrays(file.path));
  ArraysOfParts arrays;
  for (XmlPiece& piece : pieces)
    if (piece.has_points && !(file.is_block && piece.is_surface)) arrays.push_back(std::move(piece.arrays));
  return arrays;
}

/// The pieces of one file.
class XmlDataSets final : public DataSets {
 public:
  XmlDataSets(InputFile file, std::vector<std::string> selection, vtkSmartPointer<vtkXMLReader> reader)
      : file_(std::move(file)), selection_(std::move(selection)), reader_(std::move(reader)) {}

  Status open() {
    SPLATVOL_TRY_SET(declared_of_pieces_, check_xml(file_.path));
    SPLATVOL_TRY(run_vtk(file_.path, [&] {
      reader_->SetFileName(file_.path.c_str());
      reader_->UpdateInformation();
      select_arrays();
    }));
    if (auto* unstructured = vtkXMLUnstructuredGridReader::SafeDownCast(reader_))
      pieces_ = std::max<int>(1, static_cast<int>(unstructured->GetNumberOfPieces()));
    return {};
  }

  std::size_t count() const override { return static_cast<std::size_t>(pieces_); }
  const std::string& path() const override { return file_.path; }
  DeclaredArrays declared() const override { return declared_; }

  Result<std::unique_ptr<DataSet>> next() override {
    std::unique_ptr<DataSet> data;
    if (piece_ == pieces_) return data;
    SPLATVOL_TRY(run_vtk(file_.path, [&] {
      reader_->UpdatePiece(piece_, pieces_, 0);
      if (auto* output = vtkDataSet::SafeDownCast(reader_->GetOutputDataObject(0))) {
        data = data_set_sharing_arrays(*output);
        output->ReleaseData();
      }
    }));
    declare_piece(static_cast<std::size_t>(piece_));
    if (++piece_ == pieces_) reader_ = nullptr;
    if (!data) return fail(ErrorCode::invalid_data, "{}: VTK's reader gave no data", file_.path);
    return data;
  }

 private:
  void select_arrays() const {
    for (int i = 0; i < reader_->GetNumberOfPointArrays(); ++i) {
      const std::string name = reader_->GetPointArrayName(i);
      if (!is_ghost_array(name) && !wants_array(selection_, name)) reader_->SetPointArrayStatus(name.c_str(), 0);
    }
    for (int i = 0; i < reader_->GetNumberOfCellArrays(); ++i) {
      const std::string name = reader_->GetCellArrayName(i);
      if (!is_ghost_array(name) && name != "HigherOrderDegrees" && !wants_array(selection_, name))
        reader_->SetCellArrayStatus(name.c_str(), 0);
    }
  }

  void declare_piece(std::size_t piece) {
    declared_ = {};
    if (piece >= declared_of_pieces_.size()) return;
    if (pieces_ > 1) declared_.part = fmt::format("piece {}", piece + 1);
    declared_.arrays = std::move(declared_of_pieces_[piece].arrays);
  }

  InputFile file_;
  std::vector<std::string> selection_;
  vtkSmartPointer<vtkXMLReader> reader_;  // while it has pieces left
  std::vector<XmlPiece> declared_of_pieces_;
  DeclaredArrays declared_;  // of the last data set
  int piece_ = 0;            // the next one
  int pieces_ = 1;
};

template <class Reader>
vtkSmartPointer<vtkXMLReader> make() {
  return vtkSmartPointer<Reader>::New();
}

template <auto make_reader>
Result<std::unique_ptr<DataSets>> open_file(const InputFile& file, const SourceOptions& options) {
  SPLATVOL_TRY_ASSIGN(is_empty, is_empty_xml(file.path));
  if (is_empty) {
    std::vector<std::unique_ptr<DataSet>> empty;
    empty.push_back(std::make_unique<MeshDataSet>(MeshData()));
    return std::make_unique<LoadedDataSets>(file.path, std::move(empty));
  }
  auto data_sets = std::make_unique<XmlDataSets>(file, options.selection, make_reader());
  SPLATVOL_TRY(data_sets->open());
  return data_sets;
}

}  // namespace

std::optional<FileReader> xml_reader_of(std::string_view type) {
  if (type == "UnstructuredGrid") return FileReader{open_file<make_unstructured_reader>, list_arrays};
  if (type == "StructuredGrid") return FileReader{open_file<make<vtkXMLStructuredGridReader>>, list_arrays};
  if (type == "RectilinearGrid") return FileReader{open_file<make<vtkXMLRectilinearGridReader>>, list_arrays};
  if (type == "ImageData") return FileReader{open_file<make<vtkXMLImageDataReader>>, list_arrays};
  if (type == "PolyData") return FileReader{open_file<make<vtkXMLPolyDataReader>>, list_arrays};
  return std::nullopt;
}

Result<ParallelFile> read_parallel_file(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(parser, parse_xml(path));
  ParallelFile file;
  vtkXMLDataElement* grid = nullptr;
  for (const char* name : {"PUnstructuredGrid", "PImageData", "PRectilinearGrid", "PStructuredGrid"})
    if (!grid) grid = parser->GetRootElement()->FindNestedElementWithName(name);
  const auto folder = std::filesystem::path(path).parent_path();
  for (int i = 0; grid && i < grid->GetNumberOfNestedElements(); ++i) {
    vtkXMLDataElement* element = grid->GetNestedElement(i);
    const char* piece = element->GetAttribute("Source");
    if (element->GetName() == std::string("Piece") && piece) file.pieces.push_back((folder / piece).string());
    add_arrays(*element, file.arrays);
  }
  if (file.pieces.empty()) return fail(ErrorCode::invalid_data, "{}: damaged, or names no pieces", path);
  SPLATVOL_TRY(check_parallel_pieces(path, *grid));
  return file;
}

}  // namespace splatvol
