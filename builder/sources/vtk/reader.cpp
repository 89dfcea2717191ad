#include "builder/sources/vtk/reader.h"

#include <fmt/format.h>
#include <vtkDataSet.h>
#include <vtkDataSetReader.h>
#include <vtkNew.h>
#include <vtkSmartPointer.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLImageDataReader.h>
#include <vtkXMLPolyDataReader.h>
#include <vtkXMLRectilinearGridReader.h>
#include <vtkXMLStructuredGridReader.h>
#include <vtkXMLUnstructuredGridReader.h>

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <optional>
#include <utility>

#include "builder/sources/block_numbers.h"
#include "builder/sources/vtk/attributes.h"
#include "builder/sources/vtk/blocks.h"
#include "builder/sources/vtk/cell_counts.h"
#include "builder/sources/vtk/ensight_case.h"
#include "builder/sources/vtk/gmsh_reader.h"
#include "builder/sources/vtk/hdf5_checks.h"
#include "builder/sources/vtk/legacy_checks.h"
#include "builder/sources/vtk/messages.h"
#include "builder/sources/vtk/su2_reader.h"
#include "builder/sources/vtk/vtkhdf_reader.h"
#include "builder/sources/vtk/xml_arrays.h"
#include "builder/sources/vtk/xml_checks.h"
#include "builder/sources/vtk/xml_file.h"

namespace splatvol {
namespace {

/// VTK files in their order; the pieces of a .vtu and the blocks of a file one by one.
class FileDataSets final : public VtkDataSets {
 public:
  FileDataSets(std::vector<VtkFile> files, const SourceOptions& options)
      : files_(std::move(files)), options_(options) {}

  /// The blocks that a composite file names.
  FileDataSets(const VtkFile& composite, const SourceOptions& options) : FileDataSets(composite.blocks, options) {
    path_ = composite.path;
    is_composite_ = true;
    for (VtkFile& file : files_) file.is_block = true;
  }

  std::size_t count() const override {
    const std::size_t blocks = blocks_ ? std::max<std::size_t>(blocks_->count(), 1) - 1 : 0;
    return files_.size() + extra_pieces_ + blocks;
  }
  const std::string& path() const override { return path_; }
  std::string unit(const std::string& array) const override { return blocks_ ? blocks_->unit(array) : std::string(); }
  std::optional<TimeStep> time_step() const override { return step_; }
  CellCensus left_out() const override {
    CellCensus all = left_out_;
    if (blocks_) all += blocks_->left_out();
    return all;
  }
  std::set<std::string> notes() const override {
    std::set<std::string> all = notes_;
    if (blocks_) all.merge(blocks_->notes());
    return all;
  }
  std::set<std::string> left_out_arrays() const override {
    std::set<std::string> all = left_out_arrays_;
    if (blocks_) all.merge(blocks_->left_out_arrays());
    return all;
  }
  void share_means(vtkDataSet& data, const std::string& array, int component, std::span<double> means) const override {
    if (blocks_) blocks_->share_means(data, array, component, means);
  }

  std::vector<Patch> take_patches() override {
    std::vector<Patch> patches = std::exchange(patches_, {});
    if (blocks_) std::ranges::move(blocks_->take_patches(), std::back_inserter(patches));
    return patches;
  }

  Status announce(ArrayUnion& arrays) override {
    for (std::size_t file = 0; file < files_.size(); ++file)
      SPLATVOL_TRY(file + 1 == file_ ? announce_rest(arrays) : announce_file(files_[file], arrays));
    return {};
  }

  CellCensus take_changes() override {
    CellCensus changes = std::exchange(changes_, {});
    if (blocks_) changes += blocks_->take_changes();
    return changes;
  }

  bool averages_by_data_set() const override { return !blocks_ || blocks_->averages_by_data_set(); }
  bool rounds_points() const override { return blocks_ && blocks_->rounds_points(); }
  Result<bool> has_finer_points() override { return blocks_ ? blocks_->has_finer_points() : Result<bool>(false); }

  std::vector<std::uint64_t> part_sizes() const override {
    std::vector<std::uint64_t> bytes;
    if (files_.size() < 2) return bytes;
    for (const VtkFile& file : files_) bytes.push_back(size_of(file));
    return bytes;
  }

