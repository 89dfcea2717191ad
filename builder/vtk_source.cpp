#include "builder/vtk_source.h"

#include <vtkCellArray.h>
#include <vtkCellData.h>
#include <vtkCellType.h>
#include <vtkDataArraySelection.h>
#include <vtkDataSetReader.h>
#include <vtkGenericCell.h>
#include <vtkHigherOrderHexahedron.h>
#include <vtkHigherOrderTetra.h>
#include <vtkHigherOrderWedge.h>
#include <vtkIdList.h>
#include <vtkIdTypeArray.h>
#include <vtkLogger.h>
#include <vtkMultiBlockDataSet.h>
#include <vtkMultiBlockPLOT3DReader.h>
#include <vtkObjectFactory.h>
#include <vtkOutputWindow.h>
#include <vtkPointData.h>
#include <vtkPolyData.h>
#include <vtkSmartPointer.h>
#include <vtkStructuredGrid.h>
#include <vtkUnsignedCharArray.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLDataElement.h>
#include <vtkXMLDataParser.h>
#include <vtkXMLImageDataReader.h>
#include <vtkXMLPolyDataReader.h>
#include <vtkXMLRectilinearGridReader.h>
#include <vtkXMLStructuredGridReader.h>
#include <vtkXMLUnstructuredGridReader.h>
#include <vtkXMLUtilities.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <optional>
#include <span>

#include "base/file.h"
#include "builder/lattice.h"
#include "builder/plot3d.h"
#include "builder/tetrahedra.h"
#include "builder/vtk_cells.h"
#include "builder/vtk_compression.h"

namespace splatvol {
namespace {

// --- Messages -------------------------------------------------------------------------------------------------------

/// Takes what VTK would print on stderr, and keeps the first error.
class ErrorWindow final : public vtkOutputWindow {
 public:
  static ErrorWindow* New();
  vtkTypeMacro(ErrorWindow, vtkOutputWindow)

      void DisplayText(const char*) override {}
  void DisplayErrorText(const char* text) override {
    if (first_error.empty()) first_error = text;
  }
  void DisplayWarningText(const char*) override {}
  void DisplayGenericWarningText(const char*) override {}
  void DisplayDebugText(const char*) override {}

  std::string first_error;
};
vtkStandardNewMacro(ErrorWindow);

/// "ERROR: In file, line N\nvtkReader (0x...): What went wrong\n\n" to "What went wrong".
std::string one_line(std::string text) {
  if (const std::size_t object = text.find("): "); object != std::string::npos) text.erase(0, object + 3);
  std::string line;
  for (const char c : text) {
    const bool space = c == '\n' || c == '\t' || c == '\r' || c == ' ';
    if (!space) line += c;
    if (space && !line.empty() && line.back() != ' ') line += ' ';
  }
  while (!line.empty() && (line.back() == ' ' || line.back() == '.')) line.pop_back();
  return line;
}

/// Runs `read` with VTK kept silent; what it reports or throws becomes an Error that begins with `path`.
template <class Read>
Status run_vtk(const std::string& path, const Read& read) {
  vtkLogger::SetStderrVerbosity(vtkLogger::VERBOSITY_OFF);
  const vtkSmartPointer<vtkOutputWindow> usual = vtkOutputWindow::GetInstance();
  const auto window = vtkSmartPointer<ErrorWindow>::New();
  vtkOutputWindow::SetInstance(window);
  std::string failure;
  try {
    read();
    failure = one_line(window->first_error);
  } catch (const std::exception& exception) {
    failure = fmt::format("VTK's reader failed: {}", exception.what());
  }
  vtkOutputWindow::SetInstance(usual);
  if (!failure.empty()) return fail(ErrorCode::invalid_data, "{}: {}", path, failure);
  return {};
}

// --- Readers --------------------------------------------------------------------------------------------------------

/// vtkXMLUnstructuredGridReader and what file version 2.3 adds: polyhedra as faces -> points and cells -> faces, each
/// an array of ends and an array of indices. VTK 9.1 looks for the older face stream only.
class UnstructuredReader final : public vtkXMLUnstructuredGridReader {
 public:
  static UnstructuredReader* New();
  vtkTypeMacro(UnstructuredReader, vtkXMLUnstructuredGridReader)

