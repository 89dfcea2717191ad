#include "builder/sources/vtk/source.h"

#include <fmt/ranges.h>
#include <vtkCellData.h>
#include <vtkDataArray.h>
#include <vtkDataSet.h>
#include <vtkDoubleArray.h>
#include <vtkFieldData.h>
#include <vtkMultiBlockDataSet.h>
#include <vtkMultiBlockPLOT3DReader.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkSmartPointer.h>
#include <vtkStructuredGrid.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <set>
#include <span>
#include <utility>

#include "base/file.h"
#include "base/names.h"
#include "builder/mesh/single_precision.h"
#include "builder/sources/array_union.h"
#include "builder/sources/repeated_pieces.h"
#include "builder/sources/vtk/attributes.h"
#include "builder/sources/vtk/loaded_data_sets.h"
#include "builder/sources/vtk/messages.h"
#include "builder/sources/vtk/piece.h"
#include "builder/sources/vtk/plot3d_format.h"
#include "builder/sources/vtk/reader.h"

namespace splatvol {
namespace {

// The time that a file states, as ParaView writes it (TimeValue) or older writers (TIME).
std::optional<double> time_in_fields(vtkDataSet& data) {
  for (const char* name : {"TimeValue", "TIME"}) {
    vtkDataArray* array = data.GetFieldData()->GetArray(name);
    if (array && array->GetNumberOfValues() == 1 && std::isfinite(array->GetComponent(0, 0)))
      return array->GetComponent(0, 0);
  }
  return std::nullopt;
}

class VtkSource final : public Source {
 public:
  /// `read_again`: makes the data sets once more; may be empty if they tell no blocks apart.
  VtkSource(std::unique_ptr<VtkDataSets> data_sets, const SourceOptions& options, std::optional<TimeStep> step = {},
            std::function<std::unique_ptr<VtkDataSets>()> read_again = {}, VtkLists lists = {})
      : data_sets_(std::move(data_sets)),
        read_again_(std::move(read_again)),
        options_(options),
        own_cells_(options.cells == CellValues::own),
        missing_(options.missing),
        lists_(std::move(lists)),
        step_(std::move(step)) {}

  const std::vector<std::string>& attributes() const override { return names_; }
  std::vector<std::string> units() const override { return units_; }
  std::vector<int> components() const override { return components_of(attributes_); }
  void lend_values() override { lends_ = true; }
  void tell_whole_cells() override { whole_cells_ = true; }
  std::size_t piece_count() const override { return data_sets_->count(); }
  std::optional<TimeStep> time_step() const override { return step_ ? step_ : data_sets_->time_step(); }
  std::optional<double> stated_time() const override { return time_step() ? Source::stated_time() : time_; }

  /// Reads the first piece with points, and the headers of all others. They fix the attributes. Sets `missing` to the
  /// first selected name that is not among them.
  Status start(std::string& missing) {
    SPLATVOL_TRY(load());
    if (!pending_) return fail_no_points();
    time_ = time_in_fields(*pending_);
    const std::string path = data_sets_->path();
    SPLATVOL_TRY(arrays_.add(path, array_shapes(*pending_)));
    SPLATVOL_TRY(arrays_.add(path, wanted(pending_declared_.arrays)));
    SPLATVOL_TRY(data_sets_->announce(arrays_));
    find_declared_by_lists();
    SPLATVOL_TRY_ASSIGN(all, arrays_.attributes(path, options_.cells));
    if (all.empty()) SPLATVOL_TRY_SET(all, make_attribute());
    available_ = names_of(all);
    attributes_ = select_attributes(all, options_.selection, options_.cells, missing, options_.may_lack);
    names_ = names_of(attributes_);
    for (const ArrayAttribute& attribute : attributes_) units_.push_back(unit_of(attribute.array));
    return {};
  }

  /// The names of all attributes that are known, selected or not.
  [[nodiscard]] const std::vector<std::string>& available() const { return available_; }

