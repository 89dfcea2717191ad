#include "builder/sources/vtk/source.h"

#include <vtkDataArray.h>
#include <vtkDataSet.h>
#include <vtkFieldData.h>
#include <vtkSmartPointer.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <set>
#include <utility>

#include "base/names.h"
#include "builder/sources/repeated_pieces.h"
#include "builder/sources/vtk/attributes.h"
#include "builder/sources/vtk/piece.h"
#include "builder/sources/vtk/plot3d_reader.h"
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
  VtkSource(std::unique_ptr<VtkDataSets> data_sets, CellValues cells, const MissingValues& missing,
            std::optional<TimeStep> step = {})
      : data_sets_(std::move(data_sets)),
        own_cells_(cells == CellValues::own),
        cells_(cells),
        missing_(missing),
        step_(std::move(step)) {}

  const std::vector<std::string>& attributes() const override { return names_; }
  std::vector<std::string> units() const override { return units_; }
  std::vector<int> components() const override { return components_of(attributes_); }
  void lend_values() override { lends_ = true; }
  std::size_t piece_count() const override { return data_sets_->count(); }
  std::optional<TimeStep> time_step() const override { return step_ ? step_ : data_sets_->time_step(); }
  std::optional<double> stated_time() const override { return time_step() ? Source::stated_time() : time_; }

  /// Reads the first piece with points, which fixes the attributes. Sets `missing` to the first selected name that is
  /// not among them.
  Status start(const std::vector<std::string>& selection, std::string& missing) {
    SPLATVOL_TRY(load());
    if (!pending_) return fail_no_points();
    time_ = time_in_fields(*pending_);
    SPLATVOL_TRY_ASSIGN(all, attributes_of(data_sets_->path(), *pending_, cells_));
    if (all.empty() && selection.empty())
      return fail(ErrorCode::invalid_data, "{}: the mesh has no arrays of numbers at its points or cells",
                  data_sets_->path());
    available_ = names_of(all);
    if (const auto duplicate = find_duplicate(available_))
      return fail(ErrorCode::invalid_data, "{}: two attributes are called \"{}\"", data_sets_->path(), *duplicate);
    attributes_ = select_attributes(all, selection, cells_, missing);
    names_ = names_of(attributes_);
    for (const ArrayAttribute& attribute : attributes_) {
      const std::string unit = data_sets_->unit(attribute.array);
      units_.push_back(unit.empty() ? unit_label(*pending_, attribute.array) : unit);
    }
    return {};
  }

  /// The names of all attributes that were read of the first piece, selected or not.
  [[nodiscard]] const std::vector<std::string>& available() const { return available_; }

  Result<std::unique_ptr<Piece>> next() override {
    if (!pending_) SPLATVOL_TRY(load());
    if (!pending_ && own_cells_ && points_ == 0 && !selects_)
      return fail(ErrorCode::invalid_data, "{}: no cells with a volume, which '--cells own' needs", data_sets_->path());
    if (!pending_) return std::unique_ptr<Piece>();
    const vtkSmartPointer<vtkDataSet> data = std::exchange(pending_, nullptr);
    number_ = pending_number_;
    SPLATVOL_TRY_ASSIGN(piece, make_piece(
                                   data_sets_->path(), *data, attributes_, cells_, missing_,
                                   [&](const std::string& array, int component, std::span<double> means) {
                                     data_sets_->share_means(*data, array, component, means);
                                   },
                                   lends_));
    piece->patches = data_sets_->take_patches();
    SPLATVOL_TRY(repeats_.add(data_sets_->path(), *piece));
    points_ += piece->points.size();
    note_conversions(*data);
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
           std::ranges::any_of(attributes_, [](const ArrayAttribute& attribute) { return attribute.of_cells; });
  }

  std::vector<std::string> conversions() const override {
    std::string names;
    for (const std::string& array : names_of(attributes_))
      if (converted_.contains(array)) names += fmt::format("{}{}", names.empty() ? "" : ", ", array);
    if (names.empty()) return {};
    return {names + (own_cells_ ? ": of points, averaged to cells" : ": of cells, averaged to points")};
  }

 private:
  [[nodiscard]] tl::unexpected<Error> fail_no_points() const {
    const std::string surfaces = describe_no_volume(data_sets_->left_out());
    if (surfaces.empty()) return fail(ErrorCode::invalid_data, "{}: the mesh has no points", data_sets_->path());
    return fail(ErrorCode::invalid_data, "{}: {}; splatvol draws volumes", data_sets_->path(), surfaces);
  }

  /// Notes the attributes whose values are those of cells instead of points, or the other way round. A vector's
  /// components go with its magnitude.
  void note_conversions(vtkDataSet& data) {
    std::set<std::string> vectors;
    for (std::size_t a = 0; a < attributes_.size(); ++a) {
      const auto values = find_values({}, data, attributes_, a);
      if (!values || values->of_cells == own_cells_) continue;
      if (attributes_[a].component == ArrayAttribute::magnitude) vectors.insert(attributes_[a].array);
      if (attributes_[a].components == 1 || attributes_[a].component == ArrayAttribute::magnitude ||
          !vectors.contains(attributes_[a].array))
        converted_.insert(attributes_[a].name);
    }
  }

  /// Sets pending_ to the next data set that has points, or to null.
  Status load() {
    do {
      SPLATVOL_TRY_ASSIGN(data, data_sets_->next());
      pending_ = data;
      pending_number_ = data_sets_->number();
    } while (pending_ && pending_->GetNumberOfPoints() == 0);
    return {};
  }

  std::unique_ptr<VtkDataSets> data_sets_;
  bool own_cells_;
  CellValues cells_;
  bool lends_ = false;  // values
  MissingValues missing_;
  std::uint64_t points_ = 0;         // of the pieces so far
  std::set<std::string> converted_;  // attributes
  std::optional<TimeStep> step_;     // instead of that of data_sets_
  std::vector<ArrayAttribute> attributes_;
  std::vector<std::string> names_;      // of attributes_
  std::vector<std::string> units_;      // of attributes_
  std::vector<std::string> available_;  // of the first piece
  std::optional<double> time_;          // that the first piece states
  vtkSmartPointer<vtkDataSet> pending_;
  PieceNumber pending_number_, number_;  // of pending_, and of the last piece
  bool selects_ = false;                 // some files
  RepeatedPieces repeats_;
};

}  // namespace

