#include "builder/sources/vtk/block_readers.h"

#include <vtkCGNSReader.h>
#include <vtkDataArray.h>
#include <vtkDataSet.h>
#include <vtkDataSetAttributes.h>
#include <vtkFloatArray.h>
#include <vtkGenericEnSightReader.h>
#include <vtkIdList.h>
#include <vtkMultiBlockDataSet.h>
#include <vtkMultiBlockDataSetAlgorithm.h>
#include <vtkNew.h>
#include <vtkObjectFactory.h>
#include <vtkSmartPointer.h>
#include <vtkUnsignedCharArray.h>
#include <vtk_cgns.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <map>
#include <utility>

#include VTK_CGNS(cgns_io.h)
#include VTK_CGNS(cgnslib.h)
#include "base/file.h"
#include "builder/sources/time_steps.h"
#include "builder/sources/vtk/attributes.h"
#include "builder/sources/vtk/cgns_links.h"
#include "builder/sources/vtk/cgns_patches.h"
#include "builder/sources/vtk/cgns_units.h"
#include "builder/sources/vtk/cgns_zones.h"
#include "builder/sources/vtk/ensight_case.h"
#include "builder/sources/vtk/file_words.h"
#include "builder/sources/vtk/finer_numbers.h"
#include "builder/sources/vtk/hdf5_checks.h"
#include "builder/sources/vtk/messages.h"

namespace splatvol {
namespace {

/// Whether single precision, in which VTK's reader gives points, does not keep those of a case: only text may have more
/// digits. `path`: of the case.
bool has_finer_ensight_points(const std::string& path, std::optional<double> time) {
  const auto text = read_text_file(path);
  if (!text) return false;
  const EnsightCase files(*text);
  if (!files.geometry()) return false;
  const auto step = choose_step(files.times(), time);
  const auto geometry = files.file_at(*files.geometry(), step ? std::optional(step->time) : std::nullopt);
  if (!geometry) return false;
  auto file = open_file(std::filesystem::path(path).parent_path() / geometry->name);
  if (!file) return false;
  FileWords words(std::move(*file));
  const bool binary = words.line().substr(0, 20).find("Binary") != std::string::npos;
  words.line();  // another description
  while (!binary && !words.at_end())
    if (has_finer_number(words.line())) return true;
  return false;
}

class EnSightReader final : public BlockReader {
 public:
  vtkMultiBlockDataSetAlgorithm* open(const std::string& path) override {
    path_ = path;
    reader_->SetCaseFileName(path.c_str());
    return reader_;
  }

  void select(const std::vector<std::string>& selection) override {
    for (int i = 0; i < reader_->GetNumberOfPointArrays(); ++i)
      reader_->SetPointArrayStatus(reader_->GetPointArrayName(i),
                                   wants_array(selection, reader_->GetPointArrayName(i)));
    for (int i = 0; i < reader_->GetNumberOfCellArrays(); ++i)
      reader_->SetCellArrayStatus(reader_->GetCellArrayName(i), wants_array(selection, reader_->GetCellArrayName(i)));
    // Those that are read here.
    std::erase_if(findings_.gaps, [&](const EnsightGaps& gaps) {
      if (!gaps.values.empty()) reader_->SetCellArrayStatus(gaps.variable.c_str(), 0);
      return !wants_array(selection, gaps.variable);
    });
  }

  void set_findings(EnsightFindings findings) override { findings_ = std::move(findings); }
  CellCensus take_changes() override { return std::exchange(changes_, {}); }

  void read(int, std::optional<double> time) override {
    update(*reader_, time, 0, 1);
    for (const auto& [part, ghosts] : findings_.ghosts) {
      changes_.hidden += ghosts;
      if (vtkDataSet* data = part_of(part)) hide_loose_points(*data);
    }
    for (const EnsightGaps& of_variable : findings_.gaps) {
      for (const auto& [part, values] : of_variable.values) add_values(of_variable, part, values);
      for (const EnsightGaps::Gap& gap : of_variable.gaps) leave_out(of_variable, gap);
    }
  }

  bool rounds_points() const override { return true; }
  bool has_finer_points(std::optional<double> time) override { return has_finer_ensight_points(path_, time); }

 private:
  /// Replaces a value by a missing one, if its variable was read. VTK may order the components of tensors anew.
  void leave_out(const EnsightGaps& variable, const EnsightGaps::Gap& gap) {
    vtkDataSet* part = part_of(gap.part);
    vtkDataArray* array = part ? arrays_of(*part, variable.per_element).GetArray(variable.variable.c_str()) : nullptr;
    const auto index = static_cast<vtkIdType>(gap.index);
    if (!array || index >= array->GetNumberOfTuples()) return;
    const bool ordered = variable.components <= 3 && variable.components == component_count(*array);
    for (std::size_t c = 0; c < component_count(*array); ++c)
      if (!ordered || c == gap.component) array->SetComponent(index, static_cast<int>(c), missing_value);
    ++changes_.unwritten;
  }

