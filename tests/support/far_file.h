// A source that is far.
#pragma once

#include <gtest/gtest.h>

#include <atomic>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>

#include "base/file.h"

namespace splatvol::test {

/// A file as on a web server, which counts requests.
class FarFile final : public ByteSource {
 public:
  struct Counts {
    std::atomic<std::uint64_t> requests = 0, bytes = 0;
  };
  /// `knows_parts`: whether a request may name several ranges.
  FarFile(const std::string& path, bool knows_parts, std::shared_ptr<Counts> counts)
      : file_(open_file(path).value()), knows_parts_(knows_parts), counts_(std::move(counts)) {}

  [[nodiscard]] std::uint64_t size() const override { return file_->size(); }
  [[nodiscard]] const std::string& name() const override { return file_->name(); }
  [[nodiscard]] std::uint64_t cheap_gap() const override { return std::uint64_t{64} << 10; }
  [[nodiscard]] Status read(std::uint64_t offset, std::span<std::byte> out) override {
    ++counts_->requests;
    counts_->bytes += out.size();
    return file_->read(offset, out);
  }
  [[nodiscard]] bool may_read_parts() const override { return knows_parts_; }
  [[nodiscard]] Result<bool> read_parts(std::span<const Part> parts) override {
    if (!knows_parts_) return false;
    ++counts_->requests;
    std::uint64_t end = 0;
    for (const Part& part : parts) {
      EXPECT_GE(part.offset, end);
      end = part.offset + part.out.size();
      counts_->bytes += part.out.size();
      SPLATVOL_TRY(file_->read(part.offset, part.out));
    }
    return true;
  }

 private:
  std::unique_ptr<ByteSource> file_;
  bool knows_parts_;
  std::shared_ptr<Counts> counts_;
};

}  // namespace splatvol::test