      protected : int ReadPieceData() override {
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

  /// Ends of runs: not negative, not decreasing, and no more of them than a file of this size could hold.
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

    // The file does not say how many faces there are; every one of them belongs to a cell.
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

  /// Into VTK 9.1's own form: per polyhedron the number of faces, then per face its size and points.
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

/// Checks the header of every compressed array of an XML file.
class CompressedArrays {
 public:
  CompressedArrays(ByteSource& file, vtkXMLDataElement& root, std::uint64_t appended_position)
      : file_(file), appended_position_(appended_position) {
    const auto is = [&](vtkXMLDataElement* element, const char* name, std::string_view value) {
      const char* text = element ? element->GetAttribute(name) : nullptr;
      return text && text == value;
    };
    layout_ = {is(&root, "header_type", "UInt64"), is(&root, "byte_order", "BigEndian")};
    appended_base64_ = !is(root.FindNestedElementWithName("AppendedData"), "encoding", "raw");
  }

  [[nodiscard]] Status check(vtkXMLDataElement& element) {
    for (int i = 0; i < element.GetNumberOfNestedElements(); ++i) SPLATVOL_TRY(check(*element.GetNestedElement(i)));
    const std::string_view format = element.GetAttribute("format") ? element.GetAttribute("format") : "";
    if (format == "appended") return check_appended(element);
    return format == "binary" ? check_inline(element) : Status{};
  }

 private:
  Status check_appended(vtkXMLDataElement& element) {
    vtkTypeInt64 offset = 0;
    if (!element.GetScalarAttribute("offset", offset) || offset < 0) return {};
    const std::uint64_t position = appended_position_ + static_cast<std::uint64_t>(offset);
    return check_compression_header(file_, layout_, position, appended_base64_);
  }

  /// The numbers follow the element's start tag after white space.
  Status check_inline(vtkXMLDataElement& element) {
    constexpr std::uint64_t longest_tag = 4096;
    const auto tag = std::min(static_cast<std::uint64_t>(element.GetXMLByteIndex()), file_.size());
    std::string text(std::min(longest_tag, file_.size() - tag), '\0');
    SPLATVOL_TRY(file_.read(tag, std::as_writable_bytes(std::span(text))));
    const std::size_t end = text.find('>');
    if (end == std::string::npos) return {};
    const std::size_t start = text.find_first_not_of(" \t\r\n", end + 1);
    if (start == std::string::npos) return {};
    return check_compression_header(file_, layout_, tag + start, true);
  }

  ByteSource& file_;
  std::uint64_t appended_position_;
  CompressionLayout layout_;
  bool appended_base64_;
};

/// The data sets of an input, one in memory at a time.
class DataSets {
 public:
  virtual ~DataSets() = default;
  [[nodiscard]] virtual std::size_t count() const = 0;
  /// The next one; a null pointer after the last.
  [[nodiscard]] virtual Result<vtkSmartPointer<vtkDataSet>> next() = 0;
  /// The file that the last one came from.
  [[nodiscard]] virtual const std::string& path() const = 0;
};

bool is_ghost_array(const std::string& name) { return name == "vtkGhostType" || name == "vtkGhostLevels"; }

/// Whether a selection needs an array: by its name, or by that of one of its components.
bool wants_array(const std::vector<std::string>& selection, const std::string& array) {
  return selection.empty() || std::ranges::any_of(selection, [&](const std::string& name) {
           return name == array || name.starts_with(array + "[");
         });
}

vtkSmartPointer<vtkXMLReader> make_xml_reader(VtkFile::Kind kind) {
  switch (kind) {
    case VtkFile::Kind::unstructured:
      return vtkSmartPointer<UnstructuredReader>::New();
    case VtkFile::Kind::structured:
      return vtkSmartPointer<vtkXMLStructuredGridReader>::New();
    case VtkFile::Kind::rectilinear:
      return vtkSmartPointer<vtkXMLRectilinearGridReader>::New();
    case VtkFile::Kind::image:
      return vtkSmartPointer<vtkXMLImageDataReader>::New();
    case VtkFile::Kind::poly:
      return vtkSmartPointer<vtkXMLPolyDataReader>::New();
    case VtkFile::Kind::legacy:
      break;
  }
  return nullptr;
}

/// VTK files in their order; the pieces of a .vtu one by one.
class FileDataSets final : public DataSets {
 public:
  FileDataSets(std::vector<VtkFile> files, std::vector<std::string> selection)
      : files_(std::move(files)), selection_(std::move(selection)) {}

  std::size_t count() const override { return files_.size() + extra_pieces_; }
  const std::string& path() const override { return path_; }

  Result<vtkSmartPointer<vtkDataSet>> next() override {
    if (reader_) return next_piece();
    if (file_ == files_.size()) return vtkSmartPointer<vtkDataSet>();
    const VtkFile& file = files_[file_++];
    path_ = file.path;
    if (file.kind == VtkFile::Kind::legacy) return read_legacy();
    SPLATVOL_TRY(open_xml(file.kind));
    return next_piece();
  }

 private:
  Status open_xml(VtkFile::Kind kind) {
    auto reader = make_xml_reader(kind);
    SPLATVOL_TRY(run_vtk(path_, [&] {
      reader->SetFileName(path_.c_str());
      reader->UpdateInformation();
      select_arrays(*reader);
    }));
    if (vtkXMLDataElement* root = reader->GetXMLParser()->GetRootElement()) {
      SPLATVOL_TRY(check_names(*root));
      SPLATVOL_TRY(check_compression(*root, reader->GetXMLParser()->GetAppendedDataPosition()));
    }
    auto* unstructured = vtkXMLUnstructuredGridReader::SafeDownCast(reader);
    piece_ = 0;
    pieces_ = unstructured ? std::max<int>(1, static_cast<int>(unstructured->GetNumberOfPieces())) : 1;
    extra_pieces_ += static_cast<std::size_t>(pieces_ - 1);
    reader_ = reader;
    return {};
  }

  /// VTK counts arrays by name when it makes them and one by one when it fills them: of two with one name it fills the
  /// wrong one.
  Status check_names(vtkXMLDataElement& element) const {
    std::vector<std::string> names;
    for (int i = 0; i < element.GetNumberOfNestedElements(); ++i) {
      vtkXMLDataElement& nested = *element.GetNestedElement(i);
      SPLATVOL_TRY(check_names(nested));
      if (const char* name = nested.GetAttribute("Name")) names.emplace_back(name);
    }
    std::ranges::sort(names);
    const auto twice = std::ranges::adjacent_find(names);
    if (twice == names.end()) return {};
    return fail(ErrorCode::invalid_data, "{}: two arrays of its {} are called \"{}\"", path_, element.GetName(),
                *twice);
  }

  Status check_compression(vtkXMLDataElement& root, vtkTypeInt64 appended_position) const {
    if (!root.GetAttribute("compressor")) return {};
    SPLATVOL_TRY_ASSIGN(file, open_file(path_));
    return CompressedArrays(*file, root, static_cast<std::uint64_t>(appended_position)).check(root);
  }

  void select_arrays(vtkXMLReader& reader) const {
    if (reader.GetNumberOfPointArrays() == 0) return;  // a message will name the cells' arrays
    for (int i = 0; i < reader.GetNumberOfPointArrays(); ++i) {
      const std::string name = reader.GetPointArrayName(i);
      if (!is_ghost_array(name) && !wants_array(selection_, name)) reader.SetPointArrayStatus(name.c_str(), 0);
    }
    for (int i = 0; i < reader.GetNumberOfCellArrays(); ++i) {
      const std::string name = reader.GetCellArrayName(i);
      if (!is_ghost_array(name) && name != "HigherOrderDegrees") reader.SetCellArrayStatus(name.c_str(), 0);
    }
  }

  Result<vtkSmartPointer<vtkDataSet>> next_piece() {
    vtkSmartPointer<vtkDataSet> data;
    SPLATVOL_TRY(run_vtk(path_, [&] {
      reader_->UpdatePiece(piece_, pieces_, 0);
      // A copy that shares the arrays: the reader forgets its own before the next piece is read.
      if (auto* output = vtkDataSet::SafeDownCast(reader_->GetOutputDataObject(0))) {
        data.TakeReference(output->NewInstance());
        data->ShallowCopy(output);
        output->ReleaseData();
      }
    }));
    if (++piece_ == pieces_) reader_ = nullptr;
    if (!data) return fail(ErrorCode::invalid_data, "{}: VTK's reader gave no data", path_);
    return data;
  }

  Result<vtkSmartPointer<vtkDataSet>> read_legacy() {
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
    }));
    if (!data) return fail(ErrorCode::invalid_data, "{}: holds no data set", path_);
    return data;
  }

