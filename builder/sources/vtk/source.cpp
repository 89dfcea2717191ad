#include "builder/sources/vtk/source.h"

#include <vtkCellData.h>
#include <vtkDataSet.h>
#include <vtkSmartPointer.h>

#include <algorithm>
#include <utility>

#include "base/names.h"
#include "builder/sources/vtk/attributes.h"
#include "builder/sources/vtk/piece.h"
#include "builder/sources/vtk/plot3d_reader.h"
#include "builder/sources/vtk/reader.h"

namespace splatvol {
namespace {

tl::unexpected<Error> fail_no_point_data(const std::string& path, vtkDataSet& data) {
  std::string names;
  for (int i = 0; i < data.GetCellData()->GetNumberOfArrays(); ++i)
    names += fmt::format("{}{}", names.empty() ? "" : ", ", data.GetCellData()->GetArrayName(i));
  if (names.empty()) return fail(ErrorCode::invalid_data, "{}: the mesh has no point data", path);
  return fail(ErrorCode::invalid_data, "{}: the mesh has no point data, only cell data ({}), which is not supported",
              path, names);
}

std::vector<std::string> names_of(const std::vector<VtkAttribute>& attributes) {
  std::vector<std::string> names;
  for (const VtkAttribute& attribute : attributes) names.push_back(attribute.name);
  return names;
}

class VtkSource final : public Source {
 public:
  explicit VtkSource(std::unique_ptr<VtkDataSets> data_sets, std::optional<TimeStep> step = {})
      : data_sets_(std::move(data_sets)), step_(step) {}

  const std::vector<std::string>& attributes() const override { return names_; }
  std::vector<std::string> units() const override { return units_; }
  std::size_t piece_count() const override { return data_sets_->count(); }
  std::optional<TimeStep> time_step() const override { return step_ ? step_ : data_sets_->time_step(); }

  /// Reads the first piece with points, which fixes the attributes. Sets `missing` to the first selected name that is
  /// not among them.
  Status start(const std::vector<std::string>& selection, std::string& missing) {
    SPLATVOL_TRY(load());
    if (!pending_ && data_sets_->surfaces() > 0)
      return fail(ErrorCode::invalid_data, "{}: only surfaces ({} blocks); splatvol draws volumes", data_sets_->path(),
                  data_sets_->surfaces());
    if (!pending_) return fail(ErrorCode::invalid_data, "{}: the mesh has no points", data_sets_->path());
    const std::vector<VtkAttribute> all = attributes_of(*pending_);
    if (all.empty() && selection.empty()) return fail_no_point_data(data_sets_->path(), *pending_);
    available_ = names_of(all);
    if (const auto duplicate = find_duplicate(available_))
      return fail(ErrorCode::invalid_data, "{}: two attributes are called \"{}\"", data_sets_->path(), *duplicate);
    if (selection.empty()) attributes_ = all;
    for (const std::string& name : selection) {
      const auto attribute = std::ranges::find(all, name, &VtkAttribute::name);
      if (attribute == all.end() && missing.empty()) missing = name;
      if (attribute != all.end()) attributes_.push_back(*attribute);
    }
    names_ = names_of(attributes_);
    for (const VtkAttribute& attribute : attributes_) {
      const std::string unit = data_sets_->unit(attribute.array);
      units_.push_back(unit.empty() ? unit_label(*pending_, attribute.array) : unit);
    }
    return {};
  }

  /// The names of all attributes that were read of the first piece, selected or not.
  [[nodiscard]] const std::vector<std::string>& available() const { return available_; }

  Result<std::unique_ptr<Piece>> next() override {
    if (!pending_) SPLATVOL_TRY(load());
    if (!pending_) return std::unique_ptr<Piece>();
    const vtkSmartPointer<vtkDataSet> data = std::exchange(pending_, nullptr);
    return make_piece(data_sets_->path(), *data, attributes_);
  }

 private:
  /// Sets pending_ to the next data set that has points, or to null.
  Status load() {
    do {
      SPLATVOL_TRY_ASSIGN(data, data_sets_->next());
      pending_ = data;
    } while (pending_ && pending_->GetNumberOfPoints() == 0);
    return {};
  }

  std::unique_ptr<VtkDataSets> data_sets_;
  std::optional<TimeStep> step_;  // instead of that of data_sets_
  std::vector<VtkAttribute> attributes_;
  std::vector<std::string> names_;      // of attributes_
  std::vector<std::string> units_;      // of attributes_
  std::vector<std::string> available_;  // of the first piece
  vtkSmartPointer<vtkDataSet> pending_;
};

}  // namespace

Result<std::unique_ptr<Source>> open_vtk_files(std::vector<VtkFile> files, const std::vector<std::string>& selection,
                                               std::optional<double> time, std::optional<TimeStep> step) {
  auto source = std::make_unique<VtkSource>(read_vtk_files(files, selection, time), step);
  std::string missing;
  SPLATVOL_TRY(source->start(selection, missing));
  if (missing.empty()) return source;

  // Only the selected arrays were read; the message lists all.
  const std::string path = files.front().path;
  SPLATVOL_TRY_ASSIGN(all, open_vtk_files(std::move(files), {}, time));
  return fail_no_attribute(path, missing, all->attributes());
}

Result<std::unique_ptr<Source>> open_plot3d(const std::string& grid, const std::string& solution,
                                            const std::vector<std::string>& selection) {
  SPLATVOL_TRY_ASSIGN(blocks, read_plot3d(grid, solution));
  auto source = std::make_unique<VtkSource>(std::move(blocks));
  std::string missing;
  SPLATVOL_TRY(source->start(selection, missing));
  if (!missing.empty()) return fail_no_attribute(grid, missing, source->available());
  return source;
}

}  // namespace splatvol
