#include "builder/sources/cgns/cgns_reader.h"

#include <fmt/format.h>
#include <vtkCGNSReader.h>
#include <vtkCompositeDataIterator.h>
#include <vtkDataSet.h>
#include <vtkDataSetAttributes.h>
#include <vtkMultiBlockDataSet.h>
#include <vtkMultiBlockDataSetAlgorithm.h>
#include <vtkNew.h>
#include <vtkSmartPointer.h>
#include <vtk_cgns.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string_view>
#include <utility>

#include VTK_CGNS(cgns_io.h)
#include VTK_CGNS(cgnslib.h)
#include "builder/sources/cell_counts.h"
#include "builder/sources/cgns/cgns_links.h"
#include "builder/sources/cgns/cgns_patches.h"
#include "builder/sources/cgns/cgns_zones.h"
#include "builder/sources/hdf5/hdf5_checks.h"
#include "builder/sources/hdf5/netcdf_checks.h"
#include "builder/sources/read_text.h"
#include "builder/sources/reader_error.h"
#include "builder/sources/time_steps.h"
#include "builder/sources/units.h"
#include "builder/sources/vtk/block_reader.h"

namespace splatvol {
namespace {

/// A field of an open CGNS file, by the numbers of the library.
struct CgnsField {
  int file, base, zone, solution, field;
};

/// Exponents of mass, length, time, temperature and angle.
using Exponents = std::array<double, 5>;

struct NamedExponents {
  std::string_view name;
  Exponents exponents;
};

/// The standard's exponents for its own names (SIDS, annex A). A name may go on with X, Y, Z or Magnitude.
constexpr std::array<NamedExponents, 16> standard_exponents = {{{"Density", {1, -3, 0, 0, 0}},
                                                                {"EnergyInternal", {0, 2, -2, 0, 0}},
                                                                {"EnergyKinetic", {0, 2, -2, 0, 0}},
                                                                {"EnergyStagnationDensity", {1, -1, -2, 0, 0}},
                                                                {"Enthalpy", {0, 2, -2, 0, 0}},
                                                                {"Momentum", {1, -2, -1, 0, 0}},
                                                                {"Pressure", {1, -1, -2, 0, 0}},
                                                                {"PressureStagnation", {1, -1, -2, 0, 0}},
                                                                {"Temperature", {0, 0, 0, 1, 0}},
                                                                {"TemperatureStagnation", {0, 0, 0, 1, 0}},
                                                                {"TurbulentEnergyKinetic", {0, 2, -2, 0, 0}},
                                                                {"Velocity", {0, 1, -1, 0, 0}},
                                                                {"VelocitySound", {0, 1, -1, 0, 0}},
                                                                {"ViscosityKinematic", {0, 2, -1, 0, 0}},
                                                                {"ViscosityMolecular", {1, -1, -1, 0, 0}},
                                                                {"Vorticity", {0, 0, -1, 0, 0}}}};

std::optional<Exponents> exponents_by_name(std::string_view name) {
  for (const auto& [known, exponents] : standard_exponents) {
    if (!name.starts_with(known)) continue;
    const std::string_view rest = name.substr(known.size());
    if (rest.empty() || rest == "X" || rest == "Y" || rest == "Z" || rest == "Magnitude") return exponents;
  }
  return std::nullopt;
}

/// Moves to a node above the field, or to the field itself: level 0 is the base, level 3 the field.
bool go_to(const CgnsField& at, int level) {
  switch (level) {
    case 0:
      return cg_goto(at.file, at.base, "end") == CG_OK;
    case 1:
      return cg_goto(at.file, at.base, "Zone_t", at.zone, "end") == CG_OK;
    case 2:
      return cg_goto(at.file, at.base, "Zone_t", at.zone, "FlowSolution_t", at.solution, "end") == CG_OK;
    default:
      return cg_goto(at.file, at.base, "Zone_t", at.zone, "FlowSolution_t", at.solution, "DataArray_t", at.field,
                     "end") == CG_OK;
  }
}

/// The symbols of base units; empty where the file names none.
using Symbols = std::array<std::string_view, 5>;

/// The symbol of a unit, by its number in the library's list; 0 and 1: none.
std::string_view symbol_of(int unit, std::initializer_list<std::string_view> symbols) {
  const auto index = static_cast<std::size_t>(unit - 2);
  return unit >= 2 && index < symbols.size() ? symbols.begin()[index] : std::string_view();
}
static_assert(CGNS_ENUMV(Kilogram) == 2 && CGNS_ENUMV(Meter) == 2 && CGNS_ENUMV(Second) == 2 &&
              CGNS_ENUMV(Kelvin) == 2 && CGNS_ENUMV(Degree) == 2);

/// Reads the units of the current node, if it has any.
std::optional<Symbols> read_symbols() {
  CGNS_ENUMT(MassUnits_t) mass{};
  CGNS_ENUMT(LengthUnits_t) length{};
  CGNS_ENUMT(TimeUnits_t) time{};
  CGNS_ENUMT(TemperatureUnits_t) temperature{};
  CGNS_ENUMT(AngleUnits_t) angle{};
  if (cg_units_read(&mass, &length, &time, &temperature, &angle) != CG_OK) return std::nullopt;
  return Symbols{symbol_of(mass, {"kg", "g", "slug", "lb"}), symbol_of(length, {"m", "cm", "mm", "ft", "in"}),
                 symbol_of(time, {"s"}), symbol_of(temperature, {"K", "degC", "degR", "degF"}),
                 symbol_of(angle, {"deg", "rad"})};
}

/// Reads the exponents of the current node, if it has any.
std::optional<Exponents> read_exponents() {
  CGNS_ENUMT(DataType_t) type{};
  if (cg_exponents_info(&type) != CG_OK) return std::nullopt;
  Exponents exponents{};
  if (type == CGNS_ENUMV(RealDouble))
    return cg_exponents_read(exponents.data()) == CG_OK ? std::optional(exponents) : std::nullopt;
  std::array<float, 5> single{};
  if (type != CGNS_ENUMV(RealSingle) || cg_exponents_read(single.data()) != CG_OK) return std::nullopt;
  std::copy(single.begin(), single.end(), exponents.begin());
  return exponents;
}

/// Returns the unit of a field, from the data class, the dimensional units and the exponents that hold for it. If the
/// field has no exponents, takes those that the standard gives its name. Empty if the field is not dimensional, or if
/// the file does not tell.
std::string cgns_unit(const CgnsField& field, const std::string& name) {
  CGNS_ENUMT(DataClass_t) data_class = CGNS_ENUMV(Dimensional);  // if no node tells
  std::optional<Symbols> symbols;
  std::optional<Exponents> exponents;
  for (int level = 0; level < 4; ++level) {  // a lower node overrides a higher one
    if (!go_to(field, level)) return {};
    CGNS_ENUMT(DataClass_t) own{};
    if (cg_dataclass_read(&own) == CG_OK) data_class = own;
    if (const auto found = read_symbols()) symbols = found;
    if (level == 3) exponents = read_exponents();
  }
  if (!exponents) exponents = exponents_by_name(name);
  if (data_class != CGNS_ENUMV(Dimensional) || !symbols || !exponents) return {};
  std::array<UnitPower, 5> powers;
  for (std::size_t i = 0; i < powers.size(); ++i) {
    if ((*exponents)[i] != 0 && (*symbols)[i].empty()) return {};
    powers[i] = {(*symbols)[i], (*exponents)[i]};
  }
  return unit_text(powers);
}

/// Appends the arrays of the current node to `names`.
void add_arrays_here(std::set<std::string>& names) {
  int arrays = 0;
  if (cg_narrays(&arrays) != CG_OK) return;
  for (int array = 1; array <= arrays; ++array) {
    std::array<char, 64> name{};  // 32 at most
    CGNS_ENUMT(DataType_t) type{};
    int dimensions = 0;
    std::array<cgsize_t, 12> size{};
    if (cg_array_info(array, name.data(), &type, &dimensions, size.data()) == CG_OK) names.insert(name.data());
  }
}

/// Adds the arrays of a zone that are no solutions: of discrete data, and of regions in it.
void find_others(int file, int base, int zone, std::set<std::string>& left_out) {
  int discrete = 0, regions = 0;
  cg_ndiscrete(file, base, zone, &discrete);
  for (int data = 1; data <= discrete; ++data)
    if (cg_goto(file, base, "Zone_t", zone, "DiscreteData_t", data, "end") == CG_OK) add_arrays_here(left_out);
  cg_nsubregs(file, base, zone, &regions);
  for (int region = 1; region <= regions; ++region)
    if (cg_goto(file, base, "Zone_t", zone, "ZoneSubRegion_t", region, "end") == CG_OK) add_arrays_here(left_out);
}

/// Finds the units of the fields of all zones. Arrays that are no solutions of points or cells go to `left_out`.
void read_fields(const std::string& path, std::map<std::string, std::string>& units, std::set<std::string>& left_out) {
  int file = 0, bases = 0;
  if (cg_open(path.c_str(), CG_MODE_READ, &file) != CG_OK) throw ReaderError("CGNS: {}", cg_get_error());
  cg_nbases(file, &bases);
  for (int base = 1; base <= bases; ++base) {
    int zones = 0;
    cg_nzones(file, base, &zones);
    for (int zone = 1; zone <= zones; ++zone) {
      find_others(file, base, zone, left_out);
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
          const std::string unit = cgns_unit({file, base, zone, solution, field}, name.data());
          if (!unit.empty()) units.emplace(name.data(), unit);
        }
      }
    }
  }
  cg_close(file);
}

