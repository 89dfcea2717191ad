#include "builder/sources/vtk/blocks.h"

#include <vtkCellData.h>
#include <vtkCompositeDataIterator.h>
#include <vtkDataSet.h>
#include <vtkDoubleArray.h>
#include <vtkInformation.h>
#include <vtkMultiBlockDataSet.h>
#include <vtkMultiBlockDataSetAlgorithm.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkSmartPointer.h>
#include <vtkStreamingDemandDrivenPipeline.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <utility>

#include "builder/sources/vtk/attributes.h"
#include "builder/sources/vtk/block_checks.h"
#include "builder/sources/vtk/block_readers.h"
#include "builder/sources/vtk/cell_averages.h"
#include "builder/sources/vtk/cells.h"
#include "builder/sources/vtk/messages.h"
#include "builder/sources/vtk/trial.h"

namespace splatvol {
namespace {

vtkDataSetAttributes& arrays_of(vtkDataSet& data, bool of_cells) {
  return of_cells ? static_cast<vtkDataSetAttributes&>(*data.GetCellData()) : *data.GetPointData();
}

/// Adds the arrays that a block lacks, filled with NaN. An array that is known at points or cells alone may be at the
/// others here.
void add_missing(vtkDataSet& data, const std::vector<ArrayShape>& shapes, CellValues cells) {
  for (const ArrayShape& shape : shapes) {
    const bool of_cells = shape.of_cells.value_or(cells == CellValues::own);
    if (arrays_of(data, of_cells).HasArray(shape.name.c_str())) continue;
    const bool both = std::ranges::count(shapes, shape.name, &ArrayShape::name) > 1;
    if (!both && arrays_of(data, !of_cells).HasArray(shape.name.c_str())) continue;
    const vtkNew<vtkDoubleArray> array;
    array->SetName(shape.name.c_str());
    array->SetNumberOfComponents(shape.components);
    array->SetNumberOfTuples(of_cells ? data.GetNumberOfCells() : data.GetNumberOfPoints());
    array->Fill(missing_value);
    arrays_of(data, of_cells).AddArray(array);
  }
}

/// The times of the steps that a reader found in its file.
std::vector<double> times_of(vtkAlgorithm& algorithm) {
  vtkInformation* information = algorithm.GetOutputInformation(0);
  const int count = information->Length(vtkStreamingDemandDrivenPipeline::TIME_STEPS());
  const double* first = information->Get(vtkStreamingDemandDrivenPipeline::TIME_STEPS());
  return count > 0 ? std::vector<double>(first, first + count) : std::vector<double>();
}

/// Chooses the step nearest to `time`, or without one the last.
std::optional<TimeStep> choose_step(const std::vector<double>& times, std::optional<double> time) {
  if (times.empty()) return std::nullopt;
  std::size_t best = 0;
  for (std::size_t i = 1; i < times.size(); ++i) {
    const bool better = time ? std::abs(times[i] - *time) < std::abs(times[best] - *time) : times[i] >= times[best];
    if (better) best = i;
  }
  return TimeStep{times[best], best, times.size(), times};
}

std::optional<double> time_of(const std::optional<TimeStep>& step) {
  return step ? std::optional(step->time) : std::nullopt;
}

/// Reads a file's header in a process of its own. An EnSight file is read to its end: VTK 9.1 trusts what its files
/// declare about each other, and reads past the end of files that are cut off.
Status try_file(const VtkFile& file, const std::vector<std::string>& selection, std::optional<double> time) {
  constexpr unsigned seconds = 3600;
  return try_in_child(file.path, seconds, [&] {
    const auto reader = make_block_reader(file.kind);
    vtkAlgorithm& algorithm = reader->open(file.path);
    algorithm.UpdateInformation();
    reader->select(selection);
    const auto step = choose_step(times_of(algorithm), time);
    if (file.kind == VtkFile::Kind::ensight) reader->read(0, time_of(step));
  });
}

/// The blocks of one file.
class BlockDataSets final : public VtkDataSets {
 public:
  BlockDataSets(VtkFile file, std::vector<std::string> selection, CellValues cells)
      : file_(std::move(file)),
        selection_(std::move(selection)),
        cells_(cells),
        reader_(make_block_reader(file_.kind)) {}

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
    return returned_ + blocks_.size() + static_cast<std::size_t>(std::max(0, reader_->portions() - portion_));
  }
  const std::string& path() const override { return file_.path; }
  std::optional<TimeStep> time_step() const override { return step_; }
  CellCensus left_out() const override { return left_out_; }