  std::vector<VtkFile> files_;
  std::vector<std::string> selection_;
  std::size_t file_ = 0;
  std::size_t extra_pieces_ = 0;
  std::string path_;
  vtkSmartPointer<vtkXMLReader> reader_;  // of the file at hand, while it has pieces left
  int piece_ = 0;
  int pieces_ = 0;
};

/// The blocks of a PLOT3D grid. The format interleaves them by quantity, so they are read together.
class Plot3dDataSets final : public DataSets {
 public:
  Plot3dDataSets(std::string grid, std::vector<vtkSmartPointer<vtkDataSet>> blocks)
      : grid_(std::move(grid)), blocks_(std::move(blocks)) {}

  std::size_t count() const override { return blocks_.size(); }
  const std::string& path() const override { return grid_; }
  Result<vtkSmartPointer<vtkDataSet>> next() override {
    if (block_ == blocks_.size()) return vtkSmartPointer<vtkDataSet>();
    return std::exchange(blocks_[block_++], nullptr);
  }

 private:
  std::string grid_;
  std::vector<vtkSmartPointer<vtkDataSet>> blocks_;
  std::size_t block_ = 0;
};

// --- Attributes -----------------------------------------------------------------------------------------------------

/// A scalar of a point: an array, its component, or its magnitude.
struct Channel {
  static constexpr int magnitude = -1;
  std::string name;
  std::string array;
  int components = 1;
  int component = 0;
};

/// Arrays that VTK or a filter made for its own books.
bool is_bookkeeping(vtkPointData& data, int index, const std::string& name) {
  const int role = data.IsArrayAnAttribute(index);
  return is_ghost_array(name) || name.starts_with("vtkOriginal") || name == "vtkValidPointMask" || name == "IBlank" ||
         role == vtkDataSetAttributes::GLOBALIDS || role == vtkDataSetAttributes::PEDIGREEIDS;
}

std::vector<Channel> channels_of(vtkDataSet& data) {
  std::vector<Channel> channels;
  vtkPointData& arrays = *data.GetPointData();
  for (int i = 0; i < arrays.GetNumberOfArrays(); ++i) {
    vtkDataArray* array = arrays.GetArray(i);  // null for strings
    if (!array || !arrays.GetArrayName(i)) continue;
    const std::string name = arrays.GetArrayName(i);
    const int components = array->GetNumberOfComponents();
    if (is_bookkeeping(arrays, i, name)) continue;
    if (components == 1) {
      channels.push_back({name, name, 1, 0});
      continue;
    }
    channels.push_back({name, name, components, Channel::magnitude});
    for (int c = 0; c < components; ++c) channels.push_back({fmt::format("{}[{}]", name, c), name, components, c});
  }
  return channels;
}

tl::unexpected<Error> fail_no_point_data(const std::string& path, vtkDataSet& data) {
  std::string names;
  for (int i = 0; i < data.GetCellData()->GetNumberOfArrays(); ++i)
    names += fmt::format("{}{}", names.empty() ? "" : ", ", data.GetCellData()->GetArrayName(i));
  if (names.empty()) return fail(ErrorCode::invalid_data, "{}: the mesh has no point data", path);
  return fail(ErrorCode::invalid_data, "{}: the mesh has no point data, only cell data ({}), which is not supported",
              path, names);
}

std::string list_names(const std::vector<std::string>& names) {
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "" : ", ") + name;
  return list;
}

