#include "builder/sources/exodus/exodus_reader.h"

#include <fmt/ranges.h>
#include <vtkCellArray.h>
#include <vtkCellData.h>
#include <vtkCompositeDataIterator.h>
#include <vtkDataArray.h>
#include <vtkDoubleArray.h>
#include <vtkExodusIIReader.h>
#include <vtkMultiBlockDataSet.h>
#include <vtkNew.h>
#include <vtkObjectFactory.h>
#include <vtkPointData.h>
#include <vtkPointSet.h>
#include <vtkPoints.h>
#include <vtkSmartPointer.h>
#include <vtkUnstructuredGrid.h>
#include <vtkVersion.h>
#include <vtk_exodusII.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string_view>
#include <utility>

#include "base/printable.h"
#include "builder/sources/cell_counts.h"
#include "builder/sources/hdf5/hdf5_checks.h"
#include "builder/sources/hdf5/netcdf_checks.h"
#include "builder/sources/read_text.h"
#include "builder/sources/source.h"
#include "builder/sources/vtk/block_reader.h"
#include "builder/sources/vtk/data_set.h"
#include "builder/sources/vtk/messages.h"

namespace splatvol {
namespace {

/// Facts of an Exodus file. Numbers of variables and of blocks count from 0, in the order of the file.
struct ExodusHeader {
  struct Block {
    int number = 0;
    std::string type;        // "HEX8"; empty: it has no cells
    std::int64_t nodes = 0;  // of a cell; of polygons and polyhedra: of all
  };
  bool single = false;           // coordinates have 4 bytes
  std::vector<double> times;     // of the steps, if the file leaves their number open (count_open_records)
  std::map<int, Block> blocks;   // by id
  std::set<std::string> values;  // the names of NetCDF's variables with values of Exodus's variables
  std::vector<std::string> nodal, of_elements;  // names of variables
  bool has_nodes = false, has_steps = false;
  bool in_one_array = false;  // an older file: one of them has the values of all variables of the points

  /// Whether a variable that is declared has values: of the points, or of a block's cells.
  [[nodiscard]] bool has_nodal_values(int variable) const {
    return values.contains(in_one_array ? "vals_nod_var" : fmt::format("vals_nod_var{}", variable + 1));
  }
  [[nodiscard]] bool has_element_values(int block, int variable) const {
    return values.contains(fmt::format("vals_elem_var{}eb{}", variable + 1, block + 1));
  }
};

class ExodusFile {
 public:
  explicit ExodusFile(const std::string& path) : bytes_(std::filesystem::file_size(path)) {
    int real_bytes = 8, stored_real_bytes = 0;
    float version = 0;
    id_ = ex_open(path.c_str(), EX_READ | EX_ALL_INT64_API, &real_bytes, &stored_real_bytes, &version);
  }
  ~ExodusFile() {
    if (is_open()) ex_close(id_);
  }
  ExodusFile(const ExodusFile&) = delete;
  ExodusFile& operator=(const ExodusFile&) = delete;

  [[nodiscard]] bool is_open() const { return id_ >= 0; }
  [[nodiscard]] int id() const { return id_; }

  /// The ids of blocks or sets of a kind; none if the file is too small for them. Ids are 0 in a file that is cut off
  /// before them.
  [[nodiscard]] std::vector<std::int64_t> ids(ex_entity_type type, ex_inquiry count_of_type) const {
    const auto count = ex_inquire_int(id_, count_of_type);
    if (count < 1 || static_cast<std::uintmax_t>(count) > bytes_) return {};
    std::vector<std::int64_t> ids(static_cast<std::size_t>(count));
    if (ex_get_ids(id_, type, ids.data()) < 0) return {};
    return ids;
  }

  /// The names of NetCDF's variables that begin with `start`.
  [[nodiscard]] std::set<std::string> variables(std::string_view start) const {
    int count = 0;
    std::set<std::string> names;
    std::array<char, NC_MAX_NAME + 1> name{};
    if (nc_inq_nvars(id_, &count) != NC_NOERR) return names;
    for (int v = 0; v < count; ++v)
      if (nc_inq_varname(id_, v, name.data()) == NC_NOERR && std::string_view(name.data()).starts_with(start))
        names.emplace(name.data());
    return names;
  }

