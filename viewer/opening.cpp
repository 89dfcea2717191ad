#include "viewer/opening.h"

#include <filesystem>
#include <limits>
#include <span>
#include <system_error>
#include <utility>

#include "base/addresses.h"
#include "base/interruption.h"
#include "base/temporary_names.h"

namespace splatvol {
namespace {

using Count = std::shared_ptr<std::atomic<std::uint64_t>>;

// Counts the bytes that are read of a file.
class CountingSource final : public ByteSource {
 public:
  CountingSource(std::unique_ptr<ByteSource> source, Count count)
      : source_(std::move(source)), count_(std::move(count)) {}
  [[nodiscard]] std::uint64_t size() const override { return source_->size(); }
  [[nodiscard]] std::uint64_t cheap_gap() const override { return source_->cheap_gap(); }
  [[nodiscard]] const std::string& name() const override { return source_->name(); }
  [[nodiscard]] Status read(std::uint64_t offset, std::span<std::byte> out) override {
    SPLATVOL_TRY(source_->read(offset, out));
    *count_ += out.size();
    return {};
  }
  [[nodiscard]] Result<bool> read_parts(std::span<const Part> parts) override {
    SPLATVOL_TRY_ASSIGN(read, source_->read_parts(parts));
    if (read)
      for (const Part& part : parts) *count_ += part.out.size();
    return read;
  }

 private:
  std::unique_ptr<ByteSource> source_;
  Count count_;
};

}  // namespace

Opening::Opening(SessionHost& host, const SceneUse& asked, const std::string& scene_path, const ViewSettings& settings,
                 bool all_steps)
    : path_(asked.file.empty() ? scene_path : asked.file), asked_(asked), scene_path_(scene_path), settings_(settings) {
  const auto tell = [told = told_](const ConversionProgress& progress) {
    const std::lock_guard lock(told->mutex);
    told->conversion = progress;
  };
  if (settings.works_aside) {
    std::error_code error;
    const auto folder = std::filesystem::temp_directory_path(error);
    preview_ = temporary_name_beside((error ? "/tmp" : folder) / "preview") + ".svol";
    note_temporary(preview_);
  }
  const auto open_counted = [count = bytes_read_](const std::string& file) -> Result<std::unique_ptr<ByteSource>> {
    SPLATVOL_TRY_ASSIGN(source, open_file_or_url(file));
    return std::make_unique<CountingSource>(std::move(source), count);
  };
  const auto read = [=, conversion = Conversion{tell, preview_, all_steps}] {
    return Session::read(asked, scene_path, settings, open_counted, conversion);
  };
  file_ = {host, read};
}

Opening::~Opening() {
  file_.interrupt();
  // svbuild may be about to give the file its name.
  if (!preview_.empty() && file_.is_begun()) static_cast<void>(file_.wait(std::numeric_limits<double>::infinity()));
  end_preview();
}

// A file that is open needs no name.
void Opening::end_preview() {
  if (preview_.empty()) return;
  std::error_code ignored;
  std::filesystem::remove(preview_, ignored);
  forget_temporary(std::exchange(preview_, ""));
}

std::optional<ConversionProgress> Opening::conversion() const {
  const std::lock_guard lock(told_->mutex);
  return told_->conversion;
}

std::unique_ptr<Opening> Opening::open_preview(SessionHost& host) {
  const std::optional<ConversionProgress> told = conversion();
  if (preview_.empty() || !told || !told->has_preview || is_preview_begun_) return nullptr;
  is_preview_begun_ = true;
  SceneUse use = asked_;
  use.file = preview_;
  use.pieces.clear();
  use.step.reset();
  return std::make_unique<Opening>(host, use, scene_path_, settings_);
}

}  // namespace splatvol
