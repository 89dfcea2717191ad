#include "builder/sources/openfoam/foam_dimensions.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <span>
#include <utility>
#include <vector>

#include "builder/sources/read_text.h"
#include "builder/sources/units.h"

namespace splatvol {
namespace {

struct Named {
  std::string_view name;
  std::array<signed char, 7> powers;  // of kg, m, s, K, mol, A, cd
  double factor = 1;
};

constexpr double pi = std::numbers::pi;

// Dimensions (OpenFOAM 12 and later), then units. Moles are of kilograms. Angles and shares have no dimension.
constexpr Named names[] = {
    {"mass", {1}},
    {"length", {0, 1}},
    {"time", {0, 0, 1}},
    {"temperature", {0, 0, 0, 1}},
    {"moles", {0, 0, 0, 0, 1}},
    {"current", {0, 0, 0, 0, 0, 1}},
    {"luminousIntensity", {0, 0, 0, 0, 0, 0, 1}},
    {"area", {0, 2}},
    {"volume", {0, 3}},
    {"rate", {0, 0, -1}},
    {"velocity", {0, 1, -1}},
    {"momentum", {1, 1, -1}},
    {"acceleration", {0, 1, -2}},
    {"force", {1, 1, -2}},
    {"density", {1, -3}},
    {"momentumDensity", {1, -2, -1}},
    {"forceDensity", {1, -2, -2}},
    {"energy", {1, 2, -2}},
    {"energyDensity", {1, -1, -2}},
    {"specificEnergy", {0, 2, -2}},
    {"kineticEnergy", {1, 2, -2}},
    {"kineticEnergyDensity", {1, -1, -2}},
    {"power", {1, 2, -3}},
    {"powerDensity", {1, -1, -3}},
    {"specificPower", {0, 2, -3}},
    {"entropy", {1, 2, -2, -1}},
    {"specificEntropy", {0, 2, -2, -1}},
    {"heatCapacity", {1, 2, -2, -1}},
    {"specificHeatCapacity", {0, 2, -2, -1}},
    {"gasConstant", {0, 2, -2, -1}},
    {"pressure", {1, -1, -2}},
    {"kinematicPressure", {0, 2, -2}},
    {"compressibility", {0, -2, 2}},
    {"kinematicViscosity", {0, 2, -1}},
    {"dynamicViscosity", {1, -1, -1}},
    {"kinematicDiffusivity", {0, 2, -1}},
    {"dynamicDiffusivity", {1, -1, -1}},
    {"thermalConductivity", {1, 1, -3, -1}},
    {"turbulentKineticEnergy", {0, 2, -2}},
    {"kinematicStress", {0, 2, -2}},
    {"ReynoldsStress", {0, 2, -2}},
    {"turbulentEpsilon", {0, 2, -3}},
    {"turbulentOmega", {0, 0, -1}},
    {"turbulentViscosity", {0, 2, -1}},
    {"volumetricFlux", {0, 3, -1}},
    {"volumetricFluxDensity", {0, 1, -1}},
    {"massFlux", {1, 0, -1}},
    {"massFluxDensity", {1, -2, -1}},
    {"heatFlux", {1, 2, -3}},
    {"heatFluxDensity", {1, 0, -3}},
    {"charge", {0, 0, 1, 0, 0, 1}},
    {"chargeDensity", {0, -3, 1, 0, 0, 1}},
    {"electricPotential", {1, 2, -3, 0, 0, -1}},
    {"electricalConductivity", {-1, -3, 3, 0, 0, 2}},
    {"magneticFlux", {1, 2, -2, 0, 0, -1}},
    {"magneticFluxDensity", {1, 0, -2, 0, 0, -1}},
    {"magneticFluxPressure", {1, 1, -3, 0, 0, -1}},
    {"kg", {1}},
    {"m", {0, 1}},
    {"s", {0, 0, 1}},
    {"K", {0, 0, 0, 1}},
    {"mol", {0, 0, 0, 0, 1}, 1e-3},
    {"kmol", {0, 0, 0, 0, 1}},
    {"A", {0, 0, 0, 0, 0, 1}},
    {"Cd", {0, 0, 0, 0, 0, 0, 1}},
    {"%", {}, 1e-2},
    {"rad", {}},
    {"rot", {}, 2 * pi},
    {"deg", {}, pi / 180},
    {"g", {1}, 1e-3},
    {"lb", {1}, 0.45359237},
    {"um", {0, 1}, 1e-6},
    {"mm", {0, 1}, 1e-3},
    {"cm", {0, 1}, 1e-2},
    {"km", {0, 1}, 1e3},
    {"in", {0, 1}, 0.0254},
    {"ft", {0, 1}, 0.3048},
    {"yd", {0, 1}, 0.9144},
    {"mi", {0, 1}, 1609.344},
    {"us", {0, 0, 1}, 1e-6},
    {"ms", {0, 0, 1}, 1e-3},
    {"min", {0, 0, 1}, 60},
    {"hr", {0, 0, 1}, 3600},
    {"R", {0, 0, 0, 1}, 1 / 1.8},
    {"lbmol", {0, 0, 0, 0, 1}, 0.45359237},
    {"Hz", {0, 0, -1}},
    {"rpm", {0, 0, -1}, pi / 30},
    {"N", {1, 1, -2}},
    {"pdl", {1, 1, -2}, 0.45359237 * 0.3048},
    {"lbf", {1, 1, -2}, 32.174049 * 0.45359237 * 0.3048},
    {"Pa", {1, -1, -2}},
    {"kPa", {1, -1, -2}, 1e3},
    {"MPa", {1, -1, -2}, 1e6},
    {"bar", {1, -1, -2}, 1e5},
    {"atm", {1, -1, -2}, 101325},
    {"psi", {1, -1, -2}, 32.174049 * 0.45359237 * 0.3048 / (0.0254 * 0.0254)},
    {"J", {1, 2, -2}},
    {"cal", {1, 2, -2}, 4.184},
    {"kcal", {1, 2, -2}, 4184},
    {"W", {1, 2, -3}},
    {"l", {0, 3}, 1e-3},
    {"ml", {0, 3}, 1e-6},
    {"cSt", {0, 2, -1}, 1e-6},
    {"cP", {1, -1, -1}, 1e-3},
    {"C", {0, 0, 1, 0, 0, 1}},
    {"V", {1, 2, -3, 0, 0, -1}},
    {"Ohm", {1, 2, -3, 0, 0, -2}},
    {"S", {-1, -2, 3, 0, 0, 2}},
    {"F", {-1, -2, 4, 0, 0, 2}},
    {"Wb", {1, 2, -2, 0, 0, -1}},
    {"T", {1, 0, -2, 0, 0, -1}},
    {"H", {1, 2, -2, 0, 0, -2}},
};

/// A product, or what is left of it. A function that returns false has met something else.
class ProductReader {
 public:
  explicit ProductReader(std::string_view text) : text_(text) {}

