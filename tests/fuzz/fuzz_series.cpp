// The index of a series of files, and the metadata of files and steps: read, written, and read again. The first
// character tells which.
#include <memory>
#include <string>

#include "base/file.h"
#include "format/series_index.h"
#include "format/steps.h"
#include "format/volume_info.h"
#include "tests/fuzz/fuzz.h"

using namespace splatvol;
using namespace splatvol::format;
using splatvol::fuzz::require;
using splatvol::fuzz::require_ok;

namespace {

class TextSource final : public ByteSource {
 public:
  explicit TextSource(std::string text) : text_(std::move(text)) {}
  [[nodiscard]] std::uint64_t size() const override { return text_.size(); }
  [[nodiscard]] const std::string& name() const override { return name_; }
  Status read(std::uint64_t offset, std::span<std::byte> out) override {
    SPLATVOL_TRY(check_range(*this, offset, out.size()));
    std::memcpy(out.data(), text_.data() + offset, out.size());
    return {};
  }

 private:
  std::string text_;
  std::string name_ = "fuzz";
};

void check_index(const std::string& text) {
  const auto index = series_index_from_json(text);
  if (!index) return;
  const std::string written = to_json(*index);
  const auto again = series_index_from_json(written);
  require_ok(again, "a written index can be read");
  for (const SeriesIndex::Step& step : index->steps)
    require(step.file.find('\0') == std::string::npos, "the system takes all of a name");
  require(to_json(*again) == written, "an index comes back");

  // Steps that are no files.
  const auto steps =
      Steps::open("folder/fuzz.svols", [&](const std::string& path) -> Result<std::unique_ptr<ByteSource>> {
        return std::make_unique<TextSource>(path == "folder/fuzz.svols" ? text : "no file");
      });
  require_ok(steps, "an index can be opened");
  for (std::size_t step = 0; step < std::min<std::size_t>(steps->times().size() + 1, 3); ++step)
    require(!steps->volume(step), "a step that is no file is refused");
  require(!steps->verify([](double) {}), "steps that are no files are not accepted");
  for (const std::string& name : steps->attributes()) static_cast<void>(steps->range_of(name));
}

// The description of a series, for its steps.
VolumeInfo series_of_two() {
  VolumeInfo info;
  info.cube = {{0, 0, 0}, 1};
  info.resolution_counts = {10, 100};
  info.points_per_chunk = {64, 64};
  info.columns = {{ColumnKind::position, ColumnScope::segment, -1}};
  info.series = {{"p", "Pa"}, {"T", ""}};
  return info;
}

void check_metadata(const std::string& text) {
  const auto info = metadata_from_json(text);
  if (!info) return;
  const auto written = metadata_to_json(*info);
  if (std::ranges::find(info->columns, ColumnKind::unknown, &Column::kind) != info->columns.end()) return;
  require_ok(written, "metadata that was read can be written");
  const auto again = metadata_from_json(*written);
  require_ok(again, "written metadata can be read");
  const auto last = metadata_to_json(*again);
  require(last && *last == *written, "metadata comes back");

  // Numbers of rows and chunks, by arithmetic alone.
  const RowLayout rows(*info);
  require(rows.row_count() > 0 && rows.group_count() > 0, "a file has rows");
  for (const std::uint64_t row : {std::uint64_t{0}, rows.row_count() / 2, rows.row_count() - 1}) {
    const std::size_t resolution = rows.resolution_of_row(row);
    require(resolution < info->resolutions(), "a row has a resolution");
    require(rows.row(resolution, rows.group_of_row(row)) == row, "a row has a number");
    const Group group = rows.group(rows.group_of_row(row));
    require(group.count > 0 && group.segment <= resolution, "a group has points");
  }
}

void check_step(const std::string& text) {
  static const VolumeInfo info = series_of_two();
  const auto step = step_from_json(text, info);
  if (!step) return;
  const auto written = step_to_json(*step, info);
  if (std::ranges::find(step->columns, ColumnKind::unknown, &Column::kind) != step->columns.end()) return;
  require_ok(written, "a step that was read can be written");
  const auto again = step_from_json(*written, info);
  require_ok(again, "a written step can be read");
  const auto last = step_to_json(*again, info);
  require(last && *last == *written, "a step comes back");
  require(at_step(info, *step).attributes.size() == 2, "a step has the attributes of its series");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::string text(reinterpret_cast<const char*>(data) + 1, size - 1);
  if (data[0] == 'i') check_index(text);
  if (data[0] == 'm') check_metadata(text);
  if (data[0] == 's') check_step(text);
  return 0;
}