class CgnsReader final : public BlockReader {
 public:
  Status check(const std::string& path, const SourceOptions& /*options*/) override {
    SPLATVOL_TRY_ASSIGN(start, read_text(path, 64));
    if (!is_hdf5(start) && start.find("ADF Database") == std::string::npos)
      return fail(ErrorCode::invalid_data, "{}: not a CGNS file (neither HDF5 nor ADF)", path);
    return check_file_end(path);
  }

  vtkMultiBlockDataSetAlgorithm* open(const std::string& path) override {
    CgnsZones::close_file();
    cgio_error_abort(0);  // keeps the library from ending the program at an error
    begin_cgns_file();
    check_hdf5_file(path, Hdf5Arrays::all);
    path_ = path;
    read_fields(path, units_, left_out_);  // throws where VTK's reader would end the program
    left_out_.insert(hidden_cgns_arrays().begin(), hidden_cgns_arrays().end());
    zones_.emplace(path);
    portions_ = zones_->count();
    reads_meshes_ = zones_->reads_meshes();
    CgnsZones::close_file();
    if (reads_meshes_) return nullptr;
    reader_->SetFileName(path.c_str());
    reader_->DoublePrecisionMeshOn();
    reader_->LoadBndPatchOff();
    return reader_;
  }

  vtkMultiBlockDataSet* output() override { return tree_; }

