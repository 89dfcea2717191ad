#include "builder/sources/data_sets_source.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cstdint>
#include <set>
#include <utility>

#include "base/names.h"
#include "builder/mesh/single_precision.h"
#include "builder/sources/array_union.h"
#include "builder/sources/file_data_sets.h"
#include "builder/sources/piece_maker.h"
#include "builder/sources/repeated_pieces.h"

namespace splatvol {
namespace {

class DataSetsSource final : public Source {
 public:
  DataSetsSource(const std::vector<InputFile>& files, const SourceOptions& options, std::optional<TimeStep> step,
                 InputLists lists)
      : files_(files),
        data_sets_(read_files(files, options)),
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
    time_ = pending_->stated_time();
    const std::string path = data_sets_->path();
    SPLATVOL_TRY(arrays_.add(path, pending_->arrays()));
    SPLATVOL_TRY(arrays_.add(path, wanted(pending_declared_.arrays)));
    SPLATVOL_TRY(data_sets_->announce(arrays_));
    find_declared_by_lists();
    SPLATVOL_TRY_ASSIGN(all, arrays_.attributes(path, options_.cells));
    if (all.empty()) SPLATVOL_TRY_SET(all, make_attribute());
    attributes_ = select_attributes(all, options_.selection, options_.cells, missing, options_.may_lack);
    names_ = names_of(attributes_);
    for (const ArrayAttribute& attribute : attributes_) units_.push_back(arrays_.unit(attribute.array));
    return {};
  }

  Result<std::unique_ptr<Piece>> next() override {
    if (!pending_) SPLATVOL_TRY(load());
    if (!pending_ && own_cells_ && points_ == 0 && !selects_)
      return fail(ErrorCode::invalid_data, "{}: no cells with a volume{}", data_sets_->path(),
                  numbers_blocks_ ? ", and no values; splatvol draws volumes" : ", which '--cells own' needs");
    if (!pending_) return std::unique_ptr<Piece>();
    const std::unique_ptr<DataSet> data = std::move(pending_);
    number_ = pending_number_;
    const DeclaredArrays declared = std::exchange(pending_declared_, {});
    const std::uint64_t block = data_sets_->block();
    if (numbers_blocks_) add_block_number(*data);
    SPLATVOL_TRY(arrays_.check(data_sets_->path(), wanted(data->arrays())));
    SPLATVOL_TRY_ASSIGN(piece, make(*data));
    piece->block = block;
    SPLATVOL_TRY(measure_rounding(*piece));
    piece->patches = data_sets_->take_patches();
    piece->census += data_sets_->take_changes();
    if (files_.size() > 1) SPLATVOL_TRY(repeats_.add(data_sets_->path(), *piece));
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
  Result<std::unique_ptr<Piece>> make(const DataSet& data) const {
    const std::string& path = data_sets_->path();
    Result<std::unique_ptr<Piece>> piece;
    SPLATVOL_TRY(data.guard(
        path, [&] { piece = make_piece(path, data, attributes_, options_.cells, missing_, lends_, whole_cells_); }));
    return piece;
  }

  /// Makes an attribute for a mesh without values: the numbers of its blocks, or the volumes of its cells.
  Result<std::vector<ArrayAttribute>> make_attribute() {
    if (pending_->cell_count() == 0)
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
    const std::unique_ptr<DataSets> again = read_files(files_, options_);
    for (std::set<std::size_t> blocks;;) {
      SPLATVOL_TRY_ASSIGN(data, again->next());
      if (!data || again->number().file > 0) return false;
      if (data->point_count() > 0) blocks.insert(again->block_in_file());
      if (blocks.size() > 1) return true;
    }
  }

  void add_block_number(DataSet& data) const {
    std::vector<double> numbers(data.cell_count(), static_cast<double>(data_sets_->block_in_file()));
    std::ranges::copy(data_sets_->blocks_of_cells(), numbers.begin());
    data.add_cell_values(data_sets_->block_word(), std::move(numbers));
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

  /// Those that the selection needs. Some readers read all.
  [[nodiscard]] std::vector<ArrayShape> wanted(std::vector<ArrayShape> shapes) const {
    return wanted_solutions(std::move(shapes), options_.selection);
  }

  /// Those names of attributes that are in a set.
  [[nodiscard]] std::vector<std::string> in_order(const std::set<std::string>& names) const {
    std::vector<std::string> ordered = names_;
    std::erase_if(ordered, [&](const std::string& name) { return !names.contains(name); });
    return ordered;
  }

  /// Notes the attributes whose values are those of cells instead of points, or the other way round, and those that a
  /// piece lacks, but not those of `undelivered` arrays. A vector's components go with its magnitude.
  void note_differences(const DataSet& data, const std::set<std::string>& undelivered) {
    std::set<std::string> vectors;
    for (const ArrayAttribute& attribute : attributes_) {
      if (attribute.is_volume && !own_cells_) converted_.insert(attribute.name);
      if (attribute.is_volume) continue;
      const auto values = find_array({}, data, attribute);
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
  std::set<std::string> note_losses(const DataSet& data, const DeclaredArrays& declared,
                                    std::set<std::string>& losses) {
    std::set<std::string> undelivered;
    const std::string& path = data_sets_->path();
    for (const ArrayShape& array : wanted(declared.arrays)) {
      const auto has = [&](bool of_cells) { return data.array(array.name, of_cells).has_value(); };
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
      SPLATVOL_TRY_SET(pending_, data_sets_->next());
      pending_number_ = data_sets_->number();
      pending_declared_ = data_sets_->declared();
    } while (pending_ && pending_->point_count() == 0);
    return {};
  }

  std::vector<InputFile> files_;
  std::unique_ptr<DataSets> data_sets_;
  SourceOptions options_;
  bool own_cells_;
  bool lends_ = false;  // values
  bool whole_cells_ = false;
  MissingValues missing_;
  std::uint64_t points_ = 0;                   // of the pieces so far
  std::set<std::string> converted_, lacking_;  // attributes
  InputLists lists_;
  std::set<std::string> losses_of_lists_;  // not told yet
  std::string made_;                       // what is said of an attribute that the source made; empty: it made none
  bool numbers_blocks_ = false;            // in an array of the cells
  std::optional<TimeStep> step_;           // instead of that of data_sets_
  ArrayUnion arrays_;                      // of all pieces
  std::vector<ArrayAttribute> attributes_;
  std::vector<std::string> names_;  // of attributes_
  std::vector<std::string> units_;  // of attributes_
  std::optional<double> time_;      // that the first piece states
  std::unique_ptr<DataSet> pending_;
  PieceNumber pending_number_, number_;  // of pending_, and of the last piece
  DeclaredArrays pending_declared_;      // for pending_
  bool selects_ = false;                 // some files
  RepeatedPieces repeats_;
};

}  // namespace

Result<std::unique_ptr<Source>> open_files(std::vector<InputFile> files, const SourceOptions& options,
                                           const std::optional<TimeStep>& step, InputLists lists) {
  auto source = std::make_unique<DataSetsSource>(files, options, step, std::move(lists));
  std::string missing;
  SPLATVOL_TRY(source->start(missing));
  if (missing.empty() || options.may_lack) return source;

  // Only the selected arrays were read; the message lists all.
  const std::string path = files.front().path;
  SourceOptions without_selection = options;
  without_selection.selection.clear();
  SPLATVOL_TRY_ASSIGN(all, open_files(std::move(files), without_selection));
  return fail_no_attribute(path, missing, all->attributes());
}

}  // namespace splatvol
