#include "builder/sources/vtk/blocks.h"

#include <vtkCGNSReader.h>
#include <vtkCellData.h>
#include <vtkCellType.h>
#include <vtkCompositeDataIterator.h>
#include <vtkDataSet.h>
#include <vtkDoubleArray.h>
#include <vtkExodusIIReader.h>
#include <vtkGenericEnSightReader.h>
#include <vtkIdList.h>
#include <vtkInformation.h>
#include <vtkMultiBlockDataSet.h>
#include <vtkNew.h>
#include <vtkOpenFOAMReader.h>
#include <vtkPointData.h>
#include <vtkSmartPointer.h>
#include <vtkStreamingDemandDrivenPipeline.h>
#include <vtkUnsignedCharArray.h>
#include <vtk_cgns.h>
#include <vtk_exodusII.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <limits>
#include <stdexcept>
#include <utility>

#include VTK_CGNS(cgns_io.h)
#include VTK_CGNS(cgnslib.h)
#include "builder/sources/vtk/block_checks.h"
#include "builder/sources/vtk/cells.h"
#include "builder/sources/vtk/channels.h"
#include "builder/sources/vtk/messages.h"
#include "builder/sources/vtk/trial.h"

namespace splatvol {
namespace {

struct ArrayShape {
  std::string name;
  int components = 1;
};

/// What differs between the formats. Its functions run inside run_vtk, in the order in which they stand here.
class BlockReader {
 public:
  virtual ~BlockReader() = default;
  virtual vtkMultiBlockDataSetAlgorithm& open(const std::string& path) = 0;

  /// After the file's header has been read: which arrays and blocks are wanted.
  virtual void select(const std::vector<std::string>& selection) = 0;

  /// All arrays of a file that is read in several parts, before any of them is; else none need be named.
  virtual std::vector<ArrayShape> arrays() { return {}; }

  /// Parts that can be read one by one.
  virtual int parts() { return 1; }

  /// Reads a part into the reader's output, at a time or at the only one.
  virtual void read(int part, std::optional<double> time) = 0;

 protected:
  static void update(vtkAlgorithm& reader, std::optional<double> time, int piece, int pieces) {
    time ? reader.UpdateTimeStep(*time, piece, pieces) : reader.UpdatePiece(piece, pieces, 0);
  }
};

class ExodusReader final : public BlockReader {
 public:
  vtkMultiBlockDataSetAlgorithm& open(const std::string& path) override {
    reader_->SetFileName(path.c_str());
    reader_->GenerateObjectIdCellArrayOff();
    ex_opts(EX_DEFAULT);  // or the library prints its errors
    return *reader_;
  }

  void select(const std::vector<std::string>& selection) override {
    for (const int type : {vtkExodusIIReader::NODAL, vtkExodusIIReader::ELEM_BLOCK})
      for (int i = 0; i < reader_->GetNumberOfObjectArrays(type); ++i)
        reader_->SetObjectArrayStatus(type, i, wants_array(selection, reader_->GetObjectArrayName(type, i)));
    for (const int type : {vtkExodusIIReader::EDGE_BLOCK, vtkExodusIIReader::FACE_BLOCK, vtkExodusIIReader::NODE_SET,
                           vtkExodusIIReader::EDGE_SET, vtkExodusIIReader::FACE_SET, vtkExodusIIReader::SIDE_SET,
                           vtkExodusIIReader::ELEM_SET})
      for (int i = 0; i < reader_->GetNumberOfObjects(type); ++i) reader_->SetObjectStatus(type, i, 0);
  }

  std::vector<ArrayShape> arrays() override {
    std::vector<ArrayShape> shapes;
    for (const int type : {vtkExodusIIReader::NODAL, vtkExodusIIReader::ELEM_BLOCK})
      for (int i = 0; i < reader_->GetNumberOfObjectArrays(type); ++i)
        shapes.push_back({reader_->GetObjectArrayName(type, i), reader_->GetNumberOfObjectArrayComponents(type, i)});
    return shapes;
  }

  int parts() override { return reader_->GetNumberOfObjects(vtkExodusIIReader::ELEM_BLOCK); }

  void read(int part, std::optional<double> time) override {
    for (int block = 0; block < parts(); ++block)
      reader_->SetObjectStatus(vtkExodusIIReader::ELEM_BLOCK, block, block == part);
    update(*reader_, time, 0, 1);
  }

