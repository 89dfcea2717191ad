// Writes tetrahedra to a .vtu file, through VTK's writer.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "base/replaceable.h"

namespace splatvol {

/// An array of values at the points: `components` numbers for each point, one point after the other.
struct PointArray {
  std::string name;
  int components = 1;
  std::vector<float> values;
};

/// How a file is written.
struct VtuOptions {
  bool is_export = false;              // it has the mark of an export (base/replaceable.h)
  Replace replace = Replace::exports;  // what may be replaced
};

/// Writes a .vtu file (file version 1.0, compressed, coordinates in double). It appears whole or not at all. The
/// same input gives the same bytes. Requires values.size() == components * points.size() and indices in range.
[[nodiscard]] Status write_vtu(const std::string& path, std::span<const dvec3> points,
                               std::span<const std::array<std::uint32_t, 4>> tetrahedra,
                               std::span<const PointArray> arrays, const VtuOptions& options = {});

}  // namespace splatvol
