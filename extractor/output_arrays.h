// Arrays of an output: attributes of a file, those of a vector together.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "format/splat_reader.h"
#include "format/volume.h"

namespace splatvol {

struct OutputArray {
  std::string name, unit;
  std::vector<std::size_t> members;  // numbers in the selection: an attribute, or the three components of a vector

  [[nodiscard]] std::size_t components() const { return members.size(); }
};

/// Returns the arrays of the selected attributes, in their order. The components `U[0]`, `U[1]` and `U[2]` of a vector
/// become the array `U` if all three are selected and the file has no `U[3]`. The magnitude, which is called `U`, is
/// left out then: it follows from the components.
[[nodiscard]] std::vector<OutputArray> output_arrays(const format::VolumeInfo& info,
                                                     const format::SplatSelection& selection);

/// Returns the names of arrays.
[[nodiscard]] std::vector<std::string> names_of(std::span<const OutputArray> arrays);

/// Returns the numbers of an array, point by point. `values`: [attribute of the selection][point]. The result is in
/// `joined` or in `values`.
[[nodiscard]] std::span<const double> numbers_of(const OutputArray& array, std::span<const std::vector<double>> values,
                                                 std::vector<double>& joined);

}  // namespace splatvol
