// EnSight, through VTK's reader.
#include <vtkCellData.h>
#include <vtkDataArray.h>
#include <vtkDataSet.h>
#include <vtkDataSetAttributes.h>
#include <vtkFloatArray.h>
#include <vtkGenericEnSightReader.h>
#include <vtkIdList.h>
#include <vtkMultiBlockDataSet.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkUnsignedCharArray.h>

#include <algorithm>
#include <filesystem>
#include <utility>

#include "base/file.h"
#include "builder/sources/reader_error.h"
#include "builder/sources/time_steps.h"
#include "builder/sources/vtk/block_reader.h"
#include "builder/sources/vtk/ensight_case.h"
#include "builder/sources/vtk/ensight_checks.h"
#include "builder/sources/vtk/file_words.h"
#include "builder/sources/vtk/finer_numbers.h"

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

class EnSightReader final : public BlockReader {
 public:
  Status check(const std::string& path, std::optional<double> time) override {
    SPLATVOL_TRY_SET(files_, read_ensight_case(path));
    SPLATVOL_TRY_SET(findings_, check_ensight_files(path, files_, time));
    changes_.open_ends += files_.has_open_end() ? 1 : 0;
    path_ = path;
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
  bool has_finer_points(std::optional<double> time) override { return has_finer_points_at(path_, files_, time); }

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
  EnsightCase files_{""};
  vtkNew<vtkGenericEnSightReader> reader_;
  EnsightFindings findings_;
  CellCensus changes_;
};

}  // namespace

std::unique_ptr<BlockReader> make_ensight_reader() { return std::make_unique<EnSightReader>(); }

}  // namespace splatvol