  /// The names of the variables of a kind. VTK's reader replaces letters that are not of ASCII.
  [[nodiscard]] std::vector<std::string> variable_names(ex_entity_type type) const {
    int count = 0;
    if (ex_get_variable_param(id_, type, &count) < 0 || count < 1 || static_cast<std::uintmax_t>(count) > bytes_)
      return {};
    ex_set_max_name_length(id_, NC_MAX_NAME);
    std::vector<std::array<char, NC_MAX_NAME + 1>> texts(static_cast<std::size_t>(count));
    std::vector<char*> pointers;
    for (auto& text : texts) pointers.push_back(text.data());
    if (ex_get_variable_names(id_, type, count, pointers.data()) < 0) return {};
    std::vector<std::string> names;
    for (const auto& text : texts) names.push_back(as_utf8(trimmed(text.data())));
    return names;
  }

  [[nodiscard]] bool has_steps() const { return ex_inquire_int(id_, EX_INQ_TIME) > 0; }

  /// Whether coordinates, and the values of all variables of the points, lie in one array each.
  [[nodiscard]] bool has_old_model() const { return ex_large_model(id_) == 0; }

  /// Whether the coordinates are stored as numbers of 4 bytes.
  [[nodiscard]] bool has_single_coordinates() const {
    int variable = 0;
    nc_type type = NC_NAT;
    return nc_inq_varid(id_, has_old_model() ? "coord" : "coordx", &variable) == NC_NOERR &&
           nc_inq_vartype(id_, variable, &type) == NC_NOERR && type == NC_FLOAT;
  }

  /// The times of so many steps; their numbers, as VTK's reader has it, if the file does not tell.
  [[nodiscard]] std::vector<double> times(std::size_t steps) const {
    std::vector<double> times(steps);
    int variable = 0;
    const bool told = nc_inq_varid(id_, "time_whole", &variable) == NC_NOERR;
    for (std::size_t step = 0; step < steps; ++step) {
      constexpr std::size_t one = 1;
      if (!told || nc_get_vara_double(id_, variable, &step, &one, &times[step]) != NC_NOERR)
        times[step] = static_cast<double>(step);
    }
    return times;
  }

