// Round numbers along an axis, and how to write them.
#pragma once

#include <string>
#include <vector>

#include "scene/transfer_function.h"

namespace splatvol {

struct Tick {
  double value;
  std::string label;
};

/// The ticks of an axis. A value is its label times the factor, and the offset added.
struct Ticks {
  std::vector<Tick> list;  // ascending
  int exponent = 0;        // of the factor, a power of ten
  std::string factor;      // such as "× 10⁵¹", "+ 101325" or "× 10⁻⁴ + 101325"; empty: 1 and 0
};

/// Returns at most `most` + 1 ticks at round values in [low, high], at least two. Works for any finite numbers, of any
/// size: a power of ten that all have in common is the factor, and digits that all have in common are the offset.
/// Requires low < high, most >= 2.
[[nodiscard]] Ticks ticks_between(double low, double high, int most);

/// Returns how many significant digits tell values of a range apart, to some thousandths of it: 5 to 17.
[[nodiscard]] int digits_of_range(double low, double high);

/// Returns ticks for the domain of a transfer function, on its axis. On a bent axis these are powers of ten (and their
/// negatives, and 0), evenly thinned out to about `most`; twice and five times these too where a domain has fewer than
/// two. Requires lo < hi, most >= 2.
[[nodiscard]] Ticks ticks_of(const TransferFunction& function, int most);

}  // namespace splatvol