  void select(const std::vector<std::uint64_t>& files) override {
    selected_ = files;
    if (file_ > 0 && !is_selected(file_ - 1)) {
      blocks_ = nullptr;
      reader_ = nullptr;
    }
  }

  Source::PieceNumber number() const override { return {static_cast<std::uint32_t>(file_ - 1), in_file_ - 1}; }

  DeclaredArrays declared() const override { return blocks_ ? blocks_->declared() : declared_; }

  std::uint64_t block() const override { return inner_block(files_[file_ - 1].block, blocks_ ? blocks_->block() : 0); }

  std::size_t blocks() const override {
    if (!files_.empty() && files_[0].kind == VtkFile::Kind::composite) return blocks_in(files_[0]);
    return blocks_ ? blocks_->blocks() : 1;
  }
  std::string block_word() const override { return blocks_ ? blocks_->block_word() : "block"; }
  std::size_t block_in_file() const override {
    std::size_t before = 0;
    for (std::size_t file = 0; is_composite_ && file + 1 < file_; ++file) before += blocks_in(files_[file]);
    return before + (blocks_ ? blocks_->block_in_file() : 1);
  }
  std::span<const int> blocks_of_cells() const override {
    return blocks_ ? blocks_->blocks_of_cells() : std::span<const int>();
  }

  Result<vtkSmartPointer<vtkDataSet>> next() override {
    for (;;) {
      SPLATVOL_TRY_ASSIGN(data, next_of_file());
      ++in_file_;
      if (!data || !files_[file_ - 1].is_block) return data;
      bool used = false;
      SPLATVOL_TRY(run_vtk(path_, [&] { used = data->GetNumberOfPoints() > 0 && !is_surface(*data); }));
      if (used) return data;
      SPLATVOL_TRY(run_vtk(path_, [&] { left_out_ += census_of(*data); }));
      left_out_.left_out += static_cast<std::uint64_t>(data->GetNumberOfCells());
    }
  }

 private:
  /// Adds the arrays of what is left of the current file.
  Status announce_rest(ArrayUnion& arrays) const {
    if (blocks_) return blocks_->announce(arrays);
    return reader_ ? announce_file(files_[file_ - 1], arrays) : Status{};
  }

  Status announce_file(const VtkFile& file, ArrayUnion& arrays) const {
    if (is_xml(file.kind)) {
      SPLATVOL_TRY_ASSIGN(pieces, xml_arrays(file.path));
      for (XmlPiece& piece : pieces)
        if (piece.has_points && !(file.is_block && piece.is_surface))
          SPLATVOL_TRY(arrays.add(file.path, wanted(std::move(piece.arrays))));
      return {};
    }
    if (file.kind == VtkFile::Kind::legacy) return add(file.path, legacy_arrays(file.path), arrays);
    if (file.kind == VtkFile::Kind::gmsh) return add(file.path, gmsh_arrays(file.path), arrays);
    if (file.kind == VtkFile::Kind::ensight) return add(file.path, ensight_arrays(file.path), arrays);
    if (file.kind == VtkFile::Kind::su2) return add(file.path, su2_arrays(file), arrays);
    SPLATVOL_TRY_ASSIGN(blocks, open_any(file));
    return blocks->announce(arrays);
  }

  Status add(const std::string& path, Result<std::vector<ArrayShape>> listed, ArrayUnion& arrays) const {
    if (!listed) return tl::unexpected(listed.error());
    return arrays.add(path, wanted(std::move(*listed)));
  }

  [[nodiscard]] std::vector<ArrayShape> wanted(std::vector<ArrayShape> shapes) const {
    std::erase_if(shapes, [&](const ArrayShape& shape) {
      return is_bookkeeping(shape.name) || !wants_array(options_.selection, shape.name);
    });
    return shapes;
  }

  static bool is_xml(VtkFile::Kind kind) {
    return kind == VtkFile::Kind::unstructured || kind == VtkFile::Kind::structured ||
           kind == VtkFile::Kind::rectilinear || kind == VtkFile::Kind::image || kind == VtkFile::Kind::poly;
  }