 private:
  std::uintmax_t bytes_;
  int id_ = -1;
};

void check_ids(const ExodusFile& file) {
  for (const auto& [type, count_of_type] : {std::pair{EX_ELEM_BLOCK, EX_INQ_ELEM_BLK},
                                            {EX_EDGE_BLOCK, EX_INQ_EDGE_BLK},
                                            {EX_FACE_BLOCK, EX_INQ_FACE_BLK},
                                            {EX_NODE_SET, EX_INQ_NODE_SETS},
                                            {EX_EDGE_SET, EX_INQ_EDGE_SETS},
                                            {EX_FACE_SET, EX_INQ_FACE_SETS},
                                            {EX_SIDE_SET, EX_INQ_SIDE_SETS},
                                            {EX_ELEM_SET, EX_INQ_ELEM_SETS}}) {
    std::vector<std::int64_t> ids = file.ids(type, count_of_type);
    std::ranges::sort(ids);
    if (std::ranges::adjacent_find(ids) != ids.end())
      throw ReaderError("Exodus: two blocks or two sets have the same id");
  }
}

/// The corners of a cell of this type, as VTK's reader takes them; 0: any number.
std::int64_t corners_of(std::string_view type) {
  std::string start(type.substr(0, 3));
  for (char& c : start) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  if (is_one_of(start, {"CIR", "SPH"})) return 1;
  if (is_one_of(start, {"BAR", "TRU", "BEA", "EDG"})) return 2;
  if (is_one_of(start, {"QUA", "TET"})) return 4;
  return start == "TRI" ? 3 : start == "PYR" ? 5 : start == "WED" ? 6 : start == "HEX" ? 8 : 0;
}

void read_blocks(const ExodusFile& file, ExodusHeader& header) {
  for (const std::int64_t id : file.ids(EX_ELEM_BLOCK, EX_INQ_ELEM_BLK)) {
    ex_block block{};
    block.id = id;
    block.type = EX_ELEM_BLOCK;
    const auto number = static_cast<int>(header.blocks.size());
    ExodusHeader::Block& known = header.blocks[static_cast<int>(id)];
    known.number = number;
    if (ex_get_block_param(file.id(), &block) < 0 || block.num_entry == 0) continue;
    known.type = block.topology;
    known.nodes = block.num_nodes_per_entry;
    if (known.nodes < corners_of(known.type))
      throw ReaderError("Exodus: block {} is damaged: cells of type {} with {} nodes", id, known.type.substr(0, 32),
                        known.nodes);
  }
}

/// VTK's reader skips variables of cells if it finds no time steps, as in a file that leaves their number open.
void check_open_records(const ExodusHeader& header, std::uint64_t records) {
  const auto of_cells = header.values.lower_bound("vals_elem_var");
  if (of_cells == header.values.end() || !of_cells->starts_with("vals_elem_var")) return;
  throw ReaderError(
      "Exodus: its number of records is left open, and then VTK's reader skips variables of cells: write {} "
      "into its header (byte 4 and those that follow, the highest byte first)",
      records);
}

/// Reads the header; an empty one if VTK's reader will tell what is wrong with the file. Throws ReaderError if two
/// blocks or sets of one kind have the same id, or if a block's cells have fewer nodes than corners: VTK 9.1 then reads
/// past the end of its lists. Call it inside run_vtk.
ExodusHeader read_exodus_header(const std::string& path) {
  ex_opts(EX_DEFAULT);  // keeps the library from printing its errors
  ExodusHeader header;
  const ExodusFile file(path);
  if (!file.is_open()) return header;
  check_ids(file);
  read_blocks(file, header);
  header.values = file.variables("vals_");
  header.in_one_array = file.has_old_model();
  header.single = file.has_single_coordinates();
  const auto records = count_open_records(path);
  if (!records) throw ReaderError("{}", records.error().message);
  if (*records) check_open_records(header, **records);
  if (*records) header.times = file.times(static_cast<std::size_t>(**records));
  if (*records && header.times.empty()) header.values.clear();
  header.nodal = file.variable_names(EX_NODAL);
  header.of_elements = file.variable_names(EX_ELEM_BLOCK);
  header.has_nodes = ex_inquire_int(file.id(), EX_INQ_NODES) > 0;
  header.has_steps = !header.times.empty() || file.has_steps();
  return header;
}

class DoublePoints final : public vtkPoints {
 public:
  static DoublePoints* New();
  vtkTypeMacro(DoublePoints, vtkPoints)

      protected : DoublePoints()
      : vtkPoints(VTK_DOUBLE) {}
};
vtkStandardNewMacro(DoublePoints);

class PointsFactory final : public vtkObjectFactory {
 public:
  static PointsFactory* New();
  vtkTypeMacro(PointsFactory, vtkObjectFactory)

      const char* GetVTKSourceVersion() override {
    return VTK_SOURCE_VERSION;
  }
  const char* GetDescription() override { return "points of double precision"; }

 protected:
  PointsFactory() {
    RegisterOverride("vtkPoints", "DoublePoints", GetDescription(), 1,
                     [] { return static_cast<vtkObject*>(DoublePoints::New()); });
  }
};
vtkStandardNewMacro(PointsFactory);

/// While one of these is there, VTK makes points of double precision instead of single. For readers that hold
/// coordinates in double precision up to this step. Not thread-safe.
class PrecisePoints {
 public:
  PrecisePoints() { vtkObjectFactory::RegisterFactory(factory_); }
  ~PrecisePoints() { vtkObjectFactory::UnRegisterFactory(factory_); }
  PrecisePoints(const PrecisePoints&) = delete;
  PrecisePoints& operator=(const PrecisePoints&) = delete;

