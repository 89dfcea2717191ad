#include "builder/sources/vtk/blocks.h"

#include <vtkCellData.h>
#include <vtkCompositeDataIterator.h>
#include <vtkDataArray.h>
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
#include "builder/sources/time_steps.h"
#include "builder/sources/vtk/attributes.h"
#include "builder/sources/vtk/block_reader.h"
#include "builder/sources/vtk/cell_counts.h"
#include "builder/sources/vtk/messages.h"
#include "builder/sources/vtk/patch.h"
#include "builder/sources/vtk/piece.h"
#include "builder/sources/vtk/shared_points.h"

namespace splatvol {
namespace {

/// The times of the steps that a reader found in its file.
std::vector<double> times_of(vtkAlgorithm& algorithm) {
  vtkInformation* information = algorithm.GetOutputInformation(0);
  const int count = information->Length(vtkStreamingDemandDrivenPipeline::TIME_STEPS());
  const double* first = information->Get(vtkStreamingDemandDrivenPipeline::TIME_STEPS());
  return count > 0 ? std::vector<double>(first, first + count) : std::vector<double>();
}

/// Null for files of other kinds.
std::unique_ptr<BlockReader> make_block_reader(VtkFile::Kind kind) {
  switch (kind) {
    case VtkFile::Kind::cgns:
      return make_cgns_reader();
    case VtkFile::Kind::ensight:
      return make_ensight_reader();
    case VtkFile::Kind::exodus:
      return make_exodus_reader();
    case VtkFile::Kind::openfoam:
      return make_openfoam_reader();
    default:
      return nullptr;
  }
}

std::optional<double> time_of(const std::optional<TimeStep>& step) {
  return step ? std::optional(step->time) : std::nullopt;
}

/// The blocks of one file.
class BlockDataSets final : public VtkDataSets {
 public:
  BlockDataSets(VtkFile file, const SourceOptions& options)
      : file_(std::move(file)), options_(options), missing_(options.missing), reader_(make_block_reader(file_.kind)) {}

