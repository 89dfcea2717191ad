#include "builder/sources/read_text.h"

#include <algorithm>
#include <cctype>
#include <span>

namespace splatvol {

Result<std::string> read_text(ByteSource& file, std::uint64_t offset, std::uint64_t most) {
  offset = std::min(offset, file.size());
  std::string text(std::min(most, file.size() - offset), '\0');
  SPLATVOL_TRY(file.read(offset, std::as_writable_bytes(std::span(text))));
  return text;
}

Result<std::string> read_text(const std::string& path, std::uint64_t most) {
  SPLATVOL_TRY_ASSIGN(file, open_file(path));
  return read_text(*file, 0, most);
}

bool is_white_space(char c) { return std::isspace(static_cast<unsigned char>(c)) != 0; }

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && is_white_space(text.front())) text.remove_prefix(1);
  while (!text.empty() && is_white_space(text.back())) text.remove_suffix(1);
  return text;
}

std::string_view take_line(std::string_view& text) {
  const std::string_view line = text.substr(0, text.find('\n'));
  text.remove_prefix(std::min(line.size() + 1, text.size()));
  return line;
}

bool is_one_of(std::string_view word, std::initializer_list<std::string_view> words) {
  return std::ranges::find(words, word) != words.end();
}

std::uint64_t number_in(std::string_view bytes, bool big_endian) {
  std::uint64_t number = 0;
  for (std::size_t i = 0; i < bytes.size(); ++i)
    number = number << 8 | static_cast<unsigned char>(bytes[big_endian ? i : bytes.size() - 1 - i]);
  return number;
}

tl::unexpected<Error> fail_byte_order_mark(const std::string& path) {
  return fail(ErrorCode::invalid_data,
              "{}: a byte order mark stands in front of the text, and VTK's reader takes it for a word: remove it by "
              "sed '1s/^\\xef\\xbb\\xbf//' {} > OUT",
              path, path);
}

}  // namespace splatvol