Result<std::unique_ptr<Source>> open_vtk_files(std::vector<VtkFile> files, const std::vector<std::string>& selection,
                                               std::optional<double> time, CellValues cells,
                                               const MissingValues& missing_values,
                                               const std::optional<TimeStep>& step) {
  auto source = std::make_unique<VtkSource>(read_vtk_files(files, selection, time, cells, missing_values), cells,
                                            missing_values, step);
  std::string missing;
  SPLATVOL_TRY(source->start(selection, missing));
  if (missing.empty()) return source;

  // Only the selected arrays were read; the message lists all.
  const std::string path = files.front().path;
  SPLATVOL_TRY_ASSIGN(all, open_vtk_files(std::move(files), {}, time, cells, missing_values));
  return fail_no_attribute(path, missing, all->attributes());
}

Result<std::unique_ptr<Source>> open_plot3d(const std::string& grid, const std::string& solution,
                                            const std::vector<std::string>& selection, CellValues cells,
                                            const MissingValues& missing_values) {
  SPLATVOL_TRY_ASSIGN(blocks, read_plot3d(grid, solution));
  auto source = std::make_unique<VtkSource>(std::move(blocks), cells, missing_values);
  std::string missing;
  SPLATVOL_TRY(source->start(selection, missing));
  if (!missing.empty()) return fail_no_attribute(grid, missing, source->available());
  return source;
}

}  // namespace splatvol
