#include "builder/sources/vtk/block_reader.h"

#include <vtkCompositeDataIterator.h>
#include <vtkDataSet.h>
#include <vtkInformation.h>
#include <vtkMultiBlockDataSet.h>
#include <vtkMultiBlockDataSetAlgorithm.h>
#include <vtkSmartPointer.h>
#include <vtkStreamingDemandDrivenPipeline.h>

#include <algorithm>
#include <deque>
#include <iterator>
#include <utility>

#include "builder/sources/block_numbers.h"
#include "builder/sources/cell_counts.h"
#include "builder/sources/patch.h"
#include "builder/sources/time_steps.h"
#include "builder/sources/vtk/data_set.h"
#include "builder/sources/vtk/messages.h"

namespace splatvol {
namespace {

/// The times of the steps that a reader found in its file.
std::vector<double> times_of(vtkAlgorithm& algorithm) {
  vtkInformation* information = algorithm.GetOutputInformation(0);
  const int count = information->Length(vtkStreamingDemandDrivenPipeline::TIME_STEPS());
  const double* first = information->Get(vtkStreamingDemandDrivenPipeline::TIME_STEPS());
  return count > 0 ? std::vector<double>(first, first + count) : std::vector<double>();
}

std::optional<double> time_of(const std::optional<TimeStep>& step) {
  return step ? std::optional(step->time) : std::nullopt;
}

/// The blocks of one file.
class BlockDataSets final : public DataSets {
 public:
  BlockDataSets(InputFile file, const SourceOptions& options, std::unique_ptr<BlockReader> reader)
      : file_(std::move(file)), options_(options), reader_(std::move(reader)) {}

  Status open() {
    SPLATVOL_TRY(reader_->check(file_.path, options_));
    SPLATVOL_TRY(run_vtk(file_.path, [&] {
      algorithm_ = reader_->open(file_.path);
      if (file_.patches) reader_->want_patches();
      if (algorithm_) algorithm_->UpdateInformation();
      reader_->select(options_.selection);
      const std::vector<double> times = reader_->times();
      step_ = choose_step(times.empty() && algorithm_ ? times_of(*algorithm_) : times, options_.time);
    }));
    return reader_->check_steps(step_ ? step_->times.size() : 0);
  }

  Status announce(ArrayUnion& arrays) override {
    std::vector<ArrayShape> announced;
    SPLATVOL_TRY(run_vtk(file_.path, [&] { announced = reader_->arrays(time_of(step_)); }));
    SPLATVOL_TRY(arrays.add(file_.path, wanted_arrays(std::move(announced), options_.selection)));
    for (const Block& block : blocks_)
      SPLATVOL_TRY(arrays.add(file_.path, wanted_arrays(block.data->arrays(), options_.selection)));
    return {};
  }

  std::size_t count() const override {
    return returned_ + blocks_.size() + static_cast<std::size_t>(std::max(0, reader_->portions() - portion_));
  }
  const std::string& path() const override { return file_.path; }
  std::optional<TimeStep> time_step() const override { return step_; }
  CellCensus left_out() const override { return left_out_; }
  std::set<std::string> notes() const override { return reader_->notes(); }
  std::set<std::string> left_out_arrays() const override { return reader_->left_out_arrays(); }
  std::uint64_t block() const override { return returned_block_.number; }
  DeclaredArrays declared() const override { return returned_block_.declared; }
  std::size_t blocks() const override { return count(); }
  std::string block_word() const override { return reader_->block_word(); }
  std::size_t block_in_file() const override {
    return blocks() == 1 ? 1 : reader_->portions() > 1 ? static_cast<std::size_t>(portion_) : returned_;
  }
  CellCensus take_changes() override {
    CellCensus changes = std::exchange(changes_, {});
    changes += reader_->take_changes();
    return changes;
  }
  std::vector<Patch> take_patches() override { return std::exchange(patches_, {}); }
  bool rounds_points() const override { return reader_->rounds_points(); }
  Result<bool> has_finer_points() override {
    if (!has_finer_points_)
      SPLATVOL_TRY(run_vtk(file_.path, [&] { has_finer_points_ = reader_->has_finer_points(time_of(step_)); }));
    return *has_finer_points_;
  }

  Result<std::unique_ptr<DataSet>> next() override {
    while (blocks_.empty() && portion_ < reader_->portions()) SPLATVOL_TRY(read_portion());
    if (blocks_.empty()) return std::unique_ptr<DataSet>();
    returned_block_ = std::move(blocks_.front());
    blocks_.pop_front();
    ++returned_;
    return std::move(returned_block_.data);
  }

