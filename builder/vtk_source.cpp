#include "builder/vtk_source.h"

#include <vtkCellData.h>
#include <vtkDataSet.h>
#include <vtkSmartPointer.h>

#include <algorithm>
#include <utility>

#include "base/names.h"
#include "builder/vtk_channels.h"
#include "builder/vtk_piece.h"

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

std::vector<std::string> names_of(const std::vector<VtkChannel>& channels) {
  std::vector<std::string> names;
  for (const VtkChannel& channel : channels) names.push_back(channel.name);
  return names;
}

class VtkSource final : public Source {
 public:
  explicit VtkSource(std::unique_ptr<VtkDataSets> data_sets) : data_sets_(std::move(data_sets)) {}

  const std::vector<std::string>& attributes() const override { return names_; }
  std::size_t piece_count() const override { return data_sets_->count(); }
  std::optional<TimeStep> time_step() const override { return data_sets_->time_step(); }

  /// Reads the first piece with points, which says what attributes there are. `missing` gets the first selected name
  /// that is not among them.
  Status start(const std::vector<std::string>& selection, std::string& missing) {
    SPLATVOL_TRY(load());
    if (!pending_) return fail(ErrorCode::invalid_data, "{}: the mesh has no points", data_sets_->path());
    const std::vector<VtkChannel> channels = channels_of(*pending_);
    if (channels.empty() && selection.empty()) return fail_no_point_data(data_sets_->path(), *pending_);
    available_ = names_of(channels);
    if (const auto duplicate = find_duplicate(available_))
      return fail(ErrorCode::invalid_data, "{}: two attributes are called \"{}\"", data_sets_->path(), *duplicate);
    if (selection.empty()) channels_ = channels;
    for (const std::string& name : selection) {
      const auto channel = std::ranges::find(channels, name, &VtkChannel::name);
      if (channel == channels.end() && missing.empty()) missing = name;
      if (channel != channels.end()) channels_.push_back(*channel);
    }
    names_ = names_of(channels_);
    return {};
  }

  /// The names of all scalars that were read of the first piece, selected or not.
  [[nodiscard]] const std::vector<std::string>& available() const { return available_; }

  Result<std::unique_ptr<Piece>> next() override {
    if (!pending_) SPLATVOL_TRY(load());
    if (!pending_) return std::unique_ptr<Piece>();
    const vtkSmartPointer<vtkDataSet> data = std::exchange(pending_, nullptr);
    return make_piece(data_sets_->path(), *data, channels_);
  }

 private:
  /// Into pending_: the next data set that has points, or none.
  Status load() {
    do {
      SPLATVOL_TRY_ASSIGN(data, data_sets_->next());
      pending_ = data;
    } while (pending_ && pending_->GetNumberOfPoints() == 0);
    return {};
  }

  std::unique_ptr<VtkDataSets> data_sets_;
  std::vector<VtkChannel> channels_;
  std::vector<std::string> names_;      // of channels_
  std::vector<std::string> available_;  // of the first piece
  vtkSmartPointer<vtkDataSet> pending_;
};

}  // namespace

Result<std::unique_ptr<Source>> open_vtk_files(std::vector<VtkFile> files, const std::vector<std::string>& selection,
                                               std::optional<double> time) {
  auto source = std::make_unique<VtkSource>(read_vtk_files(files, selection, time));
  std::string missing;
  SPLATVOL_TRY(source->start(selection, missing));
  if (missing.empty()) return source;

  // Only the selected arrays were read; the message wants them all.
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