  static std::size_t blocks_in(const VtkFile& file) {
    if (file.kind != VtkFile::Kind::composite) return 1;
    std::size_t blocks = 0;
    for (const VtkFile& block : file.blocks) blocks += blocks_in(block);
    return blocks;
  }

  [[nodiscard]] bool is_selected(std::size_t file) const {
    return !selected_ || std::ranges::binary_search(*selected_, file);
  }

  // In bytes, with the files that it names; 0 for what has no size, such as a folder.
  static std::uint64_t size_of(const VtkFile& file) {
    std::error_code error;
    const std::uint64_t own = std::filesystem::file_size(file.path, error);
    std::uint64_t bytes = error ? 0 : own;
    for (const VtkFile& block : file.blocks) bytes += size_of(block);
    return bytes;
  }

  Result<vtkSmartPointer<vtkDataSet>> next_of_file() {
    if (blocks_) {
      SPLATVOL_TRY_ASSIGN(block, blocks_->next());
      if (block) return block;
      extra_pieces_ += std::max<std::size_t>(blocks_->count(), 1) - 1;
      left_out_ += blocks_->left_out();
      notes_.merge(blocks_->notes());
      left_out_arrays_.merge(blocks_->left_out_arrays());
      changes_ += blocks_->take_changes();
      std::ranges::move(blocks_->take_patches(), std::back_inserter(patches_));
      blocks_ = nullptr;
    }
    if (reader_) return next_piece();
    while (file_ < files_.size() && !is_selected(file_)) ++file_;
    if (file_ == files_.size()) return vtkSmartPointer<vtkDataSet>();
    const VtkFile& file = files_[file_++];
    in_file_ = 0;
    path_ = file.path;
    if (file.kind == VtkFile::Kind::legacy) return read_legacy();
    if (is_xml(file.kind)) {
      SPLATVOL_TRY_ASSIGN(is_empty, is_empty_xml(path_));
      if (is_empty) return vtkSmartPointer<vtkDataSet>(vtkSmartPointer<vtkUnstructuredGrid>::New());
      SPLATVOL_TRY(open_xml(file.kind));
      return next_piece();
    }
    SPLATVOL_TRY_ASSIGN(blocks, open_any(file));
    blocks_ = std::move(blocks);
    if (!step_ && file.kind != VtkFile::Kind::composite) step_ = blocks_->time_step();
    return next_of_file();
  }

  Result<std::unique_ptr<VtkDataSets>> open_any(const VtkFile& file) const {
    forbid_hdf5_plugins();
    switch (file.kind) {
      case VtkFile::Kind::composite:
        return std::make_unique<FileDataSets>(file, options_);
      case VtkFile::Kind::gmsh:
        return open_gmsh(file, options_);
      case VtkFile::Kind::su2:
        return open_su2(file, options_.selection);
      case VtkFile::Kind::vtkhdf:
        return open_vtkhdf(file, options_);
      default:
        return open_blocks(file, options_);
    }
  }

  Status open_xml(VtkFile::Kind kind) {
    SPLATVOL_TRY_SET(declared_of_pieces_, check_xml(path_));
    auto reader = make_xml_reader(kind);
    SPLATVOL_TRY(run_vtk(path_, [&] {
      reader->SetFileName(path_.c_str());
      reader->UpdateInformation();
      select_arrays(*reader);
    }));
    auto* unstructured = vtkXMLUnstructuredGridReader::SafeDownCast(reader);
    piece_ = 0;
    pieces_ = unstructured ? std::max<int>(1, static_cast<int>(unstructured->GetNumberOfPieces())) : 1;
    extra_pieces_ += static_cast<std::size_t>(pieces_ - 1);
    reader_ = reader;
    return {};
  }

  void select_arrays(vtkXMLReader& reader) const {
    for (int i = 0; i < reader.GetNumberOfPointArrays(); ++i) {
      const std::string name = reader.GetPointArrayName(i);
      if (!is_ghost_array(name) && !wants_array(options_.selection, name)) reader.SetPointArrayStatus(name.c_str(), 0);
    }
    for (int i = 0; i < reader.GetNumberOfCellArrays(); ++i) {
      const std::string name = reader.GetCellArrayName(i);
      if (!is_ghost_array(name) && name != "HigherOrderDegrees" && !wants_array(options_.selection, name))
        reader.SetCellArrayStatus(name.c_str(), 0);
    }
  }

