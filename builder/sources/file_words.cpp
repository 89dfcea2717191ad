#include "builder/sources/file_words.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <system_error>
#include <utility>

#include "base/names.h"
#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

constexpr std::uint64_t read_at_once = 1 << 20;
constexpr std::size_t longest_word = 4096;  // names of arrays

}  // namespace

bool is_number(std::string_view word) {
  if (word.starts_with('+')) word.remove_prefix(1);
  double number = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), number);
  return error != std::errc::invalid_argument && end == word.data() + word.size();
}

void FileWords::skip_white_space() {
  while (fill() && is_white_space(text_[at_])) ++at_;
}

std::string FileWords::next() { return in_lower_case(name()); }

std::string FileWords::name() {
  skip_white_space();
  std::string word;
  for (; fill() && !is_white_space(text_[at_]); ++at_)
    if (word.size() < longest_word) word += text_[at_];
  return word;
}

std::string FileWords::line() {
  std::string line;
  for (; fill() && text_[at_] != '\n'; ++at_)
    if (line.size() < longest_word) line += text_[at_];
  ended_line_ = fill();
  if (ended_line_) ++at_;
  return line;
}

std::optional<std::uint64_t> FileWords::integers_in_line() {
  std::uint64_t count = 0;
  bool in_word = false, integers = true;
  for (; fill() && text_[at_] != '\n'; ++at_) {
    const char c = text_[at_];
    const bool is_digit = c >= '0' && c <= '9', is_sign = (c == '-' || c == '+') && !in_word;
    count += !in_word && !is_white_space(c) ? 1 : 0;
    in_word = !is_white_space(c);
    integers = integers && (!in_word || is_digit || is_sign);
  }
  ended_line_ = fill();
  if (ended_line_) ++at_;
  return integers ? std::optional(count) : std::nullopt;
}

std::string FileWords::bytes(std::size_t count) {
  std::string bytes;
  for (; bytes.size() < count && fill(); ++at_) bytes += text_[at_];
  return bytes;
}

std::uint64_t FileWords::number(std::size_t bytes) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < bytes && fill(); ++i) value = value << 8 | static_cast<unsigned char>(text_[at_++]);
  return value;
}

bool FileWords::skip_words(std::uint64_t count) {
  for (; count > 0; --count) {
    skip_white_space();
    if (!fill()) return false;
    while (fill() && !is_white_space(text_[at_])) ++at_;
  }
  return true;
}

std::uint64_t FileWords::skip_numbers(std::uint64_t count) {
  std::array<char, 64> word{};
  for (std::uint64_t i = 0; i < count; ++i) {
    skip_white_space();
    std::size_t length = 0;
    for (; fill() && !is_white_space(text_[at_]); ++at_)
      if (length < word.size()) word[length++] = text_[at_];
    if (!is_number({word.data(), length})) return i;
  }
  return count;
}

bool FileWords::skip_bytes(std::uint64_t count) {
  if (count > file_->size() - std::min(offset(), file_->size())) return false;
  move_to(offset() + count);
  return true;
}

bool FileWords::skip_lines(std::uint64_t count) {
  for (; count > 0; --count) {
    std::size_t end = std::string::npos;
    while (fill() && (end = text_.find('\n', at_)) == std::string::npos) at_ = text_.size();
    if (end == std::string::npos) return false;
    at_ = end + 1;
  }
  return true;
}

void FileWords::move_to(std::uint64_t offset) {
  if (offset >= offset_ && offset <= offset_ + text_.size()) {
    at_ = static_cast<std::size_t>(offset - offset_);
    return;
  }
  offset_ = offset;
  text_.clear();
  at_ = 0;
}

bool FileWords::refill() {
  offset_ += text_.size();
  at_ = 0;
  text_.clear();
  if (offset_ >= file_->size()) return false;
  auto text = read_text(*file_, offset_, read_at_once);
  if (text) text_ = std::move(*text);
  return !text_.empty();
}

}  // namespace splatvol
