#include "builder/sources/vtk/block_readers.h"

#include <vtkCGNSReader.h>
#include <vtkDataArray.h>
#include <vtkDataSet.h>
#include <vtkDataSetAttributes.h>
#include <vtkExodusIIReader.h>
#include <vtkGenericEnSightReader.h>
#include <vtkMultiBlockDataSet.h>
#include <vtkNew.h>
#include <vtkSmartPointer.h>
#include <vtk_cgns.h>
#include <vtk_exodusII.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <utility>

#include VTK_CGNS(cgns_io.h)
#include VTK_CGNS(cgnslib.h)
#include "builder/sources/vtk/attributes.h"
#include "builder/sources/vtk/cgns_patches.h"
#include "builder/sources/vtk/cgns_units.h"
#include "builder/sources/vtk/hdf5_checks.h"
#include "builder/sources/vtk/messages.h"
#include "builder/sources/vtk/openfoam_reader.h"

namespace splatvol {
namespace {

/// Reads one of `pieces` pieces, at a time if there is one.
void update(vtkAlgorithm& reader, std::optional<double> time, int piece, int pieces) {
  time ? reader.UpdateTimeStep(*time, piece, pieces) : reader.UpdatePiece(piece, pieces, 0);
}

/// Throws if two blocks or sets of one kind have the same id: VTK 9.1 then reads past the end of its list of ids. Ids
/// are 0 in a file that is cut off before them.
void check_exodus_ids(const std::string& path) {
  const std::uintmax_t file_bytes = std::filesystem::file_size(path);
  int real_bytes = 8, stored_real_bytes = 0;
  float version = 0;
  const int file = ex_open(path.c_str(), EX_READ | EX_ALL_INT64_API, &real_bytes, &stored_real_bytes, &version);
  if (file < 0) return;  // VTK's reader reports it
  bool unique = true;
  for (const auto& [type, count_of_type] : {std::pair{EX_ELEM_BLOCK, EX_INQ_ELEM_BLK},
                                            {EX_EDGE_BLOCK, EX_INQ_EDGE_BLK},
                                            {EX_FACE_BLOCK, EX_INQ_FACE_BLK},
                                            {EX_NODE_SET, EX_INQ_NODE_SETS},
                                            {EX_EDGE_SET, EX_INQ_EDGE_SETS},
                                            {EX_FACE_SET, EX_INQ_FACE_SETS},
                                            {EX_SIDE_SET, EX_INQ_SIDE_SETS},
                                            {EX_ELEM_SET, EX_INQ_ELEM_SETS}}) {
    const auto count = ex_inquire_int(file, count_of_type);
    if (count < 2 || static_cast<std::uintmax_t>(count) > file_bytes) continue;
    std::vector<std::int64_t> ids(static_cast<std::size_t>(count));
    if (ex_get_ids(file, type, ids.data()) < 0) continue;
    std::ranges::sort(ids);
    unique = unique && std::ranges::adjacent_find(ids) == ids.end();
  }
  ex_close(file);
  if (!unique) throw ReaderError("Exodus: two blocks or two sets have the same id");
}

class ExodusReader final : public BlockReader {
 public:
  vtkMultiBlockDataSetAlgorithm& open(const std::string& path) override {
    reader_->SetFileName(path.c_str());
    reader_->GenerateObjectIdCellArrayOff();
    ex_opts(EX_DEFAULT);  // keeps the library from printing its errors
    check_hdf5_file(path, Hdf5Arrays::any);
    check_exodus_ids(path);
    return *reader_;
  }

  void select(const std::vector<std::string>& selection) override {
    for (const int type : {vtkExodusIIReader::NODAL, vtkExodusIIReader::ELEM_BLOCK})
      for (int i = 0; i < reader_->GetNumberOfObjectArrays(type); ++i)
        reader_->SetObjectArrayStatus(type, i, wants_array(selection, reader_->GetObjectArrayName(type, i)));
    select_others(false);
  }

  void want_patches() override { wants_patches_ = true; }

