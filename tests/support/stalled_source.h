// A source whose reads wait.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>

#include "base/file.h"
#include "base/interruption.h"

namespace splatvol::test {

/// While `stalls`, reads wait as from a server that has stalled, until they are let go or interrupted. `waiting` counts
/// them.
class StalledSource final : public ByteSource {
 public:
  StalledSource(std::unique_ptr<ByteSource> content, std::atomic<bool>& stalls, std::atomic<int>& waiting)
      : content_(std::move(content)), stalls_(stalls), waiting_(waiting) {}
  std::uint64_t size() const override { return content_->size(); }
  const std::string& name() const override { return content_->name(); }
  Status read(std::uint64_t offset, std::span<std::byte> out) override {
    ++waiting_;
    while (stalls_ && !is_interrupted()) sleep_interruptibly(std::chrono::milliseconds(10));
    --waiting_;
    if (is_interrupted()) return fail(ErrorCode::io, "{}: interrupted", name());
    return content_->read(offset, out);
  }

 private:
  std::unique_ptr<ByteSource> content_;
  std::atomic<bool>& stalls_;
  std::atomic<int>& waiting_;
};

/// Opens a file as a StalledSource.
inline Result<std::unique_ptr<ByteSource>> open_stalled(const std::string& path, std::atomic<bool>& stalls,
                                                        std::atomic<int>& waiting) {
  SPLATVOL_TRY_ASSIGN(content, open_file(path));
  return std::make_unique<StalledSource>(std::move(content), stalls, waiting);
}

}  // namespace splatvol::test
