// Lists of numbers in OpenFOAM's files: "3(1 2 3)", "3{1}", "(1 2 3)", or binary.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "builder/sources/openfoam/foam_reader.h"

namespace splatvol {

/// Reads a list of numbers, or of elements of several `components` in brackets. Returns its numbers, `components` for
/// each element. Throws if the list is damaged or cut off, has another number of elements than `expected`, or states
/// more than the file can hold: then before anything is allocated.
[[nodiscard]] std::vector<double> read_numbers(FoamReader& reader, std::size_t components,
                                               std::optional<std::uint64_t> expected = {});

/// Reads a list of labels, of at most `most`. Throws as read_numbers(), and if a label is below -1 or above 2^32 - 2.
/// -1 is returned as 2^32 - 1.
[[nodiscard]] std::vector<std::uint32_t> read_labels(FoamReader& reader, std::uint64_t most);

/// Lists of labels, one after the other: list i is values[starts[i]] to values[starts[i + 1] - 1].
struct LabelLists {
  std::vector<std::uint32_t> starts = {0};
  std::vector<std::uint32_t> values = {};

  [[nodiscard]] std::size_t size() const { return starts.size() - 1; }
  [[nodiscard]] std::span<const std::uint32_t> operator[](std::size_t list) const {
    return std::span(values).subspan(starts[list], starts[list + 1] - starts[list]);
  }
};

/// Reads a list of lists: a faceList, or a faceCompactList, as the file's class says. Throws as read_labels(), and if
/// there are more than 2^32 - 1 labels.
[[nodiscard]] LabelLists read_label_lists(FoamReader& reader);

/// Reads a number. Throws if there is none.
[[nodiscard]] double read_number(FoamReader& reader);

/// Returns the number that a whole word is; one that is too large is infinite. Nothing if it is none.
[[nodiscard]] std::optional<double> foam_number(std::string_view word);

}  // namespace splatvol
