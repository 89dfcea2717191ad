#include "viewer/opening.h"

#include <span>
#include <utility>

#include "base/http_source.h"
#include "base/interruption.h"

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

Opening::Opening(SessionHost& host, const SceneUse& asked, const std::string& scene_path, const ViewSettings& settings)
    : path_(asked.file.empty() ? scene_path : asked.file) {
  const auto open_counted = [count = bytes_read_](const std::string& file) -> Result<std::unique_ptr<ByteSource>> {
    SPLATVOL_TRY_ASSIGN(source, open_file_or_url(file));
    return std::make_unique<CountingSource>(std::move(source), count);
  };
  const auto read = [=, stop = stop_.get_token()] {
    const Interruptible interruptible(stop);
    return Session::read(asked, scene_path, settings, open_counted);
  };
  file_ = {host, read};
}

}  // namespace splatvol