 private:
  vtkSmartPointer<PointsFactory> factory_ = vtkSmartPointer<PointsFactory>::New();
};

/// Whether an array is called a displacement; the longer the word, the surer it is. 0: it is not.
std::size_t displacement_word(std::string_view array) {
  std::string word(array.substr(0, array.find_last_not_of("_ .") + 1));  // what is left of "disp_x"
  for (char& c : word) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return is_one_of(word, {"disp", "displ", "displacement", "displacements"}) ? word.size() : 0;
}

/// An array of VTK's reader: a variable, or the components of a vector.
struct ExodusArray {
  std::string vtk_name, name;
  int components = 1;
  int variable = 0;  // the first
};

class ExodusReader final : public BlockReader {
 public:
  Status check(const std::string& path, const SourceOptions& options) override {
    moves_points_ = options.displacements;
    SPLATVOL_TRY_ASSIGN(start, read_text(path, 64));
    if (!is_hdf5(start) && !is_netcdf(start))
      return fail(ErrorCode::invalid_data, "{}: not an Exodus file (neither NetCDF nor HDF5)", path);
    return check_file_end(path);
  }

  vtkMultiBlockDataSetAlgorithm* open(const std::string& path) override {
    check_hdf5_file(path, Hdf5Arrays::any);  // throws, as the next line does
    header_ = read_exodus_header(path);
    reader_->SetFileName(path.c_str());
    reader_->GenerateObjectIdCellArrayOff();
    reader_->ApplyDisplacementsOff();  // VTK's reader takes all that begins with "dis"
    return reader_;
  }

  /// A file without a step yet has no values of its variables.
  void select(const std::vector<std::string>& selection) override {
    nodal_ = list_arrays(vtkExodusIIReader::NODAL, header_.nodal);
    of_elements_ = list_arrays(vtkExodusIIReader::ELEM_BLOCK, header_.of_elements);
    if (moves_points_) find_displacements();
    for (std::size_t i = 0; i < nodal_.size(); ++i)
      reader_->SetObjectArrayStatus(
          vtkExodusIIReader::NODAL, static_cast<int>(i),
          header_.has_steps && (wants_array(selection, nodal_[i].name) || displacements_ == i));
    for (std::size_t i = 0; i < of_elements_.size(); ++i)
      reader_->SetObjectArrayStatus(vtkExodusIIReader::ELEM_BLOCK, static_cast<int>(i),
                                    header_.has_steps && wants_array(selection, of_elements_[i].name));
    header_.has_steps ? find_without_values(selection) : keep_wanted(selection);
    select_others(false);
  }

  void want_patches() override { wants_patches_ = true; }

  std::vector<ArrayShape> arrays(std::optional<double> /*time*/) override {
    std::vector<ArrayShape> shapes;
    for (const ExodusArray& array : nodal_) shapes.push_back({array.name, array.components, false});
    for (const ExodusArray& array : of_elements_) shapes.push_back({array.name, array.components, true});
    return shapes;
  }

  DeclaredArrays declared(vtkDataSet& /*data*/) override {
    const int id = reader_->GetObjectId(vtkExodusIIReader::ELEM_BLOCK, portion_);
    DeclaredArrays declared{fmt::format("block {}", id), {}};
    const auto block = header_.blocks.find(id);
    if (block == header_.blocks.end() || !header_.has_steps) return declared;
    for (const ExodusArray& array : nodal_)
      if (header_.has_nodal_values(array.variable)) declared.arrays.push_back({array.name, array.components, false});
    for (const ExodusArray& array : of_elements_)
      if (header_.has_element_values(block->second.number, array.variable))
        declared.arrays.push_back({array.name, array.components, true});
    return declared;
  }