 private:
  vtkNew<vtkExodusIIReader> reader_;
};

class EnSightReader final : public BlockReader {
 public:
  vtkMultiBlockDataSetAlgorithm& open(const std::string& path) override {
    reader_->SetCaseFileName(path.c_str());
    return *reader_;
  }

  void select(const std::vector<std::string>& selection) override {
    for (int i = 0; i < reader_->GetNumberOfPointArrays(); ++i)
      reader_->SetPointArrayStatus(reader_->GetPointArrayName(i),
                                   wants_array(selection, reader_->GetPointArrayName(i)));
    for (int i = 0; i < reader_->GetNumberOfCellArrays(); ++i)
      reader_->SetCellArrayStatus(reader_->GetCellArrayName(i), wants_array(selection, reader_->GetCellArrayName(i)));
  }

  void read(int, std::optional<double> time) override { update(*reader_, time, 0, 1); }

 private:
  vtkNew<vtkGenericEnSightReader> reader_;
};

class OpenFoamReader final : public BlockReader {
 public:
  vtkMultiBlockDataSetAlgorithm& open(const std::string& path) override {
    reader_->SetFileName(path.c_str());
    reader_->CreateCellToPointOff();  // as of the other formats' cells
    reader_->DecomposePolyhedraOff();
    reader_->SkipZeroTimeOff();
    return *reader_;
  }

  /// Of each region the mesh without its patches. Which fields there are differs from step to step, so all are read.
  void select(const std::vector<std::string>&) override {
    for (int i = 0; i < reader_->GetNumberOfPatchArrays(); ++i) {
      const std::string name = reader_->GetPatchArrayName(i);
      reader_->SetPatchArrayStatus(name.c_str(), name == "internalMesh" || name.ends_with("/internalMesh"));
    }
  }

  void read(int, std::optional<double> time) override { update(*reader_, time, 0, 1); }

 private:
  vtkNew<vtkOpenFOAMReader> reader_;
};

/// The fields of all zones, sorted; VTK's reader lists those of the first zone only.
std::vector<std::string> cgns_fields(const std::string& path) {
  std::vector<std::string> names;
  int file = 0, bases = 0;
  if (cg_open(path.c_str(), CG_MODE_READ, &file) != CG_OK)
    throw std::runtime_error(fmt::format("CGNS: {}", cg_get_error()));
  cg_nbases(file, &bases);
  for (int base = 1; base <= bases; ++base) {
    int zones = 0;
    cg_nzones(file, base, &zones);
    for (int zone = 1; zone <= zones; ++zone) {
      int solutions = 0;
      cg_nsols(file, base, zone, &solutions);
      for (int solution = 1; solution <= solutions; ++solution) {
        int fields = 0;
        cg_nfields(file, base, zone, solution, &fields);
        for (int field = 1; field <= fields; ++field) {
          std::array<char, 64> name{};  // 32 at most
          CGNS_ENUMT(DataType_t) type{};
          if (cg_field_info(file, base, zone, solution, field, &type, name.data()) == CG_OK)
            names.emplace_back(name.data());
        }
      }
    }
  }
  cg_close(file);
  std::ranges::sort(names);
  names.erase(std::ranges::unique(names).begin(), names.end());
  return names;
}

class CgnsReader final : public BlockReader {
 public:
  vtkMultiBlockDataSetAlgorithm& open(const std::string& path) override {
    cgio_error_abort(0);          // or the library ends the program at an error
    fields_ = cgns_fields(path);  // fails where VTK's reader would end the program
    reader_->SetFileName(path.c_str());
    reader_->DoublePrecisionMeshOn();
    reader_->LoadBndPatchOff();
    return *reader_;
  }

  /// By VTK's names of arrays, those of zones after the first included.
  void select(const std::vector<std::string>& selection) override {
    reader_->EnableAllBases();
    for (const ArrayShape& shape : arrays()) {
      const bool wanted = wants_array(selection, shape.name);
      reader_->SetPointArrayStatus(shape.name.c_str(), wanted);
      reader_->SetCellArrayStatus(shape.name.c_str(), wanted);
    }
  }

  std::vector<ArrayShape> arrays() override { return merge_vectors(fields_); }

  int parts() override { return parts_; }

