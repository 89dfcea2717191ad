// Round numbers along an axis, and how to write them.
#pragma once

#include <string>
#include <vector>

namespace splatvol {

struct Tick {
  double value;
  std::string label;
};

/// The ticks of an axis. A value is its label times the factor.
struct Ticks {
  std::vector<Tick> list;  // ascending
  int exponent = 0;        // of the factor, a power of ten
  std::string factor;      // such as "× 10⁵¹"; empty: 1
};

/// Returns at most `most` + 1 ticks at round values in [low, high], at least two. Works for any finite numbers, of any
/// size: a power of ten that all have in common is the factor. Requires low < high, most >= 2.
[[nodiscard]] Ticks ticks_between(double low, double high, int most);

}  // namespace splatvol
