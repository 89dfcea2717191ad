// Parts of files as text, and what a text says.
#pragma once

#include <charconv>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>

#include "base/error.h"
#include "base/file.h"

namespace splatvol {

/// Reads `most` bytes from `offset` on, or fewer at the end of the file.
[[nodiscard]] Result<std::string> read_text(ByteSource& file, std::uint64_t offset, std::uint64_t most);

/// Reads the file at `path`, or its first `most` bytes.
[[nodiscard]] Result<std::string> read_text(const std::string& path,
                                            std::uint64_t most = std::numeric_limits<std::uint64_t>::max());

/// Stands in front of a text that a program has written as UTF-8 with a mark, and means nothing there.
inline constexpr std::string_view byte_order_mark = "\xef\xbb\xbf";

[[nodiscard]] inline std::string_view without_byte_order_mark(std::string_view text) {
  if (text.starts_with(byte_order_mark)) text.remove_prefix(byte_order_mark.size());
  return text;
}

/// The error of a text with a byte order mark, where a reader of VTK's would take the mark for a word.
[[nodiscard]] tl::unexpected<Error> fail_byte_order_mark(const std::string& path);

[[nodiscard]] bool is_white_space(char c);

/// Returns a text without the white space round it.
[[nodiscard]] std::string_view trimmed(std::string_view text);

/// Removes the first line of a text, and returns it without its end.
std::string_view take_line(std::string_view& text);

[[nodiscard]] bool is_one_of(std::string_view word, std::initializer_list<std::string_view> words);

/// Returns the number that a whole word is; nothing if it is anything else.
template <class T>
std::optional<T> number_of(std::string_view word) {
  T number{};
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), number);
  return error == std::errc() && end == word.data() + word.size() ? std::optional(number) : std::nullopt;
}

/// Whether a file begins like HDF5.
[[nodiscard]] inline bool is_hdf5(std::string_view start) { return start.starts_with("\x89HDF\r\n\x1a\n"); }

/// Whether a file begins like one of NetCDF's own formats, which Exodus uses.
[[nodiscard]] inline bool is_netcdf(std::string_view start) {
  return start.size() > 3 && start.starts_with("CDF") && (start[3] == 1 || start[3] == 2 || start[3] == 5);
}

/// Returns the number that some bytes are, at most eight.
[[nodiscard]] std::uint64_t number_in(std::string_view bytes, bool big_endian);

}  // namespace splatvol
