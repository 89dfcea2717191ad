#include "builder/sources/ensight/ensight_reader.h"

#include <fmt/format.h>
#include <vtkCellData.h>
#include <vtkDataArray.h>
#include <vtkDataSet.h>
#include <vtkDataSetAttributes.h>
#include <vtkEnSightGoldBinaryReader.h>
#include <vtkEnSightGoldReader.h>
#include <vtkFloatArray.h>
#include <vtkGenericEnSightReader.h>
#include <vtkIdList.h>
#include <vtkMultiBlockDataSet.h>
#include <vtkNew.h>
#include <vtkObjectFactory.h>
#include <vtkPointData.h>
#include <vtkSmartPointer.h>
#include <vtkUnsignedCharArray.h>

#include <algorithm>
#include <filesystem>
#include <utility>

#include "base/file.h"
#include "base/printable.h"
#include "builder/sources/ensight/ensight_case.h"
#include "builder/sources/ensight/ensight_checks.h"
#include "builder/sources/ensight/finer_numbers.h"
#include "builder/sources/file_words.h"
#include "builder/sources/reader_error.h"
#include "builder/sources/time_steps.h"
#include "builder/sources/vtk/block_reader.h"

namespace splatvol {
namespace {

/// Whether single precision, in which VTK's reader gives points, does not keep those of a case: only text may have more
/// digits. `path`: of the case.
bool has_finer_points_at(const std::string& path, const EnsightCase& files, std::optional<double> time) {
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

/// One of VTK's two readers of EnSight Gold, of text or binary, for a geometry alone.
template <class Reader>
class GeometryReader final : public Reader {
 public:
  static GeometryReader* New() { VTK_STANDARD_NEW_BODY(GeometryReader); }  // NOLINT(readability-identifier-naming)

  void read(const std::string& path, const EnsightFile& file, vtkMultiBlockDataSet& parts) {
    this->SetUseFileSets(file.marked ? 1 : 0);
    if (!this->ReadGeometryFile(path.c_str(), static_cast<int>(file.step) + 1, &parts))
      throw ReaderError("VTK's reader cannot read the geometry {}", path);
  }
};

class EnSightReader final : public BlockReader {
 public:
  Status check(const std::string& path, const SourceOptions& options) override {
    SPLATVOL_TRY_SET(files_, read_ensight_case(path));
    SPLATVOL_TRY_SET(findings_, check_ensight_files(path, files_, options));
    changes_.open_ends += files_.has_open_end() ? 1 : 0;
    path_ = path;
    if (files_.has_materials()) changes_.losses.insert(path + ": the materials of cells are left out");
    if (findings_.geometry) return {};
    constexpr const char* needed =
        "it is needed where a case is not EnSight Gold, and for measured points, and ranges or ghosts of blocks";
    if (!files_.unknown_line().empty())
      return fail(ErrorCode::unsupported, "{}: the line \"{}\" is of no kind that VTK's reader of EnSight knows; {}",
                  path, files_.unknown_line().substr(0, 80), needed);
    if (files_.mixes_file_sets())
      return fail(ErrorCode::unsupported,
                  "{}: a line of GEOMETRY or VARIABLE names no file set, and VTK's reader takes the first; {}", path,
                  needed);
    return {};
  }

  Status check_steps(std::size_t found) const override {
    if (files_.most_steps() <= std::max<std::size_t>(found, 1)) return {};
    return fail(ErrorCode::unsupported,
                "{}: VTK's reader finds {} of its {} time steps; name the time set in the lines of GEOMETRY and "
                "VARIABLE (\"scalar per node: 1 p p.***\")",
                path_, found, files_.most_steps());
  }

  vtkMultiBlockDataSetAlgorithm* open(const std::string& path) override {
    if (findings_.geometry) return nullptr;
    reader_->SetCaseFileName(path.c_str());
    return reader_;
  }
  vtkMultiBlockDataSet* output() override { return parts_; }

  std::vector<double> times() const override {
    std::vector<double> times;
    if (findings_.geometry) times = files_.times();
    std::ranges::sort(times);
    times.erase(std::ranges::unique(times).begin(), times.end());
    return times;
  }

  std::vector<ArrayShape> arrays(std::optional<double> /*time*/) override { return ensight_arrays(files_); }

  void select(const std::vector<std::string>& selection) override {
    for (int i = 0; i < reader_->GetNumberOfPointArrays(); ++i)
      reader_->SetPointArrayStatus(reader_->GetPointArrayName(i),
                                   wants_array(selection, as_utf8(reader_->GetPointArrayName(i))));
    for (int i = 0; i < reader_->GetNumberOfCellArrays(); ++i)
      reader_->SetCellArrayStatus(reader_->GetCellArrayName(i),
                                  wants_array(selection, as_utf8(reader_->GetCellArrayName(i))));
    std::erase_if(findings_.variables,
                  [&](const EnsightValues& values) { return !wants_array(selection, values.variable); });
  }

  DeclaredArrays declared(vtkDataSet& data) override {
    DeclaredArrays declared;
    const std::size_t part = index_of(data);
    if (part < findings_.part_numbers.size()) declared.part = fmt::format("part {}", findings_.part_numbers[part]);
    for (const EnsightValues& values : findings_.variables) {
      const int components = values.complex_part ? 2 : static_cast<int>(values.components);
      if (values.parts.contains(part) && values.complex_part != 1)
        declared.arrays.push_back({values.variable, components, values.per_element});
    }
    declared.arrays.insert(declared.arrays.end(), undelivered_.begin(), undelivered_.end());
    return declared;
  }

  CellCensus take_changes() override { return std::exchange(changes_, {}); }

  void read(int, std::optional<double> time) override {
    if (findings_.geometry)
      read_geometry(*findings_.geometry);
    else
      read_by_vtk(time);
    for (const auto& [part, ghosts] : findings_.ghosts) {
      changes_.hidden += ghosts;
      if (vtkDataSet* data = part_of(part)) hide_loose_points(*data);
    }
    for (EnsightValues& of_variable : findings_.variables) {
      for (auto& [part, values] : of_variable.of_parts) add_values(of_variable, part, std::move(values));
      for (const EnsightValues::Gap& gap : of_variable.gaps) leave_out(of_variable, gap);
    }
  }

  std::string block_word() const override { return "part"; }
  bool rounds_points() const override { return true; }
  bool has_finer_points(std::optional<double> time) override { return has_finer_points_at(path_, files_, time); }

 private:
  void read_by_vtk(std::optional<double> time) {
    update(*reader_, time, 0, 1);
    parts_ = reader_->GetOutput();
    for (std::size_t part = 0; parts_ && part < parts_->GetNumberOfBlocks(); ++part)
      if (vtkDataSet* data = part_of(part)) name_in_utf8(*data);
    undelivered_ = ensight_arrays(files_);
    std::erase_if(undelivered_, [&](const ArrayShape& shape) {
      const auto is_variable = [&](const EnsightValues& values) { return values.variable == shape.name; };
      return std::ranges::any_of(findings_.variables, is_variable) || is_anywhere(shape);
    });
  }

  /// Whether a part has an array.
  bool is_anywhere(const ArrayShape& shape) {
    for (std::size_t part = 0; parts_ && part < parts_->GetNumberOfBlocks(); ++part)
      if (vtkDataSet* data = part_of(part); data && arrays_of(*data, *shape.of_cells).HasArray(shape.name.c_str()))
        return true;
    return false;
  }

  void read_geometry(const EnsightFile& file) {
    const std::string path = std::filesystem::path(path_).parent_path() / file.name;
    parts_ = vtkSmartPointer<vtkMultiBlockDataSet>::New();
    if (findings_.is_binary)
      vtkNew<GeometryReader<vtkEnSightGoldBinaryReader>>()->read(path, file, *parts_);
    else
      vtkNew<GeometryReader<vtkEnSightGoldReader>>()->read(path, file, *parts_);
  }

  /// Replaces a value by a missing one, if its variable was read. VTK may order the components of tensors anew.
  void leave_out(const EnsightValues& variable, const EnsightValues::Gap& gap) {
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
    return parts_ && index < parts_->GetNumberOfBlocks()
               ? vtkDataSet::SafeDownCast(parts_->GetBlock(static_cast<unsigned>(index)))
               : nullptr;
  }

  /// The number of parts if it is none of them.
  [[nodiscard]] std::size_t index_of(const vtkDataSet& data) {
    std::size_t index = 0;
    while (parts_ && index < parts_->GetNumberOfBlocks() && part_of(index) != &data) ++index;
    return index;
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

  void add_values(const EnsightValues& variable, std::size_t index, std::vector<float> values) {
    vtkDataSet* part = part_of(index);
    if (!part) return;
    const vtkIdType count = variable.per_element ? part->GetNumberOfCells() : part->GetNumberOfPoints();
    if (values.size() != static_cast<std::size_t>(count) * variable.components)
      throw ReaderError("\"{}\" has values of {} {} instead of {}", variable.variable,
                        values.size() / variable.components, variable.per_element ? "cells" : "points", count);
    vtkDataSetAttributes& arrays = arrays_of(*part, variable.per_element);
    auto array =
        vtkSmartPointer<vtkFloatArray>(vtkFloatArray::SafeDownCast(arrays.GetArray(variable.variable.c_str())));
    if (!variable.complex_part || !array) {
      array = vtkSmartPointer<vtkFloatArray>::New();
      array->SetName(variable.variable.c_str());
      array->SetNumberOfComponents(variable.complex_part ? 2 : static_cast<int>(variable.components));
      array->SetNumberOfTuples(count);
      array->Fill(missing_value);
      arrays.AddArray(array);
    }
    const std::size_t stride = variable.complex_part ? 2 : 1;
    for (std::size_t i = 0; i < values.size(); ++i)
      array->GetPointer(0)[i * stride + variable.complex_part.value_or(0)] = values[i];
  }

  static std::size_t component_count(vtkDataArray& array) {
    return static_cast<std::size_t>(array.GetNumberOfComponents());
  }

  std::string path_;
  EnsightCase files_{""};
  vtkNew<vtkGenericEnSightReader> reader_;       // unless `findings_` has all but the geometry
  vtkSmartPointer<vtkMultiBlockDataSet> parts_;  // that were read last
  EnsightFindings findings_;
  std::vector<ArrayShape> undelivered_;  // variables that cannot be followed, and of which VTK's reader gave nothing
  CellCensus changes_;
};

}  // namespace

Result<std::unique_ptr<DataSets>> open_ensight(const InputFile& file, const SourceOptions& options) {
  return open_blocks(file, options, std::make_unique<EnSightReader>());
}

}  // namespace splatvol