// --- Cells ----------------------------------------------------------------------------------------------------------

/// Where VTK puts the nodes of a cell in the unit cell; empty where it does not say.
std::vector<dvec3> parametric_nodes(int vtk_type, vtkIdType count) {
  const auto cell = vtkSmartPointer<vtkCell>::Take(vtkGenericCell::InstantiateCell(vtk_type));
  cell->GetPointIds()->SetNumberOfIds(count);
  cell->GetPoints()->SetNumberOfPoints(count);
  if (auto* hexahedron = vtkHigherOrderHexahedron::SafeDownCast(cell)) hexahedron->SetUniformOrderFromNumPoints(count);
  if (auto* wedge = vtkHigherOrderWedge::SafeDownCast(cell)) wedge->SetUniformOrderFromNumPoints(count);
  if (auto* tetrahedron = vtkHigherOrderTetra::SafeDownCast(cell)) tetrahedron->Initialize();
  const double* coordinates = cell->GetParametricCoords();
  std::vector<dvec3> nodes;
  for (vtkIdType i = 0; coordinates && i < count; ++i, coordinates += 3)
    nodes.emplace_back(coordinates[0], coordinates[1], coordinates[2]);
  return nodes;
}

/// The linear cells of a cell with `count` nodes; nothing where they make no full lattice.
std::optional<std::vector<std::uint32_t>> linear_cells(const CellKind& kind, std::size_t count) {
  const bool linear_axis = kind.vtk_type == VTK_QUADRATIC_LINEAR_WEDGE;
  const auto order = lattice_order(kind.shape, linear_axis, count);
  if (!order) return std::nullopt;
  const auto parametric = parametric_nodes(kind.vtk_type, static_cast<vtkIdType>(count));
  return divide_lattice(kind.shape, *order, linear_axis ? 1 : *order, parametric);
}

// --- Pieces ---------------------------------------------------------------------------------------------------------

/// One data set to one piece.
class PieceMaker {
 public:
  PieceMaker(const std::string& path, vtkDataSet& data, const std::vector<Channel>& channels)
      : path_(path), data_(data), channels_(channels) {}

  Result<std::unique_ptr<Piece>> make() {
    const vtkIdType count = data_.GetNumberOfPoints();
    if (count > std::numeric_limits<std::uint32_t>::max())
      return fail(ErrorCode::unsupported, "{}: a piece of {} points; at most 2^32 - 1 are supported", path_, count);
    piece_->points.resize(static_cast<std::size_t>(count));
    for (vtkIdType i = 0; i < count; ++i) data_.GetPoint(i, &piece_->points[static_cast<std::size_t>(i)].x);
    use_.assign(piece_->points.size(), unused);

    SPLATVOL_TRY(read_ghosts());
    SPLATVOL_TRY(read_cells());
    drop_points();
    SPLATVOL_TRY(read_values());
    return std::move(piece_);
  }

 private:
  enum Use : std::uint8_t { unused, by_hidden_cells, by_visible_cells };