  /// VTK 9.1 gives neither sections of surfaces nor boundary conditions.
  void want_patches() override {
    CgnsZones::close_file();
    patches_ = read_cgns_patches(path_);
  }
  std::vector<Patch> take_patches() override { return std::exchange(patches_, {}); }

  /// VTK 9.1 takes one solution for each location, and all points for those that it names. So VTK reads meshes here,
  /// and our code the values.
  void select(const std::vector<std::string>& selection) override {
    selection_ = selection;
    reader_->EnableAllBases();
    reader_->DisableAllPointArrays();
    reader_->DisableAllCellArrays();
  }

  std::vector<ArrayShape> arrays(std::optional<double> time) override {
    std::vector<ArrayShape> shapes = zones_->arrays(time);
    for (ArrayShape& shape : shapes) shape.unit = unit(shape.name);
    return shapes;
  }

  DeclaredArrays declared(vtkDataSet& /*data*/) override {
    return {fmt::format("zone {}", zones_->name_of(portion_)), zones_->arrays_of(portion_)};
  }

  std::set<std::string> left_out_arrays() const override { return left_out_; }
  std::vector<double> times() const override { return reads_meshes_ ? zones_->times() : std::vector<double>(); }
  int portions() override { return portions_; }

  CellCensus take_changes() override {
    CellCensus changes;
    changes.losses = zones_->losses();
    return changes;
  }