  std::set<std::string> notes() const override {
    std::set<std::string> notes;
    if (displacements_)
      notes.insert(nodal_[*displacements_].name +
                   ": displacements, by which the points are moved (--no-displacements)");
    std::vector<std::string> names;
    for (const std::vector<ExodusArray>* arrays : {&nodal_, &of_elements_})
      for (const ExodusArray& array : *arrays) names.push_back(array.name);
    if (!header_.has_steps && !names.empty())
      notes.insert(fmt::format("{}: missing, as the file has no time step yet", fmt::join(names, ", ")));
    return notes;
  }

  CellCensus take_changes() override {
    CellCensus changes;
    changes.losses = std::exchange(without_values_, {});
    return changes;
  }

  std::vector<double> times() const override { return header_.times; }
  int portions() override { return reader_->GetNumberOfObjects(vtkExodusIIReader::ELEM_BLOCK); }

  /// Names of blocks may be missing, and then VTK's reader makes them of what it has read.
  std::string block_name(const std::vector<std::string>&) const override {
    return std::to_string(reader_->GetObjectId(vtkExodusIIReader::ELEM_BLOCK, portion_));
  }

  void read(int portion, std::optional<double> time) override {
    portion_ = portion;
    for (int block = 0; block < portions(); ++block)
      reader_->SetObjectStatus(vtkExodusIIReader::ELEM_BLOCK, block, block == portion);
    check_components(portion);
    select_others(wants_patches_ && portion == 0);
    if (time && !header_.times.empty()) {
      reader_->SetTimeStep(static_cast<int>(std::ranges::find(header_.times, *time) - header_.times.begin()));
      time = std::nullopt;
    }
    {
      // Numbers of 4 bytes stay as they are, and so do their sums with displacements.
      std::optional<PrecisePoints> precise;
      if (!header_.single) precise.emplace();
      update(*reader_, time, 0, 1);
    }
    if (auto* block = block_of(reader_->GetOutput())) finish(*block, portion);
    if (displacements_) move_points(*reader_->GetOutput());
  }

 private:
  /// Throws if a block has some components of a vector only: VTK's reader would crash.
  void check_components(int portion) const {
    const int id = reader_->GetObjectId(vtkExodusIIReader::ELEM_BLOCK, portion);
    const auto block = header_.blocks.find(id);
    if (block == header_.blocks.end() || !header_.has_steps) return;
    for (std::size_t i = 0; i < of_elements_.size(); ++i) {
      const ExodusArray& array = of_elements_[i];
      int with_values = 0;
      for (int c = 0; c < array.components; ++c)
        with_values += header_.has_element_values(block->second.number, array.variable + c) ? 1 : 0;
      const bool is_read = reader_->GetObjectArrayStatus(vtkExodusIIReader::ELEM_BLOCK, static_cast<int>(i)) != 0;
      if (is_read && with_values > 0 && with_values < array.components)
        throw ReaderError("Exodus: block {} has values of {} of the {} components of {}: choose others by --attribute",
                          id, with_values, array.components, array.name);
    }
  }

  /// Notes the variables of points that are wanted and have no values. Blocks of cells may lack variables, as the file
  /// tells.
  void find_without_values(const std::vector<std::string>& selection) {
    for (const ExodusArray& array : nodal_)
      for (int c = 0; c < array.components; ++c)
        if (header_.has_nodes && wants_array(selection, array.name) && !header_.has_nodal_values(array.variable + c))
          without_values_.insert(fmt::format("{}: declared, and the file has no values of it", array.name));
  }

  /// Keeps the arrays that are wanted, for a file without steps. VTK's reader may not list those of cells.
  void keep_wanted(const std::vector<std::string>& selection) {
    if (of_elements_.empty())
      for (const std::string& name : header_.of_elements) of_elements_.push_back({.vtk_name = name, .name = name});
    for (std::vector<ExodusArray>* arrays : {&nodal_, &of_elements_})
      std::erase_if(*arrays, [&](const ExodusArray& array) { return !wants_array(selection, array.name); });
  }

