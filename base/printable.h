// Texts that come from files and servers: a terminal would obey their control characters.
#pragma once

#include <string>
#include <string_view>

namespace splatvol {

/// Returns a text without control characters and without bytes that are no UTF-8: `?` stands for each. Line breaks
/// stay.
[[nodiscard]] std::string printable(std::string_view text);

/// The same, with `?` for line breaks too.
[[nodiscard]] std::string one_line(std::string_view text);

/// Returns a text in UTF-8: bytes that are none are taken for Latin-1, as programs of Windows write it.
[[nodiscard]] std::string as_utf8(std::string_view text);

}  // namespace splatvol