  Result<std::unique_ptr<Piece>> next() override {
    if (!pending_) SPLATVOL_TRY(load());
    if (!pending_ && own_cells_ && points_ == 0 && !selects_)
      return fail(ErrorCode::invalid_data, "{}: no cells with a volume{}", data_sets_->path(),
                  numbers_blocks_ ? ", and no values; splatvol draws volumes" : ", which '--cells own' needs");
    if (!pending_) return std::unique_ptr<Piece>();
    const vtkSmartPointer<vtkDataSet> data = std::exchange(pending_, nullptr);
    number_ = pending_number_;
    const DeclaredArrays declared = std::exchange(pending_declared_, {});
    const std::uint64_t block = data_sets_->block();
    if (numbers_blocks_) add_block_number(*data);
    SPLATVOL_TRY(arrays_.check(data_sets_->path(), wanted(array_shapes(*data))));
    SPLATVOL_TRY_ASSIGN(piece, make_piece(
                                   data_sets_->path(), *data, attributes_, options_.cells, missing_,
                                   [&](const std::string& array, int component, std::span<double> means) {
                                     data_sets_->share_means(*data, array, component, means);
                                   },
                                   lends_, whole_cells_));
    piece->block = block;
    SPLATVOL_TRY(measure_rounding(*piece));
    piece->patches = data_sets_->take_patches();
    piece->census += data_sets_->take_changes();
    SPLATVOL_TRY(repeats_.add(data_sets_->path(), *piece));
    points_ += piece->points.size();
    note_differences(*data, note_losses(*data, declared, piece->census.losses));
    return piece;
  }

  std::vector<std::uint64_t> part_sizes() override { return data_sets_->part_sizes(); }
  Status select(const std::vector<std::uint64_t>& parts) override {
    // The first data set was read for its attributes.
    if (!std::ranges::binary_search(parts, pending_number_.file)) pending_ = nullptr;
    data_sets_->select(parts);
    selects_ = true;
    return {};
  }

  PieceNumber piece_number() const override { return number_; }

  bool averages_by_piece() const override {
    return !own_cells_ && data_sets_->averages_by_data_set() &&
           std::ranges::any_of(attributes_, [&](const ArrayAttribute& attribute) {
             return attribute.has_twin || attribute.is_volume ? attribute.of_cells
                                                              : arrays_.is_of_cells(attribute.array);
           });
  }

  std::uint64_t left_out_cells() const override { return data_sets_->left_out().left_out; }

  std::vector<std::string> conversions() const override {
    std::vector<std::string> lines = lists_.notes;
    if (!made_.empty()) lines.push_back(made_);
    for (const std::string& note : data_sets_->notes()) lines.push_back(note);
    if (!converted_.empty())
      lines.push_back(fmt::format("{}: of {}", fmt::join(in_order(converted_), ", "),
                                  own_cells_ ? "points, averaged to cells" : "cells, averaged to points"));
    if (!lacking_.empty()) lines.push_back(describe_lacking(in_order(lacking_)));
    return lines;
  }

 private:
  /// Makes an attribute for a mesh without values: the numbers of its blocks, or the volumes of its cells.
  Result<std::vector<ArrayAttribute>> make_attribute() {
    if (pending_->GetNumberOfCells() == 0)
      return fail(ErrorCode::invalid_data, "{}: no arrays of numbers at its points, and no cells", data_sets_->path());
    SPLATVOL_TRY_ASSIGN(has_blocks, tells_blocks());
    if (!has_blocks) {
      made_ = "cell_volume: the mesh has no values, so these are the volumes of its cells";
      return std::vector{
          ArrayAttribute{.name = "cell_volume", .array = "cell_volume", .of_cells = true, .is_volume = true}};
    }
    numbers_blocks_ = own_cells_ = true;  // means of numbers would be numbers of blocks that there are not
    options_.cells = CellValues::own;
    const std::string word = data_sets_->block_word();
    made_ = fmt::format("{}: the mesh has no values, so these are the numbers of its {}s, {}", word, word,
                        data_sets_->blocks_of_cells().empty() ? "in the order of the file" : "as the file has them");
    SPLATVOL_TRY(arrays_.add(data_sets_->path(), std::vector{ArrayShape{.name = word, .of_cells = true}}));
    return arrays_.attributes(data_sets_->path(), options_.cells);
  }