  /// The reader shares out zones among the pieces that it is asked for: of enough pieces each is one zone.
  void read(int part, std::optional<double> time) override {
    update(*reader_, time, part, many);
    int zones = 0;
    vtkMultiBlockDataSet* bases = reader_->GetOutput();
    for (unsigned int i = 0; bases && i < bases->GetNumberOfBlocks(); ++i)
      if (auto* base = vtkMultiBlockDataSet::SafeDownCast(bases->GetBlock(i)))
        zones += static_cast<int>(base->GetNumberOfBlocks());
    parts_ = std::max(parts_, zones);
  }

 private:
  static constexpr int many = 1 << 24;

  /// VTK's reader makes one array of three scalars whose names end in X, Y and Z. `names` are sorted.
  static std::vector<ArrayShape> merge_vectors(const std::vector<std::string>& names) {
    std::vector<ArrayShape> shapes;
    for (std::size_t i = 0; i < names.size(); ++i) {
      const std::string stem = names[i].substr(0, names[i].size() - 1);
      const bool vector =
          i + 2 < names.size() && names[i] == stem + "X" && names[i + 1] == stem + "Y" && names[i + 2] == stem + "Z";
      shapes.push_back(vector ? ArrayShape{stem, 3} : ArrayShape{names[i], 1});
      if (vector) i += 2;
    }
    return shapes;
  }

  vtkNew<vtkCGNSReader> reader_;
  std::vector<std::string> fields_;
  int parts_ = 1;  // until the first has been read
};

std::unique_ptr<BlockReader> make_reader(VtkFile::Kind kind) {
  switch (kind) {
    case VtkFile::Kind::exodus:
      return std::make_unique<ExodusReader>();
    case VtkFile::Kind::ensight:
      return std::make_unique<EnSightReader>();
    case VtkFile::Kind::openfoam:
      return std::make_unique<OpenFoamReader>();
    case VtkFile::Kind::cgns:
      return std::make_unique<CgnsReader>();
    default:
      return nullptr;
  }
}

bool has_volume(vtkDataSet& data, vtkIdType cell) {
  const CellKind* kind = find_cell_kind(data.GetCellType(cell));
  return !kind || kind->role != CellRole::no_volume;
}

/// Whether a block has cells with an area, and none with a volume.
bool is_surface(vtkDataSet& data) {
  bool area = false;
  for (vtkIdType cell = 0; cell < data.GetNumberOfCells(); ++cell) {
    if (has_volume(data, cell)) return false;
    area = area || data.GetCellType(cell) >= VTK_TRIANGLE;
  }
  return area;
}

/// The cells round each point, counted once, for all arrays.
class CellAverages {
 public:
  explicit CellAverages(vtkDataSet& data) : data_(data) {
    const vtkIdType cells = data.GetNumberOfCells();
    bool volume = false;
    for (vtkIdType cell = 0; cell < cells && !volume; ++cell) volume = has_volume(data, cell);
    vtkUnsignedCharArray* ghosts = data.GetCellGhostArray();
    const bool whole_ghosts = ghosts && ghosts->GetNumberOfValues() >= cells;
    used_.resize(static_cast<std::size_t>(cells));
    for (vtkIdType cell = 0; cell < cells; ++cell) {
      const bool hidden = whole_ghosts && (ghosts->GetValue(cell) & vtkDataSetAttributes::HIDDENCELL) != 0;
      used_[static_cast<std::size_t>(cell)] = !hidden && (!volume || has_volume(data, cell));
    }
  }

  /// NaN at points of no cell with a finite value.
  vtkSmartPointer<vtkDoubleArray> operator()(vtkDataArray& values) const {
    const int components = values.GetNumberOfComponents();
    auto means = vtkSmartPointer<vtkDoubleArray>::New();
    means->SetName(values.GetName());
    means->SetNumberOfComponents(components);
    means->SetNumberOfTuples(data_.GetNumberOfPoints());
    means->Fill(0);
    std::vector<std::uint32_t> counts(static_cast<std::size_t>(data_.GetNumberOfPoints()));
    for (int c = 0; c < components; ++c) average(values, c, *means, counts);
    return means;
  }