  /// Chooses among all but the blocks of cells: the side sets, or nothing.
  void select_others(bool side_sets) {
    for (const int type : {vtkExodusIIReader::EDGE_BLOCK, vtkExodusIIReader::FACE_BLOCK, vtkExodusIIReader::NODE_SET,
                           vtkExodusIIReader::EDGE_SET, vtkExodusIIReader::FACE_SET, vtkExodusIIReader::SIDE_SET,
                           vtkExodusIIReader::ELEM_SET})
      for (int i = 0; i < reader_->GetNumberOfObjects(type); ++i)
        reader_->SetObjectStatus(type, i, side_sets && type == vtkExodusIIReader::SIDE_SET);
  }

  std::vector<ArrayShape> arrays() override {
    std::vector<ArrayShape> shapes;
    for (const int type : {vtkExodusIIReader::NODAL, vtkExodusIIReader::ELEM_BLOCK})
      for (int i = 0; i < reader_->GetNumberOfObjectArrays(type); ++i)
        shapes.push_back({reader_->GetObjectArrayName(type, i), reader_->GetNumberOfObjectArrayComponents(type, i),
                          type == vtkExodusIIReader::ELEM_BLOCK});
    return shapes;
  }

  int portions() override { return reader_->GetNumberOfObjects(vtkExodusIIReader::ELEM_BLOCK); }

  void read(int portion, std::optional<double> time) override {
    for (int block = 0; block < portions(); ++block)
      reader_->SetObjectStatus(vtkExodusIIReader::ELEM_BLOCK, block, block == portion);
    select_others(wants_patches_ && portion == 0);
    update(*reader_, time, 0, 1);
  }

 private:
  bool wants_patches_ = false;
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

  void set_gaps(std::vector<EnsightGaps> gaps) override { gaps_ = std::move(gaps); }
  CellCensus take_changes() override { return std::exchange(changes_, {}); }

  void read(int, std::optional<double> time) override {
    update(*reader_, time, 0, 1);
    for (const EnsightGaps& of_variable : gaps_)
      for (const EnsightGaps::Gap& gap : of_variable.gaps) leave_out(of_variable, gap);
  }

 private:
  /// Replaces a value by a missing one, if its variable was read. VTK may order the components of tensors anew.
  void leave_out(const EnsightGaps& variable, const EnsightGaps::Gap& gap) {
    vtkMultiBlockDataSet* parts = reader_->GetOutput();
    auto* part = parts && gap.part < parts->GetNumberOfBlocks()
                     ? vtkDataSet::SafeDownCast(parts->GetBlock(static_cast<unsigned>(gap.part)))
                     : nullptr;
    vtkDataArray* array = part ? arrays_of(*part, variable.per_element).GetArray(variable.variable.c_str()) : nullptr;
    const auto index = static_cast<vtkIdType>(gap.index);
    if (!array || index >= array->GetNumberOfTuples()) return;
    const bool ordered = variable.components <= 3 && variable.components == component_count(*array);
    for (std::size_t c = 0; c < component_count(*array); ++c)
      if (!ordered || c == gap.component) array->SetComponent(index, static_cast<int>(c), missing_value);
    ++changes_.unwritten;
  }

  static std::size_t component_count(vtkDataArray& array) {
    return static_cast<std::size_t>(array.GetNumberOfComponents());
  }

  vtkNew<vtkGenericEnSightReader> reader_;
  std::vector<EnsightGaps> gaps_;
  CellCensus changes_;
};

class OpenFoamReader final : public BlockReader {
 public:
  vtkMultiBlockDataSetAlgorithm& open(const std::string& path) override {
    processors_ = find_processors(path);  // throws
    if (!processors_.empty()) reader_->set_processor(processors_.front());
    reader_->SetFileName(path.c_str());
    reader_->CreateCellToPointOff();  // PieceMaker does so for all formats
    reader_->DecomposePolyhedraOff();
    reader_->SkipZeroTimeOff();
    reader_->AddDimensionsToArrayNamesOn();
    return *reader_;
  }

  void want_patches() override { wants_patches_ = true; }

  /// Patches between processors lie inside. Those of a region have the name of the region in front.
  std::string patch_name(const std::vector<std::string>& path) const override {
    if (path.back().starts_with("procBoundary")) return {};
    return path.size() > 2 ? path.front() + "/" + path.back() : path.back();
  }

