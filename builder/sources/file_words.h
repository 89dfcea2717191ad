// Words, lines and bytes of a file, one after the other.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "base/file.h"

namespace splatvol {

/// Whether a whole word is a number in decimal digits, nan or inf.
[[nodiscard]] bool is_number(std::string_view word);

/// Reads a file forwards, in large portions. Words and lines of any length are safe: only their first 4096 bytes are
/// kept. A file that cannot be read seems to end there.
class FileWords {
 public:
  explicit FileWords(std::unique_ptr<ByteSource> file) : file_(std::move(file)) {}

  [[nodiscard]] bool at_end() { return !fill(); }
  [[nodiscard]] std::uint64_t size() const { return file_->size(); }
  [[nodiscard]] std::uint64_t offset() const { return offset_ + at_; }

  /// The next word, in lower case; empty at the end.
  std::string next();

  /// The next word as it is; empty at the end.
  std::string name();

  /// The rest of the line, without its end.
  std::string line();

  /// Whether the last line() or integers_in_line() had an end, and not only the file.
  [[nodiscard]] bool ended_line() const { return ended_line_; }

  /// Skips the rest of the line, of any length, and returns how many integers it holds; nothing if it holds another
  /// word.
  std::optional<std::uint64_t> integers_in_line();

  /// The next `count` bytes, or fewer at the end of the file.
  std::string bytes(std::size_t count);

  /// A number of `bytes` bytes, the highest first; short at the end of the file.
  std::uint64_t number(std::size_t bytes);

  /// Skips `count` words, or bytes, or lines with their ends. Returns whether there were so many.
  bool skip_words(std::uint64_t count);
  bool skip_bytes(std::uint64_t count);
  bool skip_lines(std::uint64_t count);

  /// Skips up to `count` words that are numbers. Returns how many there were before the end, or before another word.
  std::uint64_t skip_numbers(std::uint64_t count);

  void skip_white_space();

  void move_to(std::uint64_t offset);

 private:
  /// Whether there is a byte at at_, which is read if it must be.
  bool fill() { return at_ < text_.size() || refill(); }
  bool refill();

  std::unique_ptr<ByteSource> file_;
  std::uint64_t offset_ = 0;  // of text_ in the file
  std::string text_;
  std::size_t at_ = 0;
  bool ended_line_ = true;
};

}  // namespace splatvol
