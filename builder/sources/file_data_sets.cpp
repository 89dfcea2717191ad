#include "builder/sources/file_data_sets.h"

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <utility>

#include "builder/sources/block_numbers.h"
#include "builder/sources/cell_counts.h"

namespace splatvol {
namespace {

/// Files in their order; the data sets of a file one by one.
class FileDataSets final : public DataSets {
 public:
  FileDataSets(std::vector<InputFile> files, const SourceOptions& options)
      : files_(std::move(files)), options_(options) {}

  /// The blocks that a composite file names.
  FileDataSets(const InputFile& composite, const SourceOptions& options) : FileDataSets(composite.blocks, options) {
    path_ = composite.path;
    is_composite_ = true;
    for (InputFile& file : files_) file.is_block = true;
  }

  std::size_t count() const override {
    const std::size_t blocks = blocks_ ? std::max<std::size_t>(blocks_->count(), 1) - 1 : 0;
    return files_.size() + extra_pieces_ + blocks;
  }
  const std::string& path() const override { return path_; }
  std::optional<TimeStep> time_step() const override { return step_; }
  CellCensus left_out() const override {
    CellCensus all = left_out_;
    if (blocks_) all += blocks_->left_out();
    return all;
  }
  std::set<std::string> notes() const override {
    std::set<std::string> all = notes_;
    if (blocks_) all.merge(blocks_->notes());
    return all;
  }
  std::set<std::string> left_out_arrays() const override {
    std::set<std::string> all = left_out_arrays_;
    if (blocks_) all.merge(blocks_->left_out_arrays());
    return all;
  }

  std::vector<Patch> take_patches() override {
    std::vector<Patch> patches = std::exchange(patches_, {});
    if (blocks_) std::ranges::move(blocks_->take_patches(), std::back_inserter(patches));
    return patches;
  }

  Status announce(ArrayUnion& arrays) override {
    for (std::size_t file = 0; file < files_.size(); ++file) {
      const bool is_current = file + 1 == file_;
      if (is_current && blocks_) SPLATVOL_TRY(blocks_->announce(arrays));
      if (!is_current || (blocks_ && files_[file].reader.list_arrays && in_file_ < blocks_->count()))
        SPLATVOL_TRY(announce_file(files_[file], arrays));
    }
    return {};
  }

  CellCensus take_changes() override {
    CellCensus changes = std::exchange(changes_, {});
    if (blocks_) changes += blocks_->take_changes();
    return changes;
  }

  bool averages_by_data_set() const override { return !blocks_ || blocks_->averages_by_data_set(); }
  bool rounds_points() const override { return blocks_ && blocks_->rounds_points(); }
  Result<bool> has_finer_points() override { return blocks_ ? blocks_->has_finer_points() : Result<bool>(false); }

  std::vector<std::uint64_t> part_sizes() const override {
    std::vector<std::uint64_t> bytes;
    if (files_.size() < 2) return bytes;
    for (const InputFile& file : files_) bytes.push_back(size_of(file));
    return bytes;
  }

  void select(const std::vector<std::uint64_t>& files) override {
    selected_ = files;
    if (file_ > 0 && !is_selected(file_ - 1)) blocks_ = nullptr;
  }

  Source::PieceNumber number() const override { return {static_cast<std::uint32_t>(file_ - 1), in_file_ - 1}; }

  DeclaredArrays declared() const override { return blocks_ ? blocks_->declared() : DeclaredArrays(); }

  std::uint64_t block() const override { return inner_block(files_[file_ - 1].block, blocks_ ? blocks_->block() : 0); }

  std::size_t blocks() const override {
    if (!files_.empty() && files_[0].is_composite()) return blocks_in(files_[0]);
    return blocks_ ? blocks_->blocks() : 1;
  }
  std::string block_word() const override { return blocks_ ? blocks_->block_word() : "block"; }
  std::size_t block_in_file() const override {
    std::size_t before = 0;
    for (std::size_t file = 0; is_composite_ && file + 1 < file_; ++file) before += blocks_in(files_[file]);
    return before + (blocks_ ? blocks_->block_in_file() : 1);
  }
  std::span<const int> blocks_of_cells() const override {
    return blocks_ ? blocks_->blocks_of_cells() : std::span<const int>();
  }