 private:
  void average(vtkDataArray& values, int component, vtkDoubleArray& means, std::vector<std::uint32_t>& counts) const {
    std::ranges::fill(counts, 0u);
    const vtkNew<vtkIdList> nodes;
    for (vtkIdType cell = 0; cell < data_.GetNumberOfCells(); ++cell) {
      const double value = values.GetComponent(cell, component);
      if (!used_[static_cast<std::size_t>(cell)] || !std::isfinite(value)) continue;
      data_.GetCellPoints(cell, nodes);
      for (vtkIdType i = 0; i < nodes->GetNumberOfIds(); ++i) {
        const vtkIdType node = nodes->GetId(i);
        if (node < 0 || node >= data_.GetNumberOfPoints()) continue;  // refused when the cells are split
        means.SetTypedComponent(node, component, means.GetTypedComponent(node, component) + value);
        ++counts[static_cast<std::size_t>(node)];
      }
    }
    for (vtkIdType point = 0; point < data_.GetNumberOfPoints(); ++point)
      means.SetTypedComponent(point, component,
                              means.GetTypedComponent(point, component) / counts[static_cast<std::size_t>(point)]);
  }

  vtkDataSet& data_;
  std::vector<bool> used_;  // of each cell
};

/// Where there is a point array of the name, it is the better one.
void move_cell_data(vtkDataSet& data, const std::vector<std::string>& selection) {
  vtkCellData& cells = *data.GetCellData();
  std::optional<CellAverages> averages;
  for (int i = 0; i < cells.GetNumberOfArrays(); ++i) {
    vtkDataArray* array = cells.GetArray(i);
    if (!array || !cells.GetArrayName(i)) continue;
    const std::string name = cells.GetArrayName(i);
    if (is_bookkeeping(cells, i, name) || name == "HigherOrderDegrees" || !wants_array(selection, name)) continue;
    if (data.GetPointData()->HasArray(name.c_str()) || array->GetNumberOfTuples() < data.GetNumberOfCells()) continue;
    if (!averages) averages.emplace(data);
    data.GetPointData()->AddArray((*averages)(*array));
  }
}

void add_missing(vtkDataSet& data, const std::vector<ArrayShape>& shapes) {
  for (const ArrayShape& shape : shapes) {
    if (data.GetPointData()->HasArray(shape.name.c_str())) continue;
    const vtkNew<vtkDoubleArray> array;
    array->SetName(shape.name.c_str());
    array->SetNumberOfComponents(shape.components);
    array->SetNumberOfTuples(data.GetNumberOfPoints());
    array->Fill(std::numeric_limits<double>::quiet_NaN());
    data.GetPointData()->AddArray(array);
  }
}

/// The steps that a reader found in its file.
std::vector<double> times_of(vtkAlgorithm& algorithm) {
  vtkInformation* information = algorithm.GetOutputInformation(0);
  const int count = information->Length(vtkStreamingDemandDrivenPipeline::TIME_STEPS());
  const double* first = information->Get(vtkStreamingDemandDrivenPipeline::TIME_STEPS());
  return count > 0 ? std::vector<double>(first, first + count) : std::vector<double>();
}

std::optional<TimeStep> choose_step(const std::vector<double>& times, std::optional<double> time) {
  if (times.empty()) return std::nullopt;
  std::size_t best = 0;
  for (std::size_t i = 1; i < times.size(); ++i) {
    const bool better = time ? std::abs(times[i] - *time) < std::abs(times[best] - *time) : times[i] >= times[best];
    if (better) best = i;
  }
  return TimeStep{times[best], best, times.size()};
}

/// Reads a file's header where a crash does no harm. VTK 9.1 trusts whatever EnSight's files say of each other, and
/// reads parts of cut off ones that are not there: such a file is read to its end.
Status try_file(const VtkFile& file, const std::vector<std::string>& selection, std::optional<double> time) {
  constexpr unsigned seconds = 3600;
  return try_in_child(file.path, seconds, [&] {
    const auto reader = make_reader(file.kind);
    vtkAlgorithm& algorithm = reader->open(file.path);
    algorithm.UpdateInformation();
    reader->select(selection);
    const auto step = choose_step(times_of(algorithm), time);
    if (file.kind == VtkFile::Kind::ensight) reader->read(0, step ? std::optional(step->time) : std::nullopt);
  });
}

class BlockDataSets final : public VtkDataSets {
 public:
  BlockDataSets(VtkFile file, std::vector<std::string> selection)
      : file_(std::move(file)), selection_(std::move(selection)), reader_(make_reader(file_.kind)) {}

