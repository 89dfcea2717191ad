// A check of JSON text before it is parsed.
#pragma once

#include <cstddef>
#include <string_view>

namespace splatvol {

/// Whether lists and objects of JSON text are nested deeper than `levels`. A few bytes of such text could exhaust the
/// stack of a function that walks, copies or writes the tree. Takes time in proportion to the text. The result means
/// nothing for text that is no JSON.
[[nodiscard]] inline bool is_nested_deeper(std::string_view text, int levels) {
  int depth = 0;
  bool in_string = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (c == '"') in_string = !in_string;
    if (in_string && c == '\\') ++i;
    if (in_string) continue;
    if ((c == '[' || c == '{') && ++depth > levels) return true;
    if (c == ']' || c == '}') --depth;
  }
  return false;
}

}  // namespace splatvol
