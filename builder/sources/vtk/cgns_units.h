// Units in CGNS files.
#pragma once

#include <string>

namespace splatvol {

/// A field of an open CGNS file, by the numbers of the library.
struct CgnsField {
  int file, base, zone, solution, field;
};

/// Returns the unit of a field, from the data class, the dimensional units and the exponents that hold for it. If the
/// field has no exponents, takes those that the standard gives its name. Empty if the field is not dimensional, or if
/// the file does not tell.
[[nodiscard]] std::string cgns_unit(const CgnsField& field, const std::string& name);

}  // namespace splatvol