  Status open(std::optional<double> time) {
    SPLATVOL_TRY(check_blocks(file_));
    vtkMultiBlockDataSetAlgorithm* algorithm = nullptr;
    SPLATVOL_TRY(try_file(file_, selection_, time));
    const QuietStderr quiet;
    SPLATVOL_TRY(run_vtk(file_.path, [&] {
      algorithm = &reader_->open(file_.path);
      algorithm->UpdateInformation();
      reader_->select(selection_);
      step_ = choose_step(times_of(*algorithm), time);
      shapes_ = reader_->arrays();
    }));
    std::erase_if(shapes_, [&](const ArrayShape& shape) { return !wants_array(selection_, shape.name); });
    algorithm_ = algorithm;
    return {};
  }

  std::size_t count() const override {
    return given_ + blocks_.size() + static_cast<std::size_t>(std::max(0, reader_->parts() - part_));
  }
  const std::string& path() const override { return file_.path; }
  std::optional<TimeStep> time_step() const override { return step_; }

  Result<vtkSmartPointer<vtkDataSet>> next() override {
    while (blocks_.empty() && part_ < reader_->parts()) SPLATVOL_TRY(read_part());
    if (blocks_.empty()) return vtkSmartPointer<vtkDataSet>();
    auto block = blocks_.front();
    blocks_.pop_front();
    ++given_;
    return block;
  }

 private:
  /// A part's blocks into blocks_, with all arrays at their points.
  Status read_part() {
    const std::optional<double> time = step_ ? std::optional(step_->time) : std::nullopt;
    SPLATVOL_TRY(run_vtk(file_.path, [&] {
      reader_->read(part_++, time);
      if (auto* tree = vtkMultiBlockDataSet::SafeDownCast(algorithm_->GetOutputDataObject(0))) {
        collect(*tree);
        tree->Initialize();
      }
      for (auto& block : blocks_) move_cell_data(*block, selection_);
      for (auto& block : blocks_) learn_arrays(*block);
      for (auto& block : blocks_) add_missing(*block, shapes_);
    }));
    return {};
  }

  /// Copies that share the arrays: the reader forgets its own before the next part is read.
  void collect(vtkMultiBlockDataSet& tree) {
    const auto leaf = vtkSmartPointer<vtkCompositeDataIterator>::Take(tree.NewIterator());
    for (leaf->InitTraversal(); !leaf->IsDoneWithTraversal(); leaf->GoToNextItem()) {
      auto* data = vtkDataSet::SafeDownCast(leaf->GetCurrentDataObject());
      if (!data || data->GetNumberOfPoints() == 0 || is_surface(*data)) continue;
      vtkSmartPointer<vtkDataSet> copy;
      copy.TakeReference(data->NewInstance());
      copy->ShallowCopy(data);
      blocks_.push_back(copy);
    }
  }

  void learn_arrays(vtkDataSet& data) {
    vtkPointData& arrays = *data.GetPointData();
    for (int i = 0; i < arrays.GetNumberOfArrays(); ++i) {
      vtkDataArray* array = arrays.GetArray(i);
      if (!array || !arrays.GetArrayName(i)) continue;
      const std::string name = arrays.GetArrayName(i);
      if (is_bookkeeping(arrays, i, name) || std::ranges::find(shapes_, name, &ArrayShape::name) != shapes_.end())
        continue;
      shapes_.push_back({name, array->GetNumberOfComponents()});
    }
  }

  VtkFile file_;
  std::vector<std::string> selection_;
  std::unique_ptr<BlockReader> reader_;
  vtkMultiBlockDataSetAlgorithm* algorithm_ = nullptr;  // of reader_
  std::optional<TimeStep> step_;
  std::vector<ArrayShape> shapes_;  // known so far
  int part_ = 0;                    // the next to be read
  std::size_t given_ = 0;
  std::deque<vtkSmartPointer<vtkDataSet>> blocks_;  // read and not given yet
};

}  // namespace

bool wants_array(const std::vector<std::string>& selection, const std::string& array) {
  return selection.empty() || std::ranges::any_of(selection, [&](const std::string& name) {
           return name == array || name.starts_with(array + "[");
         });
}

Result<std::unique_ptr<VtkDataSets>> open_blocks(const VtkFile& file, const std::vector<std::string>& selection,
                                                 std::optional<double> time) {
  auto blocks = std::make_unique<BlockDataSets>(file, selection);
  SPLATVOL_TRY(blocks->open(time));
  return blocks;
}

}  // namespace splatvol