  /// Chooses the mesh of each region, and its patches if they are wanted. Fields may differ between time steps, so all
  /// are read.
  void select(const std::vector<std::string>&) override {
    for (int i = 0; i < reader_->GetNumberOfPatchArrays(); ++i) {
      const std::string name = reader_->GetPatchArrayName(i);
      const bool is_patch = name.starts_with("patch/") || name.find("/patch/") != std::string::npos;
      reader_->SetPatchArrayStatus(
          name.c_str(), name == "internalMesh" || name.ends_with("/internalMesh") || (wants_patches_ && is_patch));
    }
  }

  int portions() override { return std::max<int>(1, static_cast<int>(processors_.size())); }
  bool portions_share_points() const override { return processors_.size() > 1; }
  std::string unit(const std::string& array) const override {
    const auto found = units_.find(array);
    return found == units_.end() ? std::string() : found->second;
  }

  void read(int portion, std::optional<double> time) override {
    if (!processors_.empty()) {
      reader_->set_processor(processors_[static_cast<std::size_t>(portion)]);
      reader_->UpdateInformation();
      select({});
      check_openfoam_time(*reader_, time);
    }
    update(*reader_, time, 0, 1);
    take_openfoam_units(*reader_, units_);
  }

 private:
  bool wants_patches_ = false;
  vtkNew<ProcessorReader> reader_;
  std::vector<std::string> processors_;  // folders of a decomposed case; none: the case itself is read
  std::map<std::string, std::string> units_;
};

/// The fields of all zones, sorted; VTK's reader lists only those of the first zone. Adds their units.
std::vector<std::string> cgns_fields(const std::string& path, std::map<std::string, std::string>& units) {
  std::vector<std::string> names;
  int file = 0, bases = 0;
  if (cg_open(path.c_str(), CG_MODE_READ, &file) != CG_OK) throw ReaderError(fmt::format("CGNS: {}", cg_get_error()));
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
          if (cg_field_info(file, base, zone, solution, field, &type, name.data()) != CG_OK) continue;
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

class CgnsReader final : public BlockReader {
 public:
  vtkMultiBlockDataSetAlgorithm& open(const std::string& path) override {
    cgio_error_abort(0);  // keeps the library from ending the program at an error
    check_hdf5_file(path, Hdf5Arrays::all);
    path_ = path;
    fields_ = cgns_fields(path, units_);  // throws where VTK's reader would end the program
    reader_->SetFileName(path.c_str());
    reader_->DoublePrecisionMeshOn();
    reader_->LoadBndPatchOff();
    return *reader_;
  }

  /// VTK 9.1 gives neither sections of surfaces nor boundary conditions.
  void want_patches() override { patches_ = read_cgns_patches(path_); }
  std::vector<Patch> take_patches() override { return std::exchange(patches_, {}); }

  /// Selects by VTK's names of arrays, including those of zones after the first.
  void select(const std::vector<std::string>& selection) override {
    reader_->EnableAllBases();
    for (const ArrayShape& shape : arrays()) {
      const bool wanted = wants_array(selection, shape.name);
      reader_->SetPointArrayStatus(shape.name.c_str(), wanted);
      reader_->SetCellArrayStatus(shape.name.c_str(), wanted);
    }
  }

  std::vector<ArrayShape> arrays() override { return merge_vectors(fields_); }

  std::string unit(const std::string& array) const override {
    const auto scalar = units_.find(array), vector = units_.find(array + "X");
    return scalar != units_.end() ? scalar->second : vector != units_.end() ? vector->second : std::string();
  }

  int portions() override { return portions_; }

  /// VTK's reader divides the zones among the pieces that it is asked for: with enough pieces, each is one zone.
  void read(int portion, std::optional<double> time) override {
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

  /// Merges three scalars whose names end in X, Y and Z into one array, like VTK's reader. Requires sorted names.
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
  std::map<std::string, std::string> units_;  // of fields_
  std::string path_;
  std::vector<Patch> patches_;  // not taken yet
  int portions_ = 1;            // the number of zones, once one has been read
};

}  // namespace

std::unique_ptr<BlockReader> make_block_reader(VtkFile::Kind kind) {
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

}  // namespace splatvol
