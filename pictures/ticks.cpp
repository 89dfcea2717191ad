#include "pictures/ticks.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <initializer_list>

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

// Writes digit times 10^exponent.
std::string label_of_power(int digit, int exponent, bool plain) {
  if (plain) return fmt::format("{:.{}f}", digit * std::pow(10, exponent), std::max(-exponent, 0));
  return (digit == 1 ? "" : fmt::format("{} × ", digit)) + "10" + superscript(exponent);
}

// Appends ticks at these digits times powers of ten in [low, high], both above 0. Takes every `stride`-th power.
void append_powers(Ticks& ticks, double low, double high, std::initializer_list<int> digits, int stride,
                   bool negative) {
  const int first = static_cast<int>(std::floor(std::log10(low))), last = static_cast<int>(std::ceil(std::log10(high)));
  const bool plain = first >= -4 && last <= 5;
  for (int exponent = first; exponent <= last; ++exponent)
    for (const int digit : digits) {
      const double value = digit * std::pow(10, exponent);
      if (exponent % stride != 0 || value < low * (1 - 1e-9) || value > high * (1 + 1e-9)) continue;
      const std::string label = label_of_power(digit, exponent, plain);
      ticks.list.push_back({negative ? -value : value, (negative ? "-" : "") + label});
    }
}

Ticks powers_between(double low, double high, std::initializer_list<int> digits, int stride) {
  Ticks ticks;
  append_powers(ticks, low, high, digits, stride, false);
  return ticks;
}

// Both signs, from the width of the linear part on.
Ticks signed_powers(double low, double high, double width, int stride) {
  Ticks ticks;
  if (-low > width) append_powers(ticks, width, -low, {1}, stride, true);
  std::ranges::reverse(ticks.list);
  if (low <= 0 && high >= 0) ticks.list.push_back({0, "0"});
  if (high > width) append_powers(ticks, std::max(width, low), high, {1}, stride, false);
  std::erase_if(ticks.list, [&](const Tick& tick) { return tick.value < low || tick.value > high; });
  return ticks;
}

}  // namespace

int digits_of_range(double low, double high) {
  const double largest = std::max(std::abs(low), std::abs(high));
  if (!(high > low) || !std::isfinite(largest)) return 5;
  return static_cast<int>(std::clamp(std::ceil(std::log10(largest / (high - low))) + 4, 5.0, 17.0));
}

Ticks ticks_of(const TransferFunction& function, int most) {
  const double low = function.lo, high = function.hi;
  Ticks ticks;
  const auto too_many = [&] { return ticks.list.size() > static_cast<std::size_t>(most) + 1; };
  if (function.axis == ValueAxis::log) {
    ticks = powers_between(low, high, {1}, 1);
    if (ticks.list.size() < 3) ticks = powers_between(low, high, {1, 2, 5}, 1);
    for (int stride = 2; too_many(); ++stride) ticks = powers_between(low, high, {1}, stride);
  } else if (function.axis == ValueAxis::asinh) {
    ticks = signed_powers(low, high, function.linear_width, 1);
    for (int stride = 2; too_many(); ++stride) ticks = signed_powers(low, high, function.linear_width, stride);
  }
  return ticks.list.size() < 2 ? ticks_between(low, high, most) : ticks;
}

namespace {

// A round number near both ends, with as few digits as that takes.
double round_offset(double low, double high, std::string& text) {
  const double middle = 0.5 * low + 0.5 * high;
  const int digits = static_cast<int>(std::ceil(std::log10(std::abs(middle)) - std::log10(high - low)));
  text = fmt::format("{:.{}g}", middle, std::clamp(digits, 1, 17));
  const double offset = std::strtod(text.c_str(), nullptr), size = std::abs(offset);
  if (!(size >= 1e-3 && size < 1e15)) return offset;
  // Without an exponent.
  const int decimals = std::max(digits - 1 - static_cast<int>(std::floor(std::log10(size))), 0);
  text = fmt::format("{:.{}f}", offset, decimals);
  if (decimals > 0) text.resize(text.find_last_not_of('0') + 1);
  if (text.ends_with('.')) text.pop_back();
  return offset;
}

// Values far from zero, next to each other, have the same first digits: the labels lack these.
Ticks ticks_by_offset(double low, double high, int most) {
  std::string text;
  const double offset = round_offset(low, high, text);
  Ticks ticks = ticks_between(low - offset, high - offset, most);
  for (Tick& tick : ticks.list) tick.value = std::clamp(offset + tick.value, low, high);
  ticks.factor +=
      fmt::format("{}{} {}", ticks.factor.empty() ? "" : " ", offset < 0 ? "−" : "+", text.substr(offset < 0 ? 1 : 0));
  return ticks;
}

}  // namespace

Ticks ticks_between(double low, double high, int most) {
  constexpr double least_share = 1e-5;  // of the largest value; below, labels would have more than six digits
  if (high - low < least_share * std::max(std::abs(low), std::abs(high))) return ticks_by_offset(low, high, most);
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
