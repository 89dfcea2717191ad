#include "builder/sources/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>

#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

bool is_digit(char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; }
bool is_letter(char c) { return std::isalpha(static_cast<unsigned char>(c)) != 0; }

struct NamedUnit {
  std::string_view product;
  std::string_view name;
};
constexpr std::array<NamedUnit, 4> named_units = {
    {{"kg/(m s^2)", "Pa"}, {"kg m/s^2", "N"}, {"kg m^2/s^2", "J"}, {"kg m^2/s^3", "W"}}};

}  // namespace

std::string unit_text(std::span<const UnitPower> powers) {
  std::string over, under;
  int count_under = 0;
  for (const auto& [symbol, exponent] : powers) {
    if (exponent == 0 || !std::isfinite(exponent)) continue;
    std::string& part = exponent > 0 ? over : under;
    count_under += exponent < 0 ? 1 : 0;
    if (!part.empty()) part += ' ';
    part += symbol;
    if (std::abs(exponent) != 1) part += fmt::format("^{:g}", std::abs(exponent));
  }
  if (count_under > 1) under = "(" + under + ")";
  if (over.empty() && under.empty()) return {};
  const std::string text = (over.empty() ? "1" : over) + (under.empty() ? "" : "/" + under);
  const auto* named = std::ranges::find(named_units, text, &NamedUnit::product);
  return named == named_units.end() ? text : std::string(named->name);
}

std::string unit_of_openfoam(std::string_view text) {
  if (text == "-") return {};
  std::string unit;
  for (const char c : text) {
    if (is_digit(c) && !unit.empty() && is_letter(unit.back())) unit += '^';
    unit += c;
  }
  return unit;
}

std::string cut_unit(std::string& heading) {
  const std::size_t open = heading.rfind('[');
  if (open == std::string::npos || open == 0 || heading.back() != ']') return {};
  const std::string unit(trimmed(std::string_view(heading).substr(open + 1, heading.size() - open - 2)));
  if (std::ranges::all_of(unit, [](char c) { return is_digit(c) || c == ','; }) && !unit.empty()) return {};
  heading.resize(open);
  while (!heading.empty() && is_white_space(heading.back())) heading.pop_back();
  return unit == "-" ? std::string() : unit;
}

}  // namespace splatvol