  /// Whether the first file has several blocks besides surfaces. Only their cells tell these: so it is read once more,
  /// up to the second one.
  Result<bool> tells_blocks() const {
    if (data_sets_->blocks() < 2) return false;
    if (!data_sets_->blocks_of_cells().empty()) return true;
    const std::unique_ptr<VtkDataSets> again = read_again_();
    for (std::set<std::size_t> blocks;;) {
      SPLATVOL_TRY_ASSIGN(data, again->next());
      if (!data || again->number().file > 0) return false;
      if (data->GetNumberOfPoints() > 0) blocks.insert(again->block_in_file());
      if (blocks.size() > 1) return true;
    }
  }

  void add_block_number(vtkDataSet& data) const {
    const vtkNew<vtkDoubleArray> numbers;
    numbers->SetName(data_sets_->block_word().c_str());
    numbers->SetNumberOfValues(data.GetNumberOfCells());
    const std::span<const int> of_cells = data_sets_->blocks_of_cells();
    of_cells.empty() ? numbers->FillValue(static_cast<double>(data_sets_->block_in_file()))
                     : static_cast<void>(std::ranges::copy(of_cells, numbers->GetPointer(0)));
    data.GetCellData()->AddArray(numbers);
  }

  [[nodiscard]] tl::unexpected<Error> fail_no_points() const {
    const std::string surfaces = describe_no_volume(data_sets_->left_out());
    if (surfaces.empty()) return fail(ErrorCode::invalid_data, "{}: the mesh has no points", data_sets_->path());
    return fail(ErrorCode::invalid_data, "{}: {}; splatvol draws volumes", data_sets_->path(), surfaces);
  }

  /// Counts the cells that the reader may have bent, by rounding points to single precision. A file that has no more
  /// digits loses none.
  Status measure_rounding(Piece& piece) const {
    if (!data_sets_->rounds_points()) return {};
    CellCensus measured;
    piece.cells ? measure_single_precision(piece.cells->corners, piece.cells->tetrahedra, measured)
                : measure_single_precision(piece.points, piece.tetrahedra, measured);
    if (measured.bent + measured.flattened > 0) {
      SPLATVOL_TRY_ASSIGN(finer, data_sets_->has_finer_points());
      if (!finer) return {};
    }
    piece.census += measured;
    return {};
  }

  [[nodiscard]] std::string unit_of(const std::string& array) const {
    for (std::string unit : {data_sets_->unit(array), unit_label(*pending_, array)})
      if (!unit.empty()) return unit;
    return arrays_.unit(array);
  }

  /// Those that the selection needs. Some readers read all.
  [[nodiscard]] std::vector<ArrayShape> wanted(std::vector<ArrayShape> shapes) const {
    std::erase_if(shapes, [&](const ArrayShape& shape) {
      return is_bookkeeping(shape.name) || !wants_array(options_.selection, shape.name);
    });
    return shapes;
  }

  /// Those names of attributes that are in a set.
  [[nodiscard]] std::vector<std::string> in_order(const std::set<std::string>& names) const {
    std::vector<std::string> ordered = names_;
    std::erase_if(ordered, [&](const std::string& name) { return !names.contains(name); });
    return ordered;
  }

  /// Notes the attributes whose values are those of cells instead of points, or the other way round, and those that a
  /// piece lacks, but not those of `undelivered` arrays. A vector's components go with its magnitude.
  void note_differences(vtkDataSet& data, const std::set<std::string>& undelivered) {
    std::set<std::string> vectors;
    for (const ArrayAttribute& attribute : attributes_) {
      if (attribute.is_volume && !own_cells_) converted_.insert(attribute.name);
      if (attribute.is_volume) continue;
      const auto values = find_values({}, data, attribute);
      if (!values || (values->array && values->of_cells == own_cells_)) continue;
      if (!values->array && undelivered.contains(attribute.array)) continue;
      if (attribute.component == ArrayAttribute::magnitude) vectors.insert(attribute.array);
      if (attribute.components == 1 || attribute.component == ArrayAttribute::magnitude ||
          !vectors.contains(attribute.array))
        (values->array ? converted_ : lacking_).insert(attribute.name);
    }
  }

  /// Names the arrays that a parallel file declares for its pieces, and none of them has.
  void find_declared_by_lists() {
    for (const DeclaredArrays& list : lists_.declared)
      for (const ArrayShape& array : wanted(list.arrays))
        if (std::ranges::find(arrays_.arrays(), array.name, &ArrayShape::name) == arrays_.arrays().end())
          losses_of_lists_.insert(fmt::format("{}: declares {}, which no piece has", list.part, array.name));
  }