  Status read_ghosts() {
    cell_ghosts_ = data_.GetCellGhostArray();
    point_ghosts_ = data_.GetPointGhostArray();
    if (cell_ghosts_ && cell_ghosts_->GetNumberOfValues() < data_.GetNumberOfCells())
      return fail(ErrorCode::invalid_data, "{}: its cells' ghost array is too short", path_);
    if (point_ghosts_ && point_ghosts_->GetNumberOfValues() < data_.GetNumberOfPoints())
      return fail(ErrorCode::invalid_data, "{}: its points' ghost array is too short", path_);
    return {};
  }

  Status read_cells() {
    if (auto* surface = vtkPolyData::SafeDownCast(&data_)) return count_surface(*surface);
    grid_ = vtkUnstructuredGrid::SafeDownCast(&data_);
    if (grid_ && grid_->GetNumberOfCells() > 0) SPLATVOL_TRY(check_cell_array());
    TetrahedronSplitter splitter(piece_->points, piece_->tetrahedra, piece_->census);
    for (vtkIdType cell = 0; cell < data_.GetNumberOfCells(); ++cell) SPLATVOL_TRY(read_cell(cell, splitter));
    return {};
  }

  /// Cells without volume need no look at their points.
  Status count_surface(vtkPolyData& surface) {
    const auto add = [&](std::string_view name, vtkIdType count) {
      if (count == 0) return;
      piece_->census.cells[std::string(name)] += static_cast<std::uint64_t>(count);
      piece_->census.without_volume += static_cast<std::uint64_t>(count);
    };
    add("vertex", surface.GetNumberOfVerts());
    add("line", surface.GetNumberOfLines());
    add("polygon", surface.GetNumberOfPolys());
    add("triangle strip", surface.GetNumberOfStrips());
    return {};
  }

  /// VTK's readers check neither offsets against the connectivity nor types against the number of cells.
  Status check_cell_array() {
    vtkUnsignedCharArray* types = grid_->GetCellTypesArray();
    if (!grid_->GetCells()->IsValid() || !types || types->GetNumberOfValues() < grid_->GetNumberOfCells())
      return fail(ErrorCode::invalid_data, "{}: its cells' offsets, types and connectivity do not fit together", path_);
    return {};
  }

  Status read_cell(vtkIdType cell, TetrahedronSplitter& splitter) {
    const int type = data_.GetCellType(cell);
    const CellKind* kind = last_kind_ && last_kind_->vtk_type == type ? last_kind_ : find_cell_kind(type);
    if (!kind) return fail(ErrorCode::unsupported, "{}: cells of VTK type {} are not supported", path_, type);
    SPLATVOL_TRY(load_nodes(cell, *kind));

    // A structured grid says "empty" for a blanked cell.
    CellCensus& census = piece_->census;
    const bool hidden = is_hidden(cell, *kind) || (!grid_ && type == VTK_EMPTY_CELL);
    mark_nodes(*kind, hidden ? by_hidden_cells : by_visible_cells);
    if (hidden) {
      ++census.hidden;
      return {};
    }
    if (last_kind_ != kind) {
      last_kind_ = kind;
      kind_count_ = &census.cells[std::string(kind->name)];
    }
    ++*kind_count_;
    if (kind->role == CellRole::no_volume) ++census.without_volume;
    if (kind->role == CellRole::polyhedron) splitter.split_polyhedron(nodes_);
    if (kind->role == CellRole::shape) return split_shape(*kind, splitter);
    if (kind->role == CellRole::lattice) return split_lattice(cell, *kind, splitter);
    return {};
  }

  Status split_shape(const CellKind& kind, TetrahedronSplitter& splitter) {
    const std::size_t expected = node_count(kind.shape);
    if (nodes_.size() != expected)
      return fail(ErrorCode::invalid_data, "{}: a {} of {} nodes instead of {}", path_, kind.name, nodes_.size(),
                  expected);
    splitter.split(kind.shape, nodes_);
    return {};
  }

  Status split_lattice(vtkIdType cell, const CellKind& kind, TetrahedronSplitter& splitter) {
    auto& cells = lattice_cells_[{kind.vtk_type, nodes_.size()}];
    if (!cells) cells = linear_cells(kind, nodes_.size());
    if (!cells || !same_degrees(cell))
      return fail(ErrorCode::unsupported, "{}: a {} of {} nodes, which is not of one order in all directions", path_,
                  kind.name, nodes_.size());
    const std::size_t stride = node_count(kind.shape);
    std::array<std::uint32_t, 8> linear{};
    for (std::size_t first = 0; first < cells->size(); first += stride) {
      for (std::size_t i = 0; i < stride; ++i) linear[i] = nodes_[(*cells)[first + i]];
      splitter.split(kind.shape, std::span(linear).first(stride));
    }
    return {};
  }

