// The index of a time series whose steps are files of their own: a small JSON file, .svols (docs/design.md, "Time
// series").
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"

namespace splatvol::format {

struct SeriesIndex {
  struct Step {
    double time;
    std::string file;  // its name, in the folder of the index
  };
  std::vector<Step> steps;  // times rise
};

/// Whether a path names such an index.
[[nodiscard]] inline bool is_series_index(std::string_view path) { return path.ends_with(".svols"); }

[[nodiscard]] std::string to_json(const SeriesIndex& index);

/// Fails if the text is no such index, has no step, times that do not rise, or a file name with a folder in it.
[[nodiscard]] Result<SeriesIndex> series_index_from_json(const std::string& text);

}  // namespace splatvol::format