  /// VTK's reader divides the zones among the pieces that it is asked for: with enough pieces, each is one zone.
  void read(int portion, std::optional<double> time) override {
    portion_ = portion;
    vtkMultiBlockDataSet* output = reads_meshes_ ? tree_.Get() : reader_->GetOutput();
    if (output) output->Initialize();
    if (!zones_->is_there(portion, time)) return;
    const CgnsValues values = take_arrays(portion, time);
    if (reads_meshes_) {
      zones_->read(portion, time, *output);
    } else {
      CgnsZones::close_file();
      update(*reader_, time, portion, many);
      output = reader_->GetOutput();
    }
    const auto entry = vtkSmartPointer<vtkCompositeDataIterator>::Take(output->NewIterator());
    for (entry->InitTraversal(); !entry->IsDoneWithTraversal(); entry->GoToNextItem())
      if (auto* data = vtkDataSet::SafeDownCast(entry->GetCurrentDataObject());
          data && !is_surface(*data_set_of(*data)))
        add_arrays(values, *data);
  }

 private:
  static constexpr int many = 1 << 24;
  static constexpr std::uint64_t ahead_bytes = std::uint64_t{64} << 20;

  /// Returns the arrays of a zone. To open a file takes long, and VTK's reader opens it for each zone: so arrays of the
  /// next zones are read before.
  CgnsValues take_arrays(int zone, std::optional<double> time) {
    std::uint64_t bytes = 0;
    const int end = ahead_.contains(zone) ? zone : reads_meshes_ ? zone + 1 : portions_;
    for (int next = zone; next < end && bytes < ahead_bytes; ++next) {
      CgnsValues& values = ahead_[next] = zones_->read_arrays(next, time, selection_);
      for (const auto& [of_cells, array] : values) bytes += 1024 * std::uint64_t{array->GetActualMemorySize()};
    }
    return std::move(ahead_.extract(zone).mapped());
  }

  [[nodiscard]] std::string unit(const std::string& array) const {
    const std::string field = array.substr(0, array.find(" ("));  // without the name of a solution
    for (const char* end : {"", "X", "_x"})
      if (const auto found = units_.find(field + end); found != units_.end()) return found->second;
    return {};
  }

  void add_arrays(const CgnsValues& values, vtkDataSet& data) const {
    for (const auto& [of_cells, array] : values) {
      const vtkIdType there = of_cells ? data.GetNumberOfCells() : data.GetNumberOfPoints();
      if (there != array->GetNumberOfTuples())
        throw ReaderError("CGNS: the zone {} has {} {}, and {} values of {}", zones_->name_of(portion_), there,
                          of_cells ? "cells" : "points", array->GetNumberOfTuples(), array->GetName());
      arrays_of(data, of_cells).AddArray(array);
    }
  }

  vtkNew<vtkCGNSReader> reader_;
  std::optional<CgnsZones> zones_;
  bool reads_meshes_ = false;          // zones_, as VTK's reader would fail
  vtkNew<vtkMultiBlockDataSet> tree_;  // that they read
  std::vector<std::string> selection_;
  int portion_ = 0;                           // that was read last
  std::map<int, CgnsValues> ahead_;           // arrays of zones to come
  std::set<std::string> left_out_;            // arrays that are no solutions of points or cells
  std::map<std::string, std::string> units_;  // of fields
  std::string path_;
  std::vector<Patch> patches_;  // not taken yet
  int portions_ = 1;            // the number of zones
};

}  // namespace

Result<std::unique_ptr<DataSets>> open_cgns(const InputFile& file, const SourceOptions& options) {
  forbid_hdf5_plugins();
  return open_blocks(file, options, std::make_unique<CgnsReader>());
}

}  // namespace splatvol