  /// Adds arrays of missing values.
  static void add_missing(const std::vector<ExodusArray>& arrays, vtkDataSetAttributes& to, vtkIdType count) {
    for (const ExodusArray& array : arrays) {
      const vtkNew<vtkDoubleArray> values;
      values->SetName(array.name.c_str());
      values->SetNumberOfComponents(array.components);
      values->SetNumberOfTuples(count);
      values->Fill(missing_value);
      to.AddArray(values);
    }
  }

  /// Chooses among all but the blocks of cells: the side sets, or nothing.
  void select_others(bool side_sets) {
    for (const int type : {vtkExodusIIReader::EDGE_BLOCK, vtkExodusIIReader::FACE_BLOCK, vtkExodusIIReader::NODE_SET,
                           vtkExodusIIReader::EDGE_SET, vtkExodusIIReader::FACE_SET, vtkExodusIIReader::SIDE_SET,
                           vtkExodusIIReader::ELEM_SET})
      for (int i = 0; i < reader_->GetNumberOfObjects(type); ++i)
        reader_->SetObjectStatus(type, i, side_sets && type == vtkExodusIIReader::SIDE_SET);
  }

  /// The block of cells in the output: VTK's reader puts all blocks into the first branch.
  static vtkUnstructuredGrid* block_of(vtkMultiBlockDataSet* tree) {
    auto* blocks =
        tree && tree->GetNumberOfBlocks() > 0 ? vtkMultiBlockDataSet::SafeDownCast(tree->GetBlock(0)) : nullptr;
    vtkUnstructuredGrid* block = nullptr;
    for (unsigned int i = 0; blocks && !block && i < blocks->GetNumberOfBlocks(); ++i)
      block = vtkUnstructuredGrid::SafeDownCast(blocks->GetBlock(i));
    return block;
  }

  /// Checks a block that has been read, and takes out values that are none.
  void finish(vtkUnstructuredGrid& grid, int portion) {
    const int id = reader_->GetObjectId(vtkExodusIIReader::ELEM_BLOCK, portion);
    const auto block = header_.blocks.find(id);
    if (block == header_.blocks.end()) return;
    check_nodes(grid, id, block->second);
    if (!header_.has_steps) {
      add_missing(nodal_, *grid.GetPointData(), grid.GetNumberOfPoints());
      add_missing(of_elements_, *grid.GetCellData(), grid.GetNumberOfCells());
    }
    finish_arrays(nodal_, *grid.GetPointData(), [&](int variable) { return header_.has_nodal_values(variable); });
    finish_arrays(of_elements_, *grid.GetCellData(),
                  [&](int variable) { return header_.has_element_values(block->second.number, variable); });
  }

  /// The name of an array: of a vector, what the names of its components have in common.
  [[nodiscard]] static std::string name_of(const std::string& vtk_name, const std::vector<std::string>& variables,
                                           std::size_t first, int components) {
    if (first + static_cast<std::size_t>(components) > variables.size()) return vtk_name;
    std::string name = variables[first];
    const auto is_ascii = [](char c) { return static_cast<unsigned char>(c) < 0x80; };
    if (components > 1 && std::ranges::all_of(name, is_ascii)) return vtk_name;
    for (std::size_t i = first; i < first + static_cast<std::size_t>(components); ++i)
      name.erase(std::ranges::mismatch(name, variables[i]).in1, name.end());
    return name.empty() ? vtk_name : name;
  }

  /// Lists the arrays of a kind. Each has the next variables as its components.
  [[nodiscard]] std::vector<ExodusArray> list_arrays(int type, const std::vector<std::string>& variables) const {
    std::vector<ExodusArray> arrays;
    for (int i = 0, variable = 0; i < reader_->GetNumberOfObjectArrays(type); ++i) {
      const std::string vtk_name = reader_->GetObjectArrayName(type, i);
      const int components = reader_->GetNumberOfObjectArrayComponents(type, i);
      const auto number = static_cast<std::size_t>(variable);
      arrays.push_back({vtk_name, name_of(vtk_name, variables, number, components), components, variable});
      variable += components;
    }
    return arrays;
  }

