// The index of a time series whose steps are files of their own: a small JSON file, .svols (spec/svol-1.md, section
// 11).
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"
#include "format/layout.h"

namespace splatvol::format {

struct SeriesIndex {
  struct Step {
    double time;
    std::string file;  // its name, in the folder of the index
  };
  struct Attribute {
    std::string name, unit;
    StepRange range;  // of the present values over all steps; NaN if there is none
  };
  std::vector<Step> steps;            // times rise
  std::vector<Attribute> attributes;  // that every step has
};

/// Widens a range that may be empty (NaN).
void include(StepRange& range, double min, double max);

/// Whether two ranges are equal, or both are empty.
[[nodiscard]] bool is_same(const StepRange& a, const StepRange& b);

/// Whether a path names such an index.
[[nodiscard]] inline bool is_series_index(std::string_view path) { return path.ends_with(".svols"); }

[[nodiscard]] std::string to_json(const SeriesIndex& index);

/// Fails if the text is no such index, has no step, times that do not rise, a file name with a folder or the character
/// NUL in it, or an attribute twice or with a range that is none.
[[nodiscard]] Result<SeriesIndex> series_index_from_json(const std::string& text);

}  // namespace splatvol::format
