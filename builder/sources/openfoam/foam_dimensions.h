// Dimensions of fields, and units of values, as OpenFOAM writes them.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>

namespace splatvol {

/// Powers of kg, m, s, K, mol, A and cd, and the factor from a unit to their product.
struct FoamDimensions {
  std::array<double, 7> powers{};
  double factor = 1;
};

/// Reads what stands between square brackets: seven numbers, or five; a product of names of dimensions ("pressure") or
/// of units ("kg m^-1 s^-2", "Pa/m"); or nothing. Returns nothing if it is something else, or has a name that OpenFOAM
/// 14 does not define. Safe on any text.
[[nodiscard]] std::optional<FoamDimensions> read_dimensions(std::string_view text);

/// The unit of these dimensions in the form of unit_text() (builder/sources/units.h): "J/K", "m^2/s". Empty: they have
/// none.
[[nodiscard]] std::string unit_of(const FoamDimensions& dimensions);

}  // namespace splatvol
