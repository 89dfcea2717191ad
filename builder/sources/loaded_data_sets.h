// Data sets that are all in memory, as an input of their own.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "builder/sources/data_sets.h"

namespace splatvol {

class LoadedDataSets : public DataSets {
 public:
  LoadedDataSets(std::string path, std::vector<std::unique_ptr<DataSet>> data, std::optional<TimeStep> step = {},
                 std::vector<Patch> patches = {}, CellCensus changes = {})
      : path_(std::move(path)),
        data_(std::move(data)),
        step_(std::move(step)),
        patches_(std::move(patches)),
        changes_(std::move(changes)) {}

  std::size_t count() const override { return data_.size(); }
  const std::string& path() const override { return path_; }
  std::optional<TimeStep> time_step() const override { return step_; }
  CellCensus take_changes() override { return std::exchange(changes_, {}); }
  std::vector<Patch> take_patches() override { return std::exchange(patches_, {}); }
  Result<std::unique_ptr<DataSet>> next() override {
    return next_ == data_.size() ? nullptr : std::move(data_[next_++]);
  }
  DeclaredArrays declared() const override { return declared_; }

  /// All data sets must have these.
  void declare(std::vector<ArrayShape> arrays) { declared_.arrays = std::move(arrays); }

 private:
  std::string path_;
  std::vector<std::unique_ptr<DataSet>> data_;
  std::size_t next_ = 0;
  std::optional<TimeStep> step_;
  std::vector<Patch> patches_;
  CellCensus changes_;
  DeclaredArrays declared_;
};

}  // namespace splatvol
