#include "scene/ticks.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace splatvol {
namespace {

std::string superscript(int number) {
  constexpr std::array<const char*, 10> digits = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  std::string text;
  for (const char digit : fmt::format("{}", number)) text += digit == '-' ? "⁻" : digits[std::size_t(digit - '0')];
  return text;
}

// Returns 1, 2 or 5 times a power of ten, so that at most `most` steps are in an interval of this width.
double round_step(double width, int most) {
  const double least = width / most;
  const double power = std::pow(10, std::floor(std::log10(least)));
  for (const double digit : {1.0, 2.0, 5.0})
    if (digit * power >= least * (1 - 1e-9)) return digit * power;
  return 10 * power;
}

// Values from a thousandth up to a hundred thousand are written as they are.
int common_exponent(double largest) {
  const int exponent = static_cast<int>(std::floor(std::log10(largest)));
  return exponent < -3 || exponent > 5 ? exponent : 0;
}

std::string label_of(double number, int decimals) {
  const std::string text = fmt::format("{:.{}f}", number, decimals);
  return text.find_first_not_of("-0.") == std::string::npos ? text.substr(text.front() == '-' ? 1 : 0) : text;
}

}  // namespace

Ticks ticks_between(double low, double high, int most) {
  Ticks ticks;
  const double largest = std::max(std::abs(low), std::abs(high));
  const int exponent = common_exponent(largest);
  // Halves, so that no power overflows or vanishes.
  const double unit = std::pow(10, exponent / 2), rest = std::pow(10, exponent - exponent / 2);
  ticks.exponent = exponent;
  if (exponent != 0) ticks.factor = "× 10" + superscript(exponent);
  const double from = low / unit / rest, to = high / unit / rest, step = round_step(to - from, most);
  const int decimals = std::clamp(static_cast<int>(std::ceil(-std::log10(step) - 1e-9)), 0, 15);
  const double first = std::ceil(from / step - 1e-9), last = std::floor(to / step + 1e-9);
  for (double i = first; i <= last; ++i)
    ticks.list.push_back({std::clamp(i * step * unit * rest, low, high), label_of(i * step, decimals)});
  if (ticks.list.size() < 2) ticks.list = {{low, label_of(from, decimals + 1)}, {high, label_of(to, decimals + 1)}};
  return ticks;
}

}  // namespace splatvol