  /// Returns the arrays that the file declares and the reader did not give, and tells of them and of those that are
  /// left out.
  std::set<std::string> note_losses(vtkDataSet& data, const DeclaredArrays& declared, std::set<std::string>& losses) {
    std::set<std::string> undelivered;
    const std::string& path = data_sets_->path();
    for (const ArrayShape& array : wanted(declared.arrays)) {
      const auto has = [&](bool of_cells) { return arrays_of(data, of_cells).HasArray(array.name.c_str()) != 0; };
      if (array.of_cells ? has(*array.of_cells) : has(false) || has(true)) continue;
      undelivered.insert(array.name);
      losses.insert(declared.part.empty()
                        ? fmt::format("the reader did not deliver {} of {}", array.name, path)
                        : fmt::format("the reader did not deliver {} of {} of {}", array.name, declared.part, path));
    }
    losses.merge(losses_of_lists_);
    for (const std::string& array : data_sets_->left_out_arrays())
      if (wants_array(options_.selection, array))
        losses.insert(fmt::format("{}: left out, no solution of points or of cells", array));
    return undelivered;
  }

  /// Sets pending_ to the next data set that has points, or to null.
  Status load() {
    do {
      SPLATVOL_TRY_ASSIGN(data, data_sets_->next());
      pending_ = data;
      pending_number_ = data_sets_->number();
      pending_declared_ = data_sets_->declared();
    } while (pending_ && pending_->GetNumberOfPoints() == 0);
    return {};
  }

