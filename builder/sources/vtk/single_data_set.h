// A data set that a reader of ours has made, as an input of its own.
#pragma once

#include <vtkDataSet.h>
#include <vtkSmartPointer.h>

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "builder/sources/vtk/data_sets.h"

namespace splatvol {

/// One data set that is in memory.
class SingleDataSet final : public VtkDataSets {
 public:
  SingleDataSet(std::string path, vtkSmartPointer<vtkDataSet> data, std::optional<TimeStep> step,
                std::vector<Patch> patches = {}, CellCensus changes = {})
      : path_(std::move(path)),
        data_(std::move(data)),
        step_(std::move(step)),
        patches_(std::move(patches)),
        changes_(std::move(changes)) {}

  std::size_t count() const override { return 1; }
  const std::string& path() const override { return path_; }
  std::optional<TimeStep> time_step() const override { return step_; }
  CellCensus take_changes() override { return std::exchange(changes_, {}); }
  std::vector<Patch> take_patches() override { return std::exchange(patches_, {}); }
  Result<vtkSmartPointer<vtkDataSet>> next() override { return std::exchange(data_, nullptr); }

 private:
  std::string path_;
  vtkSmartPointer<vtkDataSet> data_;
  std::optional<TimeStep> step_;
  std::vector<Patch> patches_;
  CellCensus changes_;
};

}  // namespace splatvol