  /// Where the file gives a degree for each direction of a cell.
  [[nodiscard]] bool same_degrees(vtkIdType cell) const {
    vtkDataArray* degrees = data_.GetCellData()->GetArray("HigherOrderDegrees");
    if (!degrees) return true;
    if (degrees->GetNumberOfComponents() != 3 || cell >= degrees->GetNumberOfTuples()) return false;
    const double* degree = degrees->GetTuple3(cell);
    return degree[0] == degree[1] && degree[1] == degree[2];
  }

  /// Into nodes_: a cell's points, or a polyhedron's faces as "count, points, count, points, ...".
  Status load_nodes(vtkIdType cell, const CellKind& kind) {
    nodes_.clear();
    if (kind.role == CellRole::polyhedron) return load_faces(cell);
    vtkIdType count = 0;
    const vtkIdType* ids = nullptr;
    if (grid_) {
      grid_->GetCells()->GetCellAtId(cell, count, ids);
    } else {
      data_.GetCellPoints(cell, id_list_);
      count = id_list_->GetNumberOfIds();
      ids = id_list_->GetPointer(0);
    }
    for (vtkIdType i = 0; i < count; ++i) SPLATVOL_TRY(append_node(cell, ids[i]));
    return {};
  }

  Status load_faces(vtkIdType cell) {
    vtkIdTypeArray* stream = grid_ ? grid_->GetFaces() : nullptr;
    vtkIdTypeArray* locations = grid_ ? grid_->GetFaceLocations() : nullptr;
    const auto fail_stream = [&] {
      return fail(ErrorCode::invalid_data, "{}: the faces of polyhedron {} are missing or damaged", path_, cell);
    };
    if (!stream || !locations || cell >= locations->GetNumberOfValues()) return fail_stream();
    const vtkIdType end = stream->GetNumberOfValues();
    vtkIdType at = locations->GetValue(cell);
    if (at < 0 || at >= end) return fail_stream();
    for (vtkIdType faces = stream->GetValue(at++); faces > 0; --faces) {
      if (at >= end) return fail_stream();
      const vtkIdType count = stream->GetValue(at++);
      if (count < 3 || count > end - at) return fail_stream();
      nodes_.push_back(static_cast<std::uint32_t>(count));
      for (vtkIdType i = 0; i < count; ++i) SPLATVOL_TRY(append_node(cell, stream->GetValue(at++)));
    }
    return nodes_.empty() ? fail_stream() : Status{};
  }

  Status append_node(vtkIdType cell, vtkIdType point) {
    if (point < 0 || point >= data_.GetNumberOfPoints())
      return fail(ErrorCode::invalid_data, "{}: cell {} names point {} of {}", path_, cell, point,
                  data_.GetNumberOfPoints());
    nodes_.push_back(static_cast<std::uint32_t>(point));
    return {};
  }

  template <class Visit>
  void for_each_node(const CellKind& kind, const Visit& visit) const {
    if (kind.role != CellRole::polyhedron) std::ranges::for_each(nodes_, visit);
    if (kind.role != CellRole::polyhedron) return;
    for (std::size_t at = 0; at < nodes_.size(); at += nodes_[at] + 1)
      std::ranges::for_each(std::span(nodes_).subspan(at + 1, nodes_[at]), visit);
  }

  [[nodiscard]] bool is_hidden(vtkIdType cell, const CellKind& kind) const {
    constexpr int skipped = vtkDataSetAttributes::DUPLICATECELL | vtkDataSetAttributes::HIDDENCELL;
    if (cell_ghosts_ && cell_ghosts_->GetValue(cell) & skipped) return true;
    if (!point_ghosts_) return false;
    bool hidden = false;
    for_each_node(kind, [&](std::uint32_t node) {
      hidden = hidden || (point_ghosts_->GetValue(node) & vtkDataSetAttributes::HIDDENPOINT);
    });
    return hidden;
  }

  void mark_nodes(const CellKind& kind, Use use) {
    for_each_node(kind, [&](std::uint32_t node) { use_[node] = std::max(use_[node], use); });
  }

  /// Points are data unless they are hidden, or only ghost copies have a use for them. Points of no cell at all stay.
  [[nodiscard]] bool keeps_point(std::size_t point) const {
    if (use_[point] != unused) return use_[point] == by_visible_cells;
    constexpr int skipped = vtkDataSetAttributes::DUPLICATEPOINT | vtkDataSetAttributes::HIDDENPOINT;
    return !point_ghosts_ || !(point_ghosts_->GetValue(static_cast<vtkIdType>(point)) & skipped);
  }

  void drop_points() {
    std::vector<std::uint32_t> new_index(use_.size());
    for (std::size_t i = 0; i < use_.size(); ++i) {
      if (!keeps_point(i)) continue;
      new_index[i] = static_cast<std::uint32_t>(kept_.size());
      kept_.push_back(static_cast<std::uint32_t>(i));
    }
    if (kept_.size() == use_.size()) return;
    for (std::size_t i = 0; i < kept_.size(); ++i) piece_->points[i] = piece_->points[kept_[i]];
    piece_->points.resize(kept_.size());
    for (auto& tetrahedron : piece_->tetrahedra)
      for (std::uint32_t& node : tetrahedron) node = new_index[node];
  }

