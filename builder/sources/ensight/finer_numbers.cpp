#include "builder/sources/ensight/finer_numbers.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <system_error>

namespace splatvol {
namespace {

/// Half a unit of the last digit of a number: 0.005 for "-1.25", 50 for "1.2e3". `digits`: a number with a point or an
/// exponent.
double half_unit(std::string_view digits) {
  const std::size_t exponent_at = std::min(digits.find_first_of("eE"), digits.size());
  const std::size_t point = digits.find('.');
  int exponent = 0;
  if (exponent_at < digits.size()) {
    std::string_view text = digits.substr(exponent_at + 1);
    if (text.starts_with('+')) text.remove_prefix(1);
    std::from_chars(text.data(), text.data() + text.size(), exponent);
  }
  const std::size_t decimals = point < exponent_at ? exponent_at - point - 1 : 0;
  return 0.5 * std::pow(10.0, exponent - static_cast<double>(decimals));
}

}  // namespace

bool has_finer_number(std::string_view text) {
  constexpr std::string_view starts = "-.0123456789";
  for (std::size_t at = text.find_first_of(starts); at < text.size(); at = text.find_first_of(starts, at)) {
    double number = 0;
    const auto [end, error] = std::from_chars(text.data() + at, text.data() + text.size(), number);
    const auto length = static_cast<std::size_t>(end - text.data()) - at;
    const std::string_view digits = text.substr(at, length);
    at += std::max<std::size_t>(length, 1);
    if (error != std::errc() || digits.find_first_of(".eE") == std::string_view::npos) continue;
    if (std::abs(number - static_cast<double>(static_cast<float>(number))) > half_unit(digits)) return true;
  }
  return false;
}

}  // namespace splatvol