  /// Null if VTK's reader gives no such part.
  vtkDataSet* part_of(std::size_t index) {
    vtkMultiBlockDataSet* parts = reader_->GetOutput();
    return parts && index < parts->GetNumberOfBlocks()
               ? vtkDataSet::SafeDownCast(parts->GetBlock(static_cast<unsigned>(index)))
               : nullptr;
  }

  /// Flags the points that no cell uses as copies: ghosts used them.
  static void hide_loose_points(vtkDataSet& part) {
    const vtkNew<vtkUnsignedCharArray> flags;
    flags->SetName(vtkDataSetAttributes::GhostArrayName());
    flags->SetNumberOfTuples(part.GetNumberOfPoints());
    flags->Fill(vtkDataSetAttributes::DUPLICATEPOINT);
    const vtkNew<vtkIdList> points;
    for (vtkIdType cell = 0; cell < part.GetNumberOfCells(); ++cell) {
      part.GetCellPoints(cell, points);
      for (vtkIdType i = 0; i < points->GetNumberOfIds(); ++i) flags->SetValue(points->GetId(i), 0);
    }
    part.GetPointData()->AddArray(flags);
  }

  void add_values(const EnsightGaps& variable, std::size_t index, const std::vector<float>& values) {
    vtkDataSet* part = part_of(index);
    if (!part) return;
    if (values.size() != static_cast<std::size_t>(part->GetNumberOfCells()) * variable.components)
      throw ReaderError("\"{}\" has values of {} cells instead of {}", variable.variable,
                        values.size() / variable.components, part->GetNumberOfCells());
    const vtkNew<vtkFloatArray> array;
    array->SetName(variable.variable.c_str());
    array->SetNumberOfComponents(static_cast<int>(variable.components));
    array->SetNumberOfTuples(part->GetNumberOfCells());
    std::ranges::copy(values, array->GetPointer(0));
    part->GetCellData()->AddArray(array);
  }

  static std::size_t component_count(vtkDataArray& array) {
    return static_cast<std::size_t>(array.GetNumberOfComponents());
  }

  std::string path_;
  vtkNew<vtkGenericEnSightReader> reader_;
  EnsightFindings findings_;
  CellCensus changes_;
};

/// The fields of all zones, sorted; VTK's reader lists only those of the first zone. Adds their units. Fields of
/// neither points nor cells go to `left_out`.
std::vector<std::string> cgns_fields(const std::string& path, std::map<std::string, std::string>& units,
                                     std::set<std::string>& left_out) {
  std::vector<std::string> names;
  int file = 0, bases = 0;
  if (cg_open(path.c_str(), CG_MODE_READ, &file) != CG_OK) throw ReaderError("CGNS: {}", cg_get_error());
  cg_nbases(file, &bases);
  for (int base = 1; base <= bases; ++base) {
    int zones = 0;
    cg_nzones(file, base, &zones);
    for (int zone = 1; zone <= zones; ++zone) {
      int solutions = 0;
      cg_nsols(file, base, zone, &solutions);
      for (int solution = 1; solution <= solutions; ++solution) {
        std::array<char, 64> ignored{};
        CGNS_ENUMT(GridLocation_t) location = CGNS_ENUMV(Vertex);
        cg_sol_info(file, base, zone, solution, ignored.data(), &location);
        const bool is_kept = location == CGNS_ENUMV(Vertex) || location == CGNS_ENUMV(CellCenter);
        int fields = 0;
        cg_nfields(file, base, zone, solution, &fields);
        for (int field = 1; field <= fields; ++field) {
          std::array<char, 64> name{};  // 32 at most
          CGNS_ENUMT(DataType_t) type{};
          if (cg_field_info(file, base, zone, solution, field, &type, name.data()) != CG_OK) continue;
          if (!is_kept) {
            left_out.insert(name.data());
            continue;
          }
          names.emplace_back(name.data());
          const std::string unit = cgns_unit({file, base, zone, solution, field}, names.back());
          if (!unit.empty()) units.emplace(names.back(), unit);
        }
      }
    }
  }
  cg_close(file);
  std::ranges::sort(names);
  names.erase(std::ranges::unique(names).begin(), names.end());
  return names;
}

/// Holds the zones that CgnsZones reads. VTK's pipeline has no part in it.
class ZoneTree final : public vtkMultiBlockDataSetAlgorithm {
 public:
  static ZoneTree* New();
  vtkTypeMacro(ZoneTree, vtkMultiBlockDataSetAlgorithm)

