// Numbers of bytes in words.
#pragma once

#include <fmt/format.h>

#include <array>
#include <cstddef>
#include <string>

namespace splatvol {

/// Returns a number of bytes with three digits, or all before the point, in the unit that suits it: "1.5 MiB".
[[nodiscard]] inline std::string byte_text(double bytes) {
  constexpr std::array units = {"B", "KiB", "MiB", "GiB", "TiB"};
  std::size_t unit = 0;
  for (; bytes >= 1024 && unit + 1 < units.size(); ++unit) bytes /= 1024;
  return fmt::format("{:.{}g} {}", bytes, bytes < 999.5 ? 3 : 4, units[unit]);
}

}  // namespace splatvol