 private:
  /// The blocks that the reader has read last; null: none.
  [[nodiscard]] vtkMultiBlockDataSet* output() const {
    return algorithm_ ? vtkMultiBlockDataSet::SafeDownCast(algorithm_->GetOutputDataObject(0)) : reader_->output();
  }

  struct Block {
    std::unique_ptr<DataSet> data;
    std::uint64_t number = 0;  // as Piece::block
    DeclaredArrays declared = {};
  };

  /// Appends a portion's blocks to blocks_.
  Status read_portion() {
    SPLATVOL_TRY(run_vtk(file_.path, [&] {
      reader_->read(portion_++, time_of(step_));
      if (auto* tree = output()) {
        collect(*tree);
        tree->Initialize();
      }
      std::ranges::move(reader_->take_patches(), std::back_inserter(patches_));
    }));
    return {};
  }

  /// Appends the blocks of a tree that are not surfaces.
  void collect(vtkMultiBlockDataSet& tree) {
    BlockNumbers numbers;
    const auto entry = vtkSmartPointer<vtkCompositeDataIterator>::Take(tree.NewIterator());
    for (entry->InitTraversal(); !entry->IsDoneWithTraversal(); entry->GoToNextItem()) {
      auto* data = vtkDataSet::SafeDownCast(entry->GetCurrentDataObject());
      if (!data || data->GetNumberOfPoints() == 0) continue;
      auto block = data_set_sharing_arrays(*data);
      std::vector<std::string> path;
      const bool is_named = find_path(tree, *data, path);
      if (!is_surface(*block)) {
        const std::uint64_t number = numbers.next(is_named ? reader_->block_name(path) : "");
        blocks_.push_back({std::move(block), number, reader_->declared(*data)});
        continue;
      }
      left_out_ += census_of(*block);
      if (!file_.patches)
        left_out_.left_out += block->cell_count();
      else if (is_named)
        add_patch(reader_->patch_name(path), *block);
    }
  }

  void add_patch(const std::string& name, const DataSet& surface) {
    if (name.empty()) return;
    Patch patch{name, {}};
    append_surface_cells(surface, patch.mesh);
    if (!patch.mesh.triangles.empty()) patches_.push_back(std::move(patch));
  }

  /// Null: the block has no name.
  static const char* name_of(vtkMultiBlockDataSet& tree, unsigned int block) {
    return tree.HasMetaData(block) ? tree.GetMetaData(block)->Get(vtkCompositeDataSet::NAME()) : nullptr;
  }

  /// Appends the names of the blocks that hold a data set, and its own. Returns whether there is one.
  static bool find_path(vtkMultiBlockDataSet& tree, vtkDataSet& data, std::vector<std::string>& path) {
    for (unsigned int i = 0; i < tree.GetNumberOfBlocks(); ++i) {
      if (!contains(tree.GetBlock(i), data)) continue;
      const char* name = name_of(tree, i);
      path.emplace_back(name && *name ? name : "unnamed");
      auto* inner = vtkMultiBlockDataSet::SafeDownCast(tree.GetBlock(i));
      return !inner || find_path(*inner, data, path);
    }
    return false;
  }

  static bool contains(vtkDataObject* object, vtkDataSet& data) {
    auto* tree = vtkMultiBlockDataSet::SafeDownCast(object);
    for (unsigned int i = 0; tree && i < tree->GetNumberOfBlocks(); ++i)
      if (contains(tree->GetBlock(i), data)) return true;
    return object == &data;
  }

  InputFile file_;
  SourceOptions options_;
  std::unique_ptr<BlockReader> reader_;
  vtkMultiBlockDataSetAlgorithm* algorithm_ = nullptr;  // of reader_; null: it has no pipeline
  std::optional<TimeStep> step_;
  std::optional<bool> has_finer_points_;  // once it is known
  int portion_ = 0;                       // the next to be read
  std::size_t returned_ = 0;
  CellCensus left_out_;
  CellCensus changes_;          // not taken yet
  std::deque<Block> blocks_;    // read and not returned yet
  Block returned_block_;        // the last one, without its data
  std::vector<Patch> patches_;  // read and not taken yet
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

Result<std::unique_ptr<DataSets>> open_blocks(const InputFile& file, const SourceOptions& options,
                                              std::unique_ptr<BlockReader> reader) {
  auto blocks = std::make_unique<BlockDataSets>(file, options, std::move(reader));
  SPLATVOL_TRY(blocks->open());
  return blocks;
}

}  // namespace splatvol