  std::unique_ptr<VtkDataSets> data_sets_;
  std::function<std::unique_ptr<VtkDataSets>()> read_again_;
  SourceOptions options_;
  bool own_cells_;
  bool lends_ = false;  // values
  bool whole_cells_ = false;
  MissingValues missing_;
  std::uint64_t points_ = 0;                   // of the pieces so far
  std::set<std::string> converted_, lacking_;  // attributes
  VtkLists lists_;
  std::set<std::string> losses_of_lists_;  // not told yet
  std::string made_;                       // what is said of an attribute that the source made; empty: it made none
  bool numbers_blocks_ = false;            // in an array of the cells
  std::optional<TimeStep> step_;           // instead of that of data_sets_
  ArrayUnion arrays_;                      // of all pieces
  std::vector<ArrayAttribute> attributes_;
  std::vector<std::string> names_;      // of attributes_
  std::vector<std::string> units_;      // of attributes_
  std::vector<std::string> available_;  // names of attributes
  std::optional<double> time_;          // that the first piece states
  vtkSmartPointer<vtkDataSet> pending_;
  PieceNumber pending_number_, number_;  // of pending_, and of the last piece
  DeclaredArrays pending_declared_;      // for pending_
  bool selects_ = false;                 // some files
  RepeatedPieces repeats_;
};

/// Appends all structured grids of a tree of blocks.
void collect_blocks(vtkMultiBlockDataSet& tree, std::vector<vtkSmartPointer<vtkDataSet>>& blocks) {
  for (unsigned int i = 0; i < tree.GetNumberOfBlocks(); ++i) {
    vtkDataObject* block = tree.GetBlock(i);
    if (auto* grid = vtkStructuredGrid::SafeDownCast(block)) blocks.emplace_back(grid);
    if (auto* branch = vtkMultiBlockDataSet::SafeDownCast(block)) collect_blocks(*branch, blocks);
  }
}

/// The arrays that every solution gives.
std::vector<ArrayShape> plot3d_arrays() {
  return {{"Density", 1, false}, {"Momentum", 3, false}, {"StagnationEnergy", 1, false}, {"Pressure", 1, false}};
}

/// Adds the functions of a PLOT3D file to the blocks of its grid.
Status add_functions(const std::string& path, ByteSource& file, const Plot3dFormat& format,
                     std::span<const vtkSmartPointer<vtkDataSet>> blocks) {
  for (std::size_t block = 0; block < blocks.size(); ++block) {
    SPLATVOL_TRY_ASSIGN(names, plot3d_function_names(path, format.functions[block].count));
    for (std::size_t function = 0; function < names.size(); ++function) {
      SPLATVOL_TRY_ASSIGN(values, read_plot3d_function(file, format, block, function));
      const vtkNew<vtkDoubleArray> array;
      array->SetName(names[function].c_str());
      array->SetNumberOfValues(static_cast<vtkIdType>(values.size()));
      std::ranges::copy(values, array->GetPointer(0));
      blocks[block]->GetPointData()->AddArray(array);
    }
  }
  return {};
}

/// Reads the blocks of a PLOT3D grid with its solution or functions (binary, any variant). The format interleaves the
/// blocks by quantity, so all are read here.
Result<std::unique_ptr<VtkDataSets>> read_plot3d(const std::string& grid, const std::string& values) {
  // VTK can guess the variant from the grid's size, but it reads past the end of a truncated file's dimensions.
  SPLATVOL_TRY_ASSIGN(grid_file, open_file(grid));
  SPLATVOL_TRY_ASSIGN(values_file, open_file(values));
  SPLATVOL_TRY_ASSIGN(format, detect_plot3d(*grid_file, *values_file));
  constexpr int pressure = 110;
  const bool has_solution = format.functions.empty();
  std::vector<vtkSmartPointer<vtkDataSet>> blocks;
  SPLATVOL_TRY(run_vtk(grid, [&] {
    const vtkNew<vtkMultiBlockPLOT3DReader> reader;
    reader->SetXYZFileName(grid.c_str());
    if (has_solution) reader->SetQFileName(values.c_str());
    reader->SetMultiGrid(format.multi_grid);
    reader->SetHasByteCount(format.record_marks);
    reader->SetByteOrder(format.big_endian ? vtkMultiBlockPLOT3DReader::FILE_BIG_ENDIAN
                                           : vtkMultiBlockPLOT3DReader::FILE_LITTLE_ENDIAN);
    reader->SetIBlanking(format.blanking);
    reader->SetTwoDimensionalGeometry(format.dimensions == 2);
    reader->SetDoublePrecision(format.precision == 8);
    reader->ForceReadOn();
    if (has_solution) reader->AddFunction(pressure);
    reader->Update();
    if (reader->GetOutput()) collect_blocks(*reader->GetOutput(), blocks);
  }));
  if (blocks.empty()) return fail(ErrorCode::invalid_data, "{}: the PLOT3D grid has no blocks", grid);
  if (!has_solution && blocks.size() != format.functions.size())
    return fail(ErrorCode::invalid_data, "{}: VTK's reader finds {} of its {} blocks", grid, blocks.size(),
                format.functions.size());
  if (!has_solution) SPLATVOL_TRY(add_functions(values, *values_file, format, blocks));
  auto data_sets = std::make_unique<LoadedDataSets>(grid, std::move(blocks));
  if (has_solution) data_sets->declare(plot3d_arrays());
  return data_sets;
}

}  // namespace

Result<std::unique_ptr<Source>> open_vtk_files(std::vector<VtkFile> files, const SourceOptions& options,
                                               const std::optional<TimeStep>& step, VtkLists lists) {
  auto source = std::make_unique<VtkSource>(
      read_vtk_files(files, options), options, step, [files, options] { return read_vtk_files(files, options); },
      std::move(lists));
  std::string missing;
  SPLATVOL_TRY(source->start(missing));
  if (missing.empty() || options.may_lack) return source;

  // Only the selected arrays were read; the message lists all.
  const std::string path = files.front().path;
  SourceOptions without_selection = options;
  without_selection.selection.clear();
  SPLATVOL_TRY_ASSIGN(all, open_vtk_files(std::move(files), without_selection));
  return fail_no_attribute(path, missing, all->attributes());
}

Result<std::vector<ArrayShape>> list_vtk_arrays(const std::vector<VtkFile>& files, const SourceOptions& options) {
  ArrayUnion arrays;
  SPLATVOL_TRY(read_vtk_files(files, options)->announce(arrays));
  return arrays.arrays();
}

Result<std::unique_ptr<Source>> open_plot3d(const std::string& grid, const std::string& solution,
                                            const SourceOptions& options) {
  SPLATVOL_TRY_ASSIGN(blocks, read_plot3d(grid, solution));
  auto source = std::make_unique<VtkSource>(std::move(blocks), options);
  std::string missing;
  SPLATVOL_TRY(source->start(missing));
  if (!missing.empty()) return fail_no_attribute(grid, missing, source->available());
  return source;
}

}  // namespace splatvol