  Status open() {
    SPLATVOL_TRY(reader_->check(file_.path, options_));
    SPLATVOL_TRY(run_vtk(file_.path, [&] {
      algorithm_ = reader_->open(file_.path);
      if (file_.patches) reader_->want_patches();
      if (options_.may_round) reader_->allow_rounding();
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
    SPLATVOL_TRY(arrays.add(file_.path, wanted(std::move(announced))));
    SPLATVOL_TRY(arrays.add(file_.path, shared_arrays_.arrays()));
    for (const Block& block : blocks_) SPLATVOL_TRY(arrays.add(file_.path, wanted(array_shapes(*block.data))));
    return {};
  }

  std::size_t count() const override {
    return returned_ + blocks_.size() + static_cast<std::size_t>(std::max(0, reader_->portions() - portion_));
  }
  const std::string& path() const override { return file_.path; }
  std::string unit(const std::string& array) const override { return reader_->unit(array); }
  std::optional<TimeStep> time_step() const override { return step_; }
  CellCensus left_out() const override { return left_out_; }
  std::set<std::string> notes() const override { return reader_->notes(); }
  std::set<std::string> left_out_arrays() const override { return reader_->left_out_arrays(); }
  std::uint64_t block() const override { return returned_block_.number; }
  DeclaredArrays declared() const override { return returned_block_.declared; }
  std::size_t blocks() const override { return file_.kind == VtkFile::Kind::openfoam ? 1 : count(); }
  std::string block_word() const override { return file_.kind == VtkFile::Kind::ensight ? "part" : "block"; }
  std::size_t block_in_file() const override {
    return blocks() == 1 ? 1 : reader_->portions() > 1 ? static_cast<std::size_t>(portion_) : returned_;
  }
  CellCensus take_changes() override {
    CellCensus changes = std::exchange(changes_, {});
    changes += reader_->take_changes();
    return changes;
  }
  std::vector<Patch> take_patches() override { return std::exchange(patches_, {}); }
  bool averages_by_data_set() const override { return !reader_->portions_share_points(); }
  bool rounds_points() const override { return reader_->rounds_points(); }
  Result<bool> has_finer_points() override {
    if (!has_finer_points_)
      SPLATVOL_TRY(run_vtk(file_.path, [&] { has_finer_points_ = reader_->has_finer_points(time_of(step_)); }));
    return *has_finer_points_;
  }
  void share_means(vtkDataSet& data, const std::string& array, int component, std::span<double> means) const override {
    shared_.apply(data, returned_block_.name, array, component, means);
  }

  Result<vtkSmartPointer<vtkDataSet>> next() override {
    if (portion_ == 0 && options_.cells == CellValues::averaged && reader_->portions_share_points())
      SPLATVOL_TRY(share_points());
    while (blocks_.empty() && portion_ < reader_->portions()) SPLATVOL_TRY(read_portion());
    if (blocks_.empty()) return vtkSmartPointer<vtkDataSet>();
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
    vtkSmartPointer<vtkDataSet> data;
    std::string name;          // of the top block that holds it
    std::uint64_t number = 0;  // as Piece::block
    DeclaredArrays declared = {};
  };

  /// Reads all portions once, for the values at the points that several have.
  Status share_points() {
    for (int portion = 0; portion < reader_->portions(); ++portion) {
      SPLATVOL_TRY(run_vtk(file_.path, [&] {
        reader_->read(portion, time_of(step_));
        if (auto* tree = output()) collect(*tree);
      }));
      for (const Block& block : blocks_) {
        SPLATVOL_TRY(shared_arrays_.add(file_.path, wanted(array_shapes(*block.data))));
        const std::vector<vtkDataArray*> arrays = arrays_of_cells(*block.data);
        if (arrays.empty()) continue;
        SPLATVOL_TRY_ASSIGN(averages, make_averages(file_.path, *block.data));
        SPLATVOL_TRY(run_vtk(file_.path, [&] { shared_.add(*block.data, block.name, averages, arrays, missing_); }));
      }
      blocks_.clear();
      patches_.clear();
    }
    left_out_ = {};
    shared_.finish();
    return {};
  }

  /// The whole arrays of cells that are selected.
  [[nodiscard]] std::vector<vtkDataArray*> arrays_of_cells(vtkDataSet& data) const {
    vtkDataSetAttributes& all = arrays_of(data, true);
    std::vector<vtkDataArray*> arrays;
    for (int i = 0; i < all.GetNumberOfArrays(); ++i) {
      vtkDataArray* array = all.GetArray(i);
      if (!array || !array->GetName() || array->GetNumberOfTuples() < data.GetNumberOfCells()) continue;
      if (!is_bookkeeping(all, i, array->GetName()) && wants_array(options_.selection, array->GetName()))
        arrays.push_back(array);
    }
    return arrays;
  }

  [[nodiscard]] std::vector<ArrayShape> wanted(std::vector<ArrayShape> shapes) const {
    std::erase_if(shapes, [&](const ArrayShape& shape) { return !wants_array(options_.selection, shape.name); });
    return shapes;
  }

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
      if (is_surface(*data)) {
        left_out_ += census_of(*data);
        if (file_.patches)
          add_patch(tree, *data);
        else
          left_out_.left_out += static_cast<std::uint64_t>(data->GetNumberOfCells());
        continue;
      }
      std::vector<std::string> path;
      const std::uint64_t number = numbers.next(find_path(tree, *data, path) ? reader_->block_name(path) : "");
      blocks_.push_back({copy_sharing_arrays(*data), name_of_top(tree, *data), number, reader_->declared(*data)});
    }
  }

  void add_patch(vtkMultiBlockDataSet& tree, vtkDataSet& data) {
    std::vector<std::string> path;
    if (!find_path(tree, data, path)) return;
    const std::string name = reader_->patch_name(path);
    if (name.empty()) return;
    Patch patch{name, {}};
    append_surface_cells(data, patch.mesh);
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

  /// The name of the top block that holds a data set: in OpenFOAM, its region.
  static std::string name_of_top(vtkMultiBlockDataSet& tree, vtkDataSet& data) {
    for (unsigned int i = 0; i < tree.GetNumberOfBlocks(); ++i)
      if (const char* name = name_of(tree, i); name && contains(tree.GetBlock(i), data)) return name;
    return {};
  }

  static bool contains(vtkDataObject* object, vtkDataSet& data) {
    auto* tree = vtkMultiBlockDataSet::SafeDownCast(object);
    for (unsigned int i = 0; tree && i < tree->GetNumberOfBlocks(); ++i)
      if (contains(tree->GetBlock(i), data)) return true;
    return object == &data;
  }

  VtkFile file_;
  SourceOptions options_;
  MissingValues missing_;
  std::unique_ptr<BlockReader> reader_;
  vtkMultiBlockDataSetAlgorithm* algorithm_ = nullptr;  // of reader_; null: it is one of our own
  std::optional<TimeStep> step_;
  ArrayUnion shared_arrays_;              // of portions that were read by share_points()
  std::optional<bool> has_finer_points_;  // once it is known
  int portion_ = 0;                       // the next to be read
  std::size_t returned_ = 0;
  CellCensus left_out_;
  CellCensus changes_;          // not taken yet
  std::deque<Block> blocks_;    // read and not returned yet
  Block returned_block_;        // the last one, without its data
  std::vector<Patch> patches_;  // read and not taken yet
  SharedPoints shared_;
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

Result<std::unique_ptr<VtkDataSets>> open_blocks(const VtkFile& file, const SourceOptions& options) {
  auto blocks = std::make_unique<BlockDataSets>(file, options);
  SPLATVOL_TRY(blocks->open());
  return blocks;
}

}  // namespace splatvol
