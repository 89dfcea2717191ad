// Which attribute a first picture shows.
#pragma once

#include <vector>

#include "base/error.h"
#include "format/volume.h"

namespace splatvol {

/// Returns the index of the attribute that a first picture shows. In order of preference, and within each class in the
/// order of the file: magnitudes of vectors and pressures; other quantities; components of vectors; attributes of which
/// most values are missing; whole numbers of few kinds (labels) or that count (ids); constants. Fails if no attribute
/// has a value, and if the file cannot be read.
[[nodiscard]] Result<int> choose_first_attribute(const format::Volume& volume);

/// Labels, of materials or blocks, are 2 to 64 whole numbers, with few means between them. Images have whole numbers,
/// too.
enum class NumberKind { labels, whole, other };

/// Returns the kind of an attribute's values, by a sample of them. Fails if the file cannot be read.
[[nodiscard]] Result<NumberKind> kind_of_numbers(const format::Volume& volume, int index);

/// Returns the range, as a share of the largest value, from which on an attribute is no constant: of values that are
/// numbers of single precision less than 1e-6 is their rounding. Fails if the file cannot be read.
[[nodiscard]] Result<double> least_relative_range(const format::Volume& volume, int index);

/// Returns the first attributes of the file, at most `most`, that are quantities and no components: those that a user
/// of the first picture will look at next. `first` is left out.
[[nodiscard]] Result<std::vector<int>> other_quantities(const format::Volume& volume, int first, std::size_t most);

}  // namespace splatvol