  Status read_values() {
    for (const Channel& channel : channels_) {
      vtkDataArray* array = data_.GetPointData()->GetArray(channel.array.c_str());
      if (!array || array->GetNumberOfComponents() != channel.components)
        return fail(ErrorCode::invalid_data,
                    "{}: the array \"{}\" ({} components) of the first piece is not in this one", path_, channel.array,
                    channel.components);
      if (array->GetNumberOfTuples() < data_.GetNumberOfPoints())
        return fail(ErrorCode::invalid_data, "{}: the array \"{}\" has {} values for {} points", path_, channel.array,
                    array->GetNumberOfTuples(), data_.GetNumberOfPoints());
      piece_->values.push_back(read_channel(channel, *array));
    }
    return {};
  }

  [[nodiscard]] std::vector<double> read_channel(const Channel& channel, vtkDataArray& array) const {
    std::vector<double> values(kept_.size());
    for (std::size_t i = 0; i < kept_.size(); ++i) {
      double value = 0;
      if (channel.component != Channel::magnitude) {
        value = array.GetComponent(kept_[i], channel.component);
      } else {
        for (int c = 0; c < channel.components; ++c) value = std::hypot(value, array.GetComponent(kept_[i], c));
      }
      values[i] = std::isfinite(value) ? value : std::numeric_limits<double>::quiet_NaN();
    }
    return values;
  }

  const std::string& path_;
  vtkDataSet& data_;
  const std::vector<Channel>& channels_;
  vtkUnstructuredGrid* grid_ = nullptr;  // data_, if it is one
  vtkUnsignedCharArray* cell_ghosts_ = nullptr;
  vtkUnsignedCharArray* point_ghosts_ = nullptr;

  std::unique_ptr<Piece> piece_ = std::make_unique<Piece>();
  std::vector<Use> use_;              // of each point
  std::vector<std::uint32_t> kept_;   // points that stay
  std::vector<std::uint32_t> nodes_;  // of the cell at hand
  vtkNew<vtkIdList> id_list_;
  const CellKind* last_kind_ = nullptr;
  std::uint64_t* kind_count_ = nullptr;
  std::map<std::pair<int, std::size_t>, std::optional<std::vector<std::uint32_t>>> lattice_cells_;
};

class VtkSource final : public Source {
 public:
  explicit VtkSource(std::unique_ptr<DataSets> data_sets) : data_sets_(std::move(data_sets)) {}

  const std::vector<std::string>& attributes() const override { return names_; }
  std::size_t piece_count() const override { return data_sets_->count(); }

  /// Reads the first piece with points, which says what attributes there are. `missing` gets the first selected name
  /// that is not among them.
  Status start(const std::vector<std::string>& selection, std::string& missing) {
    SPLATVOL_TRY(load());
    if (!pending_) return fail(ErrorCode::invalid_data, "{}: the mesh has no points", data_sets_->path());
    const std::vector<Channel> available = channels_of(*pending_);
    if (available.empty() && selection.empty()) return fail_no_point_data(data_sets_->path(), *pending_);
    SPLATVOL_TRY(check_unique(available));
    if (selection.empty()) channels_ = available;
    for (const std::string& name : selection) {
      const auto channel = std::ranges::find(available, name, &Channel::name);
      if (channel == available.end() && missing.empty()) missing = name;
      if (channel != available.end()) channels_.push_back(*channel);
    }
    for (const Channel& channel : channels_) names_.push_back(channel.name);
    return {};
  }

  Result<std::unique_ptr<Piece>> next() override {
    if (!pending_) SPLATVOL_TRY(load());
    if (!pending_) return std::unique_ptr<Piece>();
    const vtkSmartPointer<vtkDataSet> data = std::exchange(pending_, nullptr);
    Result<std::unique_ptr<Piece>> piece;
    SPLATVOL_TRY(run_vtk(data_sets_->path(), [&] { piece = PieceMaker(data_sets_->path(), *data, channels_).make(); }));
    return piece;
  }

 private:
  /// Into pending_: the next data set that has points, or none.
  Status load() {
    do {
      SPLATVOL_TRY_ASSIGN(data, data_sets_->next());
      pending_ = data;
    } while (pending_ && pending_->GetNumberOfPoints() == 0);
    return {};
  }

  [[nodiscard]] Status check_unique(const std::vector<Channel>& channels) const {
    std::vector<std::string> names;
    for (const Channel& channel : channels) names.push_back(channel.name);
    std::ranges::sort(names);
    const auto twice = std::ranges::adjacent_find(names);
    if (twice == names.end()) return {};
    return fail(ErrorCode::invalid_data, "{}: two attributes are called \"{}\"", data_sets_->path(), *twice);
  }

