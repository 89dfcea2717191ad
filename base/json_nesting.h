// A check of JSON text before it is parsed.
#pragma once

#include <cstddef>
#include <string_view>

namespace splatvol {

/// Whether lists and objects of a JSON text nest at most so deep. A few bytes of deep nesting could exhaust the stack
/// of a function that walks the tree. Takes any text.
[[nodiscard]] inline bool nests_at_most(std::string_view text, int levels) {
  int depth = 0;
  bool in_string = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (c == '"') in_string = !in_string;
    if (in_string && c == '\\') ++i;
    if (in_string) continue;
    if ((c == '[' || c == '{') && ++depth > levels) return false;
    if (c == ']' || c == '}') --depth;
  }
  return true;
}

}  // namespace splatvol
