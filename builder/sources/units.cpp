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

struct NamedUnit {
  std::string_view product;
  std::string_view name;
};
constexpr std::array<NamedUnit, 4> named_units = {
    {{"kg/(m s^2)", "Pa"}, {"kg m/s^2", "N"}, {"kg m^2/s^2", "J"}, {"kg m^2/s^3", "W"}}};

constexpr auto metric_units = std::to_array<std::string_view>(
    {"m",   "s",   "g",  "K",  "Pa", "N",  "J",  "W", "Hz", "V",   "A",  "C",   "F", "T",  "H", "S", "Ohm",
     "mol", "rad", "sr", "cd", "lm", "lx", "Wb", "L", "l",  "bar", "eV", "cal", "P", "St", "t", "dB"});
constexpr auto other_units = std::to_array<std::string_view>(
    {"min",  "h",        "hr",           "sec",          "d",        "day",    "yr",    "deg", "degC", "degF",
     "degR", "R",        "radian",       "atm",          "psi",      "psf",    "ft",    "in",  "mi",   "yd",
     "lb",   "lbf",      "lbm",          "slug",         "Btu",      "BTU",    "rpm",   "ppm", "Torr", "torr",
     "mmHg", "kgf",      "gal",          "erg",          "dyn",      "G",      "gauss", "kn",  "knot", "cell",
     "%",    "\xC2\xB0", "\xC2\xB0\x43", "\xC2\xB0\x46", "\xCE\xA9", "degree", "mile"});

/// Whether a word is the symbol of a unit, also with a prefix of SI.
bool is_unit_symbol(std::string_view word) {
  if (std::ranges::find(other_units, word) != other_units.end()) return true;
  for (const std::string_view prefix :
       {"", "n", "u", "\xC2\xB5", "\xCE\xBC", "m", "c", "d", "da", "h", "k", "M", "G", "T", "p", "f"})
    if (word.starts_with(prefix) && std::ranges::find(metric_units, word.substr(prefix.size())) != metric_units.end())
      return true;
  return false;
}

/// Whether a text consists of symbols of units and their powers: "m/s", "W/(m^2 K)", "-".
bool is_unit(std::string_view text) {
  constexpr std::string_view between = " /*.^+-()0123456789";
  bool has_symbol = trimmed(text) == "-";
  for (std::size_t at = 0; (at = text.find_first_not_of(between, at)) != std::string_view::npos;) {
    const std::size_t end = std::min(text.find_first_of(between, at), text.size());
    if (!is_unit_symbol(text.substr(at, end - at))) return false;
    has_symbol = true;
    at = end;
  }
  return has_symbol;
}

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

std::string cut_unit(std::string& heading) {
  // COMSOL: the name, its unit and a step.
  if (const std::size_t step = heading.find(" @ "); step != std::string::npos) {
    std::string name = heading.substr(0, step);
    std::string unit = cut_unit(name);
    heading.erase(0, step).insert(0, name);
    return unit;
  }
  const bool is_round = heading.ends_with(')');
  const std::size_t open = is_round ? heading.rfind(" (") : heading.rfind('[');
  if (open == std::string::npos || open == 0 || (!is_round && heading.back() != ']')) return {};
  if (is_round && !is_unit(std::string_view(heading).substr(open + 2, heading.size() - open - 3))) return {};
  const std::string unit(
      trimmed(std::string_view(heading).substr(open + (is_round ? 2 : 1), heading.size() - open - (is_round ? 3 : 2))));
  if (std::ranges::all_of(unit, [](char c) { return is_digit(c) || c == ','; }) && !unit.empty()) return {};
  heading.resize(open);
  while (!heading.empty() && is_white_space(heading.back())) heading.pop_back();
  return unit == "-" ? std::string() : unit;
}

}  // namespace splatvol
