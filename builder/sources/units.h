// Texts for units of measurement.
#pragma once

#include <span>
#include <string>
#include <string_view>

namespace splatvol {

struct UnitPower {
  std::string_view symbol;
  double exponent = 0;
};

/// Returns the product of the powers: "m/s", "kg/(m^2 s)", "1/s"; empty if all exponents are 0. Products of kg, m and s
/// with a name of their own in SI get that: Pa, N, J, W.
[[nodiscard]] std::string unit_text(std::span<const UnitPower> powers);

/// Returns the unit at the end of a heading such as "p [Pa]" or "p (Pa)", or before its step ("p (Pa) @ t=1"), and cuts
/// it off, with the space in front of it. Empty if there is none; numbers in brackets are components, not units. In
/// round brackets only known symbols are units: others may be parts of the name.
[[nodiscard]] std::string cut_unit(std::string& heading);

}  // namespace splatvol