      protected : ZoneTree() {
    SetNumberOfInputPorts(0);
  }
};
vtkStandardNewMacro(ZoneTree);

class CgnsReader final : public BlockReader {
 public:
  vtkMultiBlockDataSetAlgorithm* open(const std::string& path) override {
    cgio_error_abort(0);  // keeps the library from ending the program at an error
    begin_cgns_file();
    check_hdf5_file(path, Hdf5Arrays::all);
    path_ = path;
    fields_ = cgns_fields(path, units_, left_out_);  // throws where VTK's reader would end the program
    left_out_.insert(hidden_cgns_arrays().begin(), hidden_cgns_arrays().end());
    zones_.emplace(path);
    if (zones_->defeats_vtk()) {
      portions_ = zones_->count();
      tree_->UpdateDataObject();
      return tree_;
    }
    zones_.reset();
    reader_->SetFileName(path.c_str());
    reader_->DoublePrecisionMeshOn();
    reader_->LoadBndPatchOff();
    return reader_;
  }

  /// VTK 9.1 gives neither sections of surfaces nor boundary conditions.
  void want_patches() override { patches_ = read_cgns_patches(path_); }
  std::vector<Patch> take_patches() override { return std::exchange(patches_, {}); }

  /// Selects by VTK's names of arrays, including those of zones after the first.
  void select(const std::vector<std::string>& selection) override {
    selection_ = selection;
    reader_->EnableAllBases();
    for (const ArrayShape& shape : arrays({})) {
      const bool wanted = wants_array(selection, shape.name);
      reader_->SetPointArrayStatus(shape.name.c_str(), wanted);
      reader_->SetCellArrayStatus(shape.name.c_str(), wanted);
    }
  }

  std::vector<ArrayShape> arrays(std::optional<double> /*time*/) override {
    std::vector<ArrayShape> shapes = merge_cgns_vectors(fields_);
    for (ArrayShape& shape : shapes) shape.unit = unit(shape.name);
    return shapes;
  }

  std::string unit(const std::string& array) const override {
    const auto scalar = units_.find(array), vector = units_.find(array + "X");
    return scalar != units_.end() ? scalar->second : vector != units_.end() ? vector->second : std::string();
  }

  std::set<std::string> left_out_arrays() const override { return left_out_; }
  std::vector<double> times() const override { return zones_ ? zones_->times() : std::vector<double>(); }
  int portions() override { return portions_; }

  /// VTK's reader divides the zones among the pieces that it is asked for: with enough pieces, each is one zone.
  void read(int portion, std::optional<double> time) override {
    if (zones_) {
      const auto step = choose_step(zones_->times(), time);
      zones_->read(portion, step ? std::optional(step->index) : std::nullopt, selection_, *tree_->GetOutput());
      return;
    }
    update(*reader_, time, portion, many);
    int zones = 0;
    vtkMultiBlockDataSet* bases = reader_->GetOutput();
    for (unsigned int i = 0; bases && i < bases->GetNumberOfBlocks(); ++i)
      if (auto* base = vtkMultiBlockDataSet::SafeDownCast(bases->GetBlock(i)))
        zones += static_cast<int>(base->GetNumberOfBlocks());
    portions_ = std::max(portions_, zones);
  }

 private:
  static constexpr int many = 1 << 24;

  vtkNew<vtkCGNSReader> reader_;
  std::optional<CgnsZones> zones_;  // in place of reader_, if VTK's reader would fail
  vtkNew<ZoneTree> tree_;           // of zones_
  std::vector<std::string> selection_;
  std::vector<std::string> fields_;
  std::set<std::string> left_out_;            // fields of faces
  std::map<std::string, std::string> units_;  // of fields_
  std::string path_;
  std::vector<Patch> patches_;  // not taken yet
  int portions_ = 1;            // the number of zones, once one has been read
};

}  // namespace

std::string BlockReader::block_name(const std::vector<std::string>& path) const {
  std::string name;
  for (const std::string& part : path) name += "/" + part;
  return name;
}

void update(vtkAlgorithm& reader, std::optional<double> time, int piece, int pieces) {
  time ? reader.UpdateTimeStep(*time, piece, pieces) : reader.UpdatePiece(piece, pieces, 0);
}

std::unique_ptr<BlockReader> make_block_reader(VtkFile::Kind kind) {
  switch (kind) {
    case VtkFile::Kind::exodus:
      return make_exodus_reader();
    case VtkFile::Kind::ensight:
      return std::make_unique<EnSightReader>();
    case VtkFile::Kind::openfoam:
      return make_openfoam_reader();
    case VtkFile::Kind::cgns:
      return std::make_unique<CgnsReader>();
    default:
      return nullptr;
  }
}

}  // namespace splatvol
