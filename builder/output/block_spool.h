// Bytes that wait to be read once.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/temp_file.h"
#include "format/codec.h"

namespace splatvol {

/// A queue of bytes in a temporary file, which is made when the first MiB is full.
class BlockSpool {
 public:
  explicit BlockSpool(std::string folder) : folder_(std::move(folder)) {}

  /// Appends bytes that belong together.
  [[nodiscard]] Status append(std::span<const std::byte> bytes) {
    buffer_.insert(buffer_.end(), bytes.begin(), bytes.end());
    return buffer_.size() < buffer_bytes ? Status{} : flush();
  }

  /// Returns the next bytes, some MiB, empty after the last: those of one append() are never divided. Gives their disk
  /// space back. They are valid until the next call. Requires that append() is not called any more.
  [[nodiscard]] Result<std::span<const std::byte>> next() {
    if (next_ < blocks_.size()) {
      const Block& block = blocks_[next_++];
      read_.resize(block.bytes);
      SPLATVOL_TRY(file_->read(offset_, read_));
      if (format::hash_bytes(read_) != block.hash) return fail_changed_temporary();
      file_->release(offset_, block.bytes);
      offset_ += block.bytes;
    } else {
      read_ = std::exchange(buffer_, {});
    }
    return std::span<const std::byte>(read_);
  }

  /// Calls visit(bytes) for what next() returns.
  [[nodiscard]] Status read(const std::function<Status(std::span<const std::byte>)>& visit) {
    for (;;) {
      SPLATVOL_TRY_ASSIGN(bytes, next());
      if (bytes.empty()) return {};
      SPLATVOL_TRY(visit(bytes));
    }
  }

 private:
  static constexpr std::size_t buffer_bytes = std::size_t{1} << 20;
  // Bytes written at once. Their hash is checked first: a bad disk must not decide how much memory a value takes.
  struct Block {
    std::uint64_t bytes, hash;
  };

  Status flush() {
    if (!file_) {
      SPLATVOL_TRY_ASSIGN(file, TempFile::create(folder_));
      file_.emplace(std::move(file));
    }
    SPLATVOL_TRY(file_->append(buffer_));
    blocks_.push_back({buffer_.size(), format::hash_bytes(buffer_)});
    buffer_.clear();
    return {};
  }

  std::string folder_;
  std::optional<TempFile> file_;
  std::vector<Block> blocks_;
  format::Bytes buffer_;
  std::size_t next_ = 0;      // block
  std::uint64_t offset_ = 0;  // of that block
  format::Bytes read_;
};

}  // namespace splatvol
