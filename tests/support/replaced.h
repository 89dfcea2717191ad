// Texts of tests, and what they become.
#pragma once

#include <string>
#include <string_view>

namespace splatvol::test {

/// Returns a text with `to` instead of the first `from`, which must be there.
inline std::string replaced(std::string text, std::string_view from, std::string_view to) {
  return text.replace(text.find(from), from.size(), to);
}

}  // namespace splatvol::test
