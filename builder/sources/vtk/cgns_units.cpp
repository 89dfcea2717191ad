#include "builder/sources/vtk/cgns_units.h"

#include <vtk_cgns.h>

#include <array>
#include <optional>
#include <string_view>

#include VTK_CGNS(cgnslib.h)
#include "builder/sources/units.h"

namespace splatvol {
namespace {

/// Exponents of mass, length, time, temperature and angle.
using Exponents = std::array<double, 5>;

struct NamedExponents {
  std::string_view name;
  Exponents exponents;
};

/// The standard's exponents for its own names (SIDS, annex A). A name may go on with X, Y, Z or Magnitude.
constexpr std::array<NamedExponents, 16> standard_exponents = {{{"Density", {1, -3, 0, 0, 0}},
                                                                {"EnergyInternal", {0, 2, -2, 0, 0}},
                                                                {"EnergyKinetic", {0, 2, -2, 0, 0}},
                                                                {"EnergyStagnationDensity", {1, -1, -2, 0, 0}},
                                                                {"Enthalpy", {0, 2, -2, 0, 0}},
                                                                {"Momentum", {1, -2, -1, 0, 0}},
                                                                {"Pressure", {1, -1, -2, 0, 0}},
                                                                {"PressureStagnation", {1, -1, -2, 0, 0}},
                                                                {"Temperature", {0, 0, 0, 1, 0}},
                                                                {"TemperatureStagnation", {0, 0, 0, 1, 0}},
                                                                {"TurbulentEnergyKinetic", {0, 2, -2, 0, 0}},
                                                                {"Velocity", {0, 1, -1, 0, 0}},
                                                                {"VelocitySound", {0, 1, -1, 0, 0}},
                                                                {"ViscosityKinematic", {0, 2, -1, 0, 0}},
                                                                {"ViscosityMolecular", {1, -1, -1, 0, 0}},
                                                                {"Vorticity", {0, 0, -1, 0, 0}}}};

std::optional<Exponents> exponents_by_name(std::string_view name) {
  for (const auto& [known, exponents] : standard_exponents) {
    if (!name.starts_with(known)) continue;
    const std::string_view rest = name.substr(known.size());
    if (rest.empty() || rest == "X" || rest == "Y" || rest == "Z" || rest == "Magnitude") return exponents;
  }
  return std::nullopt;
}

/// Moves to a node above the field, or to the field itself: level 0 is the base, level 3 the field.
bool go_to(const CgnsField& at, int level) {
  switch (level) {
    case 0:
      return cg_goto(at.file, at.base, "end") == CG_OK;
    case 1:
      return cg_goto(at.file, at.base, "Zone_t", at.zone, "end") == CG_OK;
    case 2:
      return cg_goto(at.file, at.base, "Zone_t", at.zone, "FlowSolution_t", at.solution, "end") == CG_OK;
    default:
      return cg_goto(at.file, at.base, "Zone_t", at.zone, "FlowSolution_t", at.solution, "DataArray_t", at.field,
                     "end") == CG_OK;
  }
}

/// The symbols of base units; empty where the file names none.
using Symbols = std::array<std::string_view, 5>;

/// The symbol of a unit, by its number in the library's list; 0 and 1: none.
std::string_view symbol_of(int unit, std::initializer_list<std::string_view> symbols) {
  const auto index = static_cast<std::size_t>(unit - 2);
  return unit >= 2 && index < symbols.size() ? symbols.begin()[index] : std::string_view();
}
static_assert(CGNS_ENUMV(Kilogram) == 2 && CGNS_ENUMV(Meter) == 2 && CGNS_ENUMV(Second) == 2 &&
              CGNS_ENUMV(Kelvin) == 2 && CGNS_ENUMV(Degree) == 2);

/// Reads the units of the current node, if it has any.
std::optional<Symbols> read_symbols() {
  CGNS_ENUMT(MassUnits_t) mass{};
  CGNS_ENUMT(LengthUnits_t) length{};
  CGNS_ENUMT(TimeUnits_t) time{};
  CGNS_ENUMT(TemperatureUnits_t) temperature{};
  CGNS_ENUMT(AngleUnits_t) angle{};
  if (cg_units_read(&mass, &length, &time, &temperature, &angle) != CG_OK) return std::nullopt;
  return Symbols{symbol_of(mass, {"kg", "g", "slug", "lb"}), symbol_of(length, {"m", "cm", "mm", "ft", "in"}),
                 symbol_of(time, {"s"}), symbol_of(temperature, {"K", "degC", "degR", "degF"}),
                 symbol_of(angle, {"deg", "rad"})};
}

/// Reads the exponents of the current node, if it has any.
std::optional<Exponents> read_exponents() {
  CGNS_ENUMT(DataType_t) type{};
  if (cg_exponents_info(&type) != CG_OK) return std::nullopt;
  Exponents exponents{};
  if (type == CGNS_ENUMV(RealDouble))
    return cg_exponents_read(exponents.data()) == CG_OK ? std::optional(exponents) : std::nullopt;
  std::array<float, 5> single{};
  if (type != CGNS_ENUMV(RealSingle) || cg_exponents_read(single.data()) != CG_OK) return std::nullopt;
  std::copy(single.begin(), single.end(), exponents.begin());
  return exponents;
}

}  // namespace

std::string cgns_unit(const CgnsField& field, const std::string& name) {
  CGNS_ENUMT(DataClass_t) data_class = CGNS_ENUMV(Dimensional);  // if no node tells
  std::optional<Symbols> symbols;
  std::optional<Exponents> exponents;
  for (int level = 0; level < 4; ++level) {  // a lower node overrides a higher one
    if (!go_to(field, level)) return {};
    CGNS_ENUMT(DataClass_t) own{};
    if (cg_dataclass_read(&own) == CG_OK) data_class = own;
    if (const auto found = read_symbols()) symbols = found;
    if (level == 3) exponents = read_exponents();
  }
  if (!exponents) exponents = exponents_by_name(name);
  if (data_class != CGNS_ENUMV(Dimensional) || !symbols || !exponents) return {};
  std::array<UnitPower, 5> powers;
  for (std::size_t i = 0; i < powers.size(); ++i) {
    if ((*exponents)[i] != 0 && (*symbols)[i].empty()) return {};
    powers[i] = {(*symbols)[i], (*exponents)[i]};
  }
  return unit_text(powers);
}

}  // namespace splatvol