  std::unique_ptr<DataSets> data_sets_;
  std::vector<Channel> channels_;
  std::vector<std::string> names_;
  vtkSmartPointer<vtkDataSet> pending_;
};

tl::unexpected<Error> fail_missing(const std::string& path, const std::string& missing,
                                   const std::vector<std::string>& available) {
  return fail(ErrorCode::invalid_argument, "{}: no attribute \"{}\"; there are: {}", path, missing,
              list_names(available));
}

/// Structured grids among the leaves of a tree of blocks.
void collect_blocks(vtkMultiBlockDataSet& tree, std::vector<vtkSmartPointer<vtkDataSet>>& blocks) {
  for (unsigned int i = 0; i < tree.GetNumberOfBlocks(); ++i) {
    vtkDataObject* block = tree.GetBlock(i);
    if (auto* grid = vtkStructuredGrid::SafeDownCast(block)) blocks.emplace_back(grid);
    if (auto* branch = vtkMultiBlockDataSet::SafeDownCast(block)) collect_blocks(*branch, blocks);
  }
}

}  // namespace

Result<std::unique_ptr<Source>> open_vtk_files(std::vector<VtkFile> files, const std::vector<std::string>& selection) {
  auto source = std::make_unique<VtkSource>(std::make_unique<FileDataSets>(files, selection));
  std::string missing;
  SPLATVOL_TRY(source->start(selection, missing));
  if (missing.empty()) return source;

  // Only the selected arrays were read; the message wants them all.
  const std::string path = files.front().path;
  SPLATVOL_TRY_ASSIGN(all, open_vtk_files(std::move(files), {}));
  return fail_missing(path, missing, all->attributes());
}

Result<std::unique_ptr<Source>> open_plot3d(const std::string& grid, const std::string& solution,
                                            const std::vector<std::string>& selection) {
  // VTK can guess the variant too, from the grid's size alone; but of a truncated file it reads dimensions that are not
  // there.
  SPLATVOL_TRY_ASSIGN(grid_file, open_file(grid));
  SPLATVOL_TRY_ASSIGN(solution_file, open_file(solution));
  SPLATVOL_TRY_ASSIGN(format, detect_plot3d(*grid_file, *solution_file));
  constexpr int pressure = 110;
  std::vector<vtkSmartPointer<vtkDataSet>> blocks;
  SPLATVOL_TRY(run_vtk(grid, [&] {
    const vtkNew<vtkMultiBlockPLOT3DReader> reader;
    reader->SetXYZFileName(grid.c_str());
    reader->SetQFileName(solution.c_str());
    reader->SetMultiGrid(format.multi_grid);
    reader->SetHasByteCount(format.record_marks);
    reader->SetByteOrder(format.big_endian ? vtkMultiBlockPLOT3DReader::FILE_BIG_ENDIAN
                                           : vtkMultiBlockPLOT3DReader::FILE_LITTLE_ENDIAN);
    reader->SetIBlanking(format.blanking);
    reader->SetTwoDimensionalGeometry(format.dimensions == 2);
    reader->SetDoublePrecision(format.precision == 8);
    reader->ForceReadOn();
    reader->AddFunction(pressure);
    reader->Update();
    if (reader->GetOutput()) collect_blocks(*reader->GetOutput(), blocks);
  }));
  if (blocks.empty()) return fail(ErrorCode::invalid_data, "{}: the PLOT3D grid has no blocks", grid);
  auto source = std::make_unique<VtkSource>(std::make_unique<Plot3dDataSets>(grid, blocks));
  std::string missing;
  SPLATVOL_TRY(source->start(selection, missing));
  if (missing.empty()) return source;
  VtkSource all(std::make_unique<Plot3dDataSets>(grid, blocks));
  SPLATVOL_TRY(all.start({}, missing));
  return fail_missing(grid, missing, all.attributes());
}

Result<std::vector<std::string>> pvtu_pieces(const std::string& path) {
  std::vector<std::string> pieces;
  SPLATVOL_TRY(run_vtk(path, [&] {
    const auto root = vtkSmartPointer<vtkXMLDataElement>::Take(vtkXMLUtilities::ReadElementFromFile(path.c_str()));
    vtkXMLDataElement* grid = root ? root->FindNestedElementWithName("PUnstructuredGrid") : nullptr;
    const auto folder = std::filesystem::path(path).parent_path();
    for (int i = 0; grid && i < grid->GetNumberOfNestedElements(); ++i) {
      vtkXMLDataElement* element = grid->GetNestedElement(i);
      const char* file = element->GetAttribute("Source");
      if (element->GetName() == std::string("Piece") && file) pieces.push_back((folder / file).string());
    }
  }));
  if (pieces.empty()) return fail(ErrorCode::invalid_data, "{}: damaged, or names no pieces", path);
  return pieces;
}

}  // namespace splatvol