  Result<vtkSmartPointer<vtkDataSet>> next_piece() {
    vtkSmartPointer<vtkDataSet> data;
    SPLATVOL_TRY(run_vtk(path_, [&] {
      reader_->UpdatePiece(piece_, pieces_, 0);
      if (auto* output = vtkDataSet::SafeDownCast(reader_->GetOutputDataObject(0))) {
        data = copy_sharing_arrays(*output);
        output->ReleaseData();
      }
    }));
    declare_piece(static_cast<std::size_t>(piece_));
    if (++piece_ == pieces_) reader_ = nullptr;
    if (!data) return fail(ErrorCode::invalid_data, "{}: VTK's reader gave no data", path_);
    return data;
  }

  void declare_piece(std::size_t piece) {
    declared_ = {};
    if (piece >= declared_of_pieces_.size()) return;
    if (pieces_ > 1) declared_.part = fmt::format("piece {}", piece + 1);
    declared_.arrays = std::move(declared_of_pieces_[piece].arrays);
  }

  Result<vtkSmartPointer<vtkDataSet>> read_legacy() {
    declared_ = {};
    SPLATVOL_TRY_SET(declared_.arrays, legacy_arrays(path_));
    vtkSmartPointer<vtkDataSet> data;
    SPLATVOL_TRY(run_vtk(path_, [&] {
      const vtkNew<vtkDataSetReader> reader;
      reader->SetFileName(path_.c_str());
      reader->ReadAllScalarsOn();
      reader->ReadAllVectorsOn();
      reader->ReadAllNormalsOn();
      reader->ReadAllTensorsOn();
      reader->ReadAllColorScalarsOn();
      reader->ReadAllTCoordsOn();
      reader->ReadAllFieldsOn();
      reader->Update();
      data = reader->GetOutput();
      if (data) name_in_utf8(*data);
    }));
    if (!data) return fail(ErrorCode::invalid_data, "{}: holds no data set", path_);
    return data;
  }

  std::vector<VtkFile> files_;
  SourceOptions options_;
  bool is_composite_ = false;  // the files are blocks
  std::optional<TimeStep> step_;
  std::size_t file_ = 0;                                // the next one
  std::uint32_t in_file_ = 0;                           // data sets of the current file so far
  std::optional<std::vector<std::uint64_t>> selected_;  // numbers of files; none: all
  std::size_t extra_pieces_ = 0;                        // of opened files, besides one for each
  std::string path_;                                    // of the current file
  CellCensus left_out_;                                 // of the files before the current one
  std::set<std::string> notes_, left_out_arrays_;       // of these files
  CellCensus changes_;                                  // of these files, not taken yet
  std::vector<Patch> patches_;                          // of these files, not taken yet
  std::unique_ptr<VtkDataSets> blocks_;                 // of the current file, while it has blocks left
  vtkSmartPointer<vtkXMLReader> reader_;                // of the current file, while it has pieces left
  std::vector<XmlPiece> declared_of_pieces_;            // of the current file
  DeclaredArrays declared_;                             // of the last data set, if the current file has no blocks_
  int piece_ = 0;                                       // the next one
  int pieces_ = 0;
};

}  // namespace

vtkSmartPointer<vtkXMLReader> make_xml_reader(VtkFile::Kind kind) {
  switch (kind) {
    case VtkFile::Kind::unstructured:
      return make_unstructured_reader();
    case VtkFile::Kind::structured:
      return vtkSmartPointer<vtkXMLStructuredGridReader>::New();
    case VtkFile::Kind::rectilinear:
      return vtkSmartPointer<vtkXMLRectilinearGridReader>::New();
    case VtkFile::Kind::image:
      return vtkSmartPointer<vtkXMLImageDataReader>::New();
    case VtkFile::Kind::poly:
      return vtkSmartPointer<vtkXMLPolyDataReader>::New();
    default:
      return nullptr;
  }
}

std::unique_ptr<VtkDataSets> read_vtk_files(std::vector<VtkFile> files, const SourceOptions& options) {
  return std::make_unique<FileDataSets>(std::move(files), options);
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
