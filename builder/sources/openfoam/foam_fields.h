// Fields of OpenFOAM: a value for each cell, or for each point.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "builder/sources/openfoam/foam_reader.h"

namespace splatvol {

/// The kind of a field, by the class that its file states.
struct FoamFieldKind {
  int components = 1;
  bool of_cells = true;       // or of points
  bool is_symmetric = false;  // a tensor of six components
  bool is_internal = false;   // without values on patches
};

/// The kind of a field of a class such as "volVectorField"; none if it has values neither of cells nor of points.
[[nodiscard]] std::optional<FoamFieldKind> foam_field_kind(std::string_view class_name);

/// A field without its values on patches.
struct FoamField {
  std::string unit;            // empty: none, or one that is not known
  std::vector<double> values;  // [element * components + c]; the tensor's in VTK's order: XX, YY, ZZ, XY, YZ, XZ
};

/// Reads a field of `count` elements. Its values are multiplied by the factor of their unit, if it is stated behind or
/// before them ("uniform 1 [bar]"). Throws if the file is damaged or cut off, also behind the values; if it states
/// another number of values; or if they depend on more than plain macros.
[[nodiscard]] FoamField read_foam_field(const FoamPlace& place, const FoamFieldKind& kind, std::uint64_t count);

}  // namespace splatvol