  bool read(FoamDimensions& product, int depth = 0) {
    for (double sign = 1;; sign = 1) {
      skip_space();
      if (text_.empty() || text_.front() == ')') return true;
      if (take('/'))
        sign = -1;
      else
        take('*');
      FoamDimensions factor;
      if (!read_power(factor, depth)) return false;
      multiply(product, factor, sign);
    }
  }

  [[nodiscard]] bool at_end() const { return text_.empty(); }

 private:
  static void multiply(FoamDimensions& product, const FoamDimensions& by, double power) {
    for (std::size_t i = 0; i < product.powers.size(); ++i) product.powers[i] += by.powers[i] * power;
    product.factor *= std::pow(by.factor, power);
  }

  bool read_power(FoamDimensions& result, int depth) {
    FoamDimensions base;
    if (!read_atom(base, depth)) return false;
    skip_space();
    if (!take('^')) {
      result = base;
      return true;
    }
    FoamDimensions power;
    if (!read_atom(power, depth)) return false;
    multiply(result, base, power.factor);
    return true;
  }

  bool read_atom(FoamDimensions& result, int depth) {
    constexpr int deepest = 16;
    skip_space();
    if (take('(')) return depth < deepest && read(result, depth + 1) && take(')');
    const std::string_view word = text_.substr(0, std::min(text_.find_first_of(" \t\r\n()*/^"), text_.size()));
    text_.remove_prefix(word.size());
    if (const auto number = number_of<double>(word)) {
      result.factor = *number;
      return true;
    }
    const auto* named = std::ranges::find(names, word, &Named::name);
    if (named == std::end(names)) return false;
    std::ranges::copy(named->powers, result.powers.begin());
    result.factor = named->factor;
    return true;
  }

  void skip_space() {
    while (!text_.empty() && is_white_space(text_.front())) text_.remove_prefix(1);
  }

  bool take(char c) {
    if (!text_.starts_with(c)) return false;
    text_.remove_prefix(1);
    return true;
  }

  std::string_view text_;
};

/// The numbers of a text; none if it holds another word.
std::vector<double> all_numbers(std::string_view text) {
  std::vector<double> numbers;
  for (text = trimmed(text); !text.empty(); text = trimmed(text)) {
    const std::string_view word = text.substr(0, std::min(text.find_first_of(" \t\r\n"), text.size()));
    const auto number = number_of<double>(word);
    if (!number) return {};
    numbers.push_back(*number);
    text.remove_prefix(word.size());
  }
  return numbers;
}

}  // namespace

std::optional<FoamDimensions> read_dimensions(std::string_view text) {
  FoamDimensions dimensions;
  const std::vector<double> numbers = all_numbers(text);
  if (numbers.size() == 5 || numbers.size() == 7) {
    std::ranges::copy(numbers, dimensions.powers.begin());
    return dimensions;
  }
  ProductReader product(text);
  if (!product.read(dimensions) || !product.at_end()) return std::nullopt;
  for (double& power : dimensions.powers)
    if (std::abs(power - std::round(power)) < 1e-9) power = std::round(power);
  return dimensions;
}

std::string unit_of(const FoamDimensions& dimensions) {
  constexpr std::array<std::string_view, 7> symbols = {"kg", "m", "s", "K", "mol", "A", "cd"};
  constexpr std::array<std::pair<std::string_view, std::array<double, 3>>, 4> products = {
      {{"Pa", {1, -1, -2}}, {"N", {1, 1, -2}}, {"J", {1, 2, -2}}, {"W", {1, 2, -3}}}};
  const std::span all(dimensions.powers);
  std::vector<UnitPower> powers;
  for (const auto& [name, product] : products)
    if (std::ranges::equal(product, all.first(product.size()))) powers = {{name, 1}};
  for (std::size_t i = powers.empty() ? 0 : 3; i < all.size(); ++i) powers.push_back({symbols[i], all[i]});
  return unit_text(powers);
}

}  // namespace splatvol