  Result<vtkSmartPointer<vtkDataSet>> next() override {
    while (blocks_.empty() && portion_ < reader_->portions()) SPLATVOL_TRY(read_portion());
    if (blocks_.empty()) return vtkSmartPointer<vtkDataSet>();
    auto block = blocks_.front();
    blocks_.pop_front();
    ++returned_;
    return block;
  }

 private:
  /// Appends a portion's blocks to blocks_, with all arrays.
  Status read_portion() {
    SPLATVOL_TRY(run_vtk(file_.path, [&] {
      reader_->read(portion_++, time_of(step_));
      if (auto* tree = vtkMultiBlockDataSet::SafeDownCast(algorithm_->GetOutputDataObject(0))) {
        collect(*tree);
        tree->Initialize();
      }
      for (auto& block : blocks_)
        for (const bool of_cells : {false, true}) learn_arrays(*block, of_cells);
      for (auto& block : blocks_) add_missing(*block, shapes_, cells_);
    }));
    return {};
  }

  /// Appends the blocks of a tree that are not surfaces.
  void collect(vtkMultiBlockDataSet& tree) {
    const auto entry = vtkSmartPointer<vtkCompositeDataIterator>::Take(tree.NewIterator());
    for (entry->InitTraversal(); !entry->IsDoneWithTraversal(); entry->GoToNextItem()) {
      auto* data = vtkDataSet::SafeDownCast(entry->GetCurrentDataObject());
      if (!data || data->GetNumberOfPoints() == 0) continue;
      if (is_surface(*data)) {
        count_left_out(*data);
        continue;
      }
      blocks_.push_back(copy_sharing_arrays(*data));
    }
  }

  void count_left_out(vtkDataSet& data) {
    for (vtkIdType cell = 0; cell < data.GetNumberOfCells(); ++cell) {
      const CellKind* kind = find_cell_kind(data.GetCellType(cell));
      if (!kind) continue;
      ++left_out_.cells[std::string(kind->name)];
      ++left_out_.without_volume;
      left_out_.lines += dimension_of(*kind) == 1 ? 1 : 0;
      left_out_.surfaces += dimension_of(*kind) == 2 ? 1 : 0;
    }
  }

  /// Adds a block's arrays to the known ones. If a name is known already, the block's array counts as the same one,
  /// unless points and cells both have an array of this name.
  void learn_arrays(vtkDataSet& data, bool of_cells) {
    vtkDataSetAttributes& arrays = arrays_of(data, of_cells);
    for (int i = 0; i < arrays.GetNumberOfArrays(); ++i) {
      vtkDataArray* array = arrays.GetArray(i);
      if (!array || !arrays.GetArrayName(i)) continue;
      const std::string name = arrays.GetArrayName(i);
      if (is_bookkeeping(arrays, i, name) || name == "HigherOrderDegrees") continue;
      const auto of_name = [&](const ArrayShape& shape) { return shape.name == name; };
      const auto known = std::ranges::find_if(shapes_, of_name);
      const bool both = arrays_of(data, !of_cells).HasArray(name.c_str()) != 0;
      const bool same = std::ranges::any_of(
          shapes_, [&](const ArrayShape& shape) { return shape.name == name && shape.of_cells == of_cells; });
      if (same || (known != shapes_.end() && !both)) continue;
      if (known != shapes_.end() && !known->of_cells)
        known->of_cells = of_cells;
      else
        shapes_.push_back({name, array->GetNumberOfComponents(), of_cells});
    }
  }

  VtkFile file_;
  std::vector<std::string> selection_;
  CellValues cells_;
  std::unique_ptr<BlockReader> reader_;
  vtkMultiBlockDataSetAlgorithm* algorithm_ = nullptr;  // of reader_
  std::optional<TimeStep> step_;
  std::vector<ArrayShape> shapes_;  // known so far
  int portion_ = 0;                 // the next to be read
  std::size_t returned_ = 0;
  CellCensus left_out_;
  std::deque<vtkSmartPointer<vtkDataSet>> blocks_;  // read and not returned yet
};

}  // namespace

Result<std::unique_ptr<VtkDataSets>> open_blocks(const VtkFile& file, const std::vector<std::string>& selection,
                                                 std::optional<double> time, CellValues cells) {
  auto blocks = std::make_unique<BlockDataSets>(file, selection, cells);
  SPLATVOL_TRY(blocks->open(time));
  return blocks;
}

}  // namespace splatvol