  Result<std::unique_ptr<DataSet>> next() override {
    for (;;) {
      SPLATVOL_TRY_ASSIGN(data, next_of_file());
      ++in_file_;
      if (!data || !files_[file_ - 1].is_block) return data;
      bool used = false;
      SPLATVOL_TRY(data->guard(path_, [&] {
        used = data->point_count() > 0 && !is_surface(*data);
        if (!used) left_out_ += census_of(*data);
      }));
      if (used) return data;
      left_out_.left_out += data->cell_count();
    }
  }

 private:
  Status announce_file(const InputFile& file, ArrayUnion& arrays) const {
    if (!file.reader.list_arrays) {
      SPLATVOL_TRY_ASSIGN(blocks, open(file));
      return blocks->announce(arrays);
    }
    SPLATVOL_TRY_ASSIGN(parts, file.reader.list_arrays(file));
    for (std::vector<ArrayShape>& part : parts)
      SPLATVOL_TRY(arrays.add(file.path, wanted_solutions(std::move(part), options_.selection)));
    return {};
  }

  static std::size_t blocks_in(const InputFile& file) {
    if (!file.is_composite()) return 1;
    std::size_t blocks = 0;
    for (const InputFile& block : file.blocks) blocks += blocks_in(block);
    return blocks;
  }

  [[nodiscard]] bool is_selected(std::size_t file) const {
    return !selected_ || std::ranges::binary_search(*selected_, file);
  }

  // In bytes, with the files that it names; 0 for what has no size, such as a folder.
  static std::uint64_t size_of(const InputFile& file) {
    std::error_code error;
    const std::uint64_t own = std::filesystem::file_size(file.path, error);
    std::uint64_t bytes = error ? 0 : own;
    for (const InputFile& block : file.blocks) bytes += size_of(block);
    return bytes;
  }

  Result<std::unique_ptr<DataSet>> next_of_file() {
    for (;;) {
      if (blocks_) {
        SPLATVOL_TRY_ASSIGN(block, blocks_->next());
        if (block) return block;
        extra_pieces_ += std::max<std::size_t>(blocks_->count(), 1) - 1;
        left_out_ += blocks_->left_out();
        notes_.merge(blocks_->notes());
        left_out_arrays_.merge(blocks_->left_out_arrays());
        changes_ += blocks_->take_changes();
        std::ranges::move(blocks_->take_patches(), std::back_inserter(patches_));
        blocks_ = nullptr;
      }
      while (file_ < files_.size() && !is_selected(file_)) ++file_;
      if (file_ == files_.size()) return std::unique_ptr<DataSet>();
      const InputFile& file = files_[file_++];
      in_file_ = 0;
      path_ = file.path;
      SPLATVOL_TRY_SET(blocks_, open(file));
      if (!step_ && !file.is_composite()) step_ = blocks_->time_step();
    }
  }

  [[nodiscard]] Result<std::unique_ptr<DataSets>> open(const InputFile& file) const {
    if (file.is_composite()) return std::make_unique<FileDataSets>(file, options_);
    return file.reader.open(file, options_);
  }

  std::vector<InputFile> files_;
  SourceOptions options_;
  bool is_composite_ = false;  // the files are blocks
  std::optional<TimeStep> step_;
  std::size_t file_ = 0;                                // the next one
  std::uint32_t in_file_ = 0;                           // data sets of the current file so far
  std::optional<std::vector<std::uint64_t>> selected_;  // numbers of files; none: all
  std::size_t extra_pieces_ = 0;                        // of opened files, besides one for each
  std::string path_;                                    // of the current file
  CellCensus left_out_;                                 // of the files before the current one
  std::set<std::string> notes_, left_out_arrays_;       // of these files
  CellCensus changes_;                                  // of these files, not taken yet
  std::vector<Patch> patches_;                          // of these files, not taken yet
  std::unique_ptr<DataSets> blocks_;                    // of the current file, while it has blocks left
};

}  // namespace

std::unique_ptr<DataSets> read_files(std::vector<InputFile> files, const SourceOptions& options) {
  return std::make_unique<FileDataSets>(std::move(files), options);
}

}  // namespace splatvol