  void find_displacements() {
    std::size_t longest = 0;
    for (std::size_t i = 0; i < nodal_.size(); ++i) {
      const ExodusArray& array = nodal_[i];
      const std::size_t length = displacement_word(array.name);
      bool has_values = header_.has_steps;
      for (int c = 0; c < array.components; ++c)
        has_values = has_values && header_.has_nodal_values(array.variable + c);
      if (array.components != 3 || !has_values || length <= longest) continue;
      displacements_ = i;
      longest = length;
    }
  }

  /// Moves the points of all blocks. They are not changed in place: VTK's reader may keep them for the next time.
  void move_points(vtkMultiBlockDataSet& tree) const {
    const auto entry = vtkSmartPointer<vtkCompositeDataIterator>::Take(tree.NewIterator());
    for (entry->InitTraversal(); !entry->IsDoneWithTraversal(); entry->GoToNextItem()) {
      auto* grid = vtkPointSet::SafeDownCast(entry->GetCurrentDataObject());
      vtkDataArray* moves = grid ? grid->GetPointData()->GetArray(nodal_[*displacements_].name.c_str()) : nullptr;
      if (!moves) continue;
      const vtkNew<vtkPoints> points;
      points->SetDataType(grid->GetPoints()->GetDataType());
      points->DeepCopy(grid->GetPoints());
      for (vtkIdType i = 0; i < points->GetNumberOfPoints(); ++i) {
        std::array<double, 3> at{}, move{};
        points->GetPoint(i, at.data());
        moves->GetTuple(i, move.data());
        points->SetPoint(i, at[0] + move[0], at[1] + move[1], at[2] + move[2]);
      }
      grid->SetPoints(points);
    }
  }

  /// Throws if VTK's reader takes some nodes of the cells only: then it also takes them from the wrong cells. Surfaces
  /// that are left out may be wrong.
  void check_nodes(vtkUnstructuredGrid& grid, int id, const ExodusHeader::Block& block) const {
    if (grid.GetNumberOfCells() == 0 || (!wants_patches_ && is_surface(*data_set_of(grid)))) return;
    const int type = grid.GetCellType(0);
    const vtkIdType taken = grid.GetCells()->GetCellSize(0);
    if (type == VTK_POLYGON || type == VTK_POLYHEDRON || taken == block.nodes) return;
    throw ReaderError(
        "Exodus: cells of block {} have {} nodes ({}), of which VTK's reader would take {}: save them with "
        "corners only, or with corners and the middles of edges",
        id, block.nodes, block.type.substr(0, 32), taken);
  }

  /// Gives arrays the names of their variables. Takes out the values of variables that the file declares and does not
  /// hold: VTK's reader returns leftover memory for them.
  template <class HasValues>
  static void finish_arrays(const std::vector<ExodusArray>& known, vtkDataSetAttributes& arrays,
                            const HasValues& has_values) {
    for (const ExodusArray& of_file : known) {
      vtkDataArray* array = arrays.GetArray(of_file.vtk_name.c_str());
      if (!array) array = arrays.GetArray(of_file.name.c_str());  // VTK's reader may give an array again
      if (!array) continue;
      for (int c = 0; c < of_file.components && c < array->GetNumberOfComponents(); ++c)
        if (!has_values(of_file.variable + c)) array->FillComponent(c, missing_value);
      array->SetName(of_file.name.c_str());
    }
  }

  bool wants_patches_ = false, moves_points_ = true;
  int portion_ = 0;  // that was read last
  ExodusHeader header_;
  std::vector<ExodusArray> nodal_, of_elements_;
  std::optional<std::size_t> displacements_;  // among nodal_
  std::set<std::string> without_values_;      // lines on variables, not taken yet
  vtkNew<vtkExodusIIReader> reader_;
};

}  // namespace

Result<std::unique_ptr<DataSets>> open_exodus(const InputFile& file, const SourceOptions& options) {
  forbid_hdf5_plugins();
  return open_blocks(file, options, std::make_unique<ExodusReader>());
}

}  // namespace splatvol
