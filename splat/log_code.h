// Log codes: positive numbers in 16 bits, at equal ratios (spec/svol-1.md, section 8).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace splatvol {

/// A code is 0, or stands for scale 2^((code - 65535) / 128).
inline constexpr unsigned largest_log_code = 65535;
inline constexpr unsigned log_codes_per_octave = 128;

/// Returns the number of a log code.
[[nodiscard]] inline double log_number(unsigned code, double scale) {
  if (code == 0) return 0;
  return scale * std::exp2((static_cast<double>(code) - largest_log_code) / log_codes_per_octave);
}

/// Returns the log code nearest to a number: at least 1 if number > 0, at most 65535. Requires scale >= 0.
[[nodiscard]] inline std::uint16_t log_code(double number, double scale) {
  if (!(number > 0) || !(scale > 0)) return 0;
  const double code = largest_log_code + log_codes_per_octave * (std::log2(number) - std::log2(scale));
  return static_cast<std::uint16_t>(std::lround(std::clamp(code, 1.0, double{largest_log_code})));
}

}  // namespace splatvol
