// What can be drawn of a view: splats or cells, with samples so far apart.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "base/math.h"
#include "renderer/work.h"

namespace splatvol {

/// The most pixels from one sample to the next in a picture of a wanted time.
inline constexpr int widest_samples_in_a_time = 4;

/// The same while something moves, and its error is measured.
inline constexpr int widest_moving_samples = 16;

/// What is drawn: a number of splats, or the cells that a file keeps, and the distance of samples. Its picture does not
/// depend on how it was found.
struct Rung {
  std::uint64_t splats = 0;  // at most; 0: cells
  int sample_spacing = 1;

  [[nodiscard]] bool is_exact() const { return splats == 0; }
  [[nodiscard]] bool operator==(const Rung&) const = default;
};

/// What can be drawn of a view.
struct Choices {
  std::uint64_t points = std::numeric_limits<std::uint32_t>::max();  // that can be drawn
  std::uint64_t least_splats = 1;
  int finest_spacing = 1, widest_spacing = widest_samples_in_a_time;
  double pixels = 512 * 512;
  std::optional<CellCounts> cells = {};  // none: they cannot be drawn
  bool has_splats = true;                // false: cells alone show what there is to see; there must be some

  double most_segments = std::numeric_limits<double>::infinity();  // of cells, in all samples
  double first_cells_seconds = 1.0 / 12;  // cells that have the wanted error in this time come before splats
  double added_error = 0;                 // expected of splats, as they lack something
  dvec3 direction = {0, 0, 1};            // of the view
};

/// Returns rungs of splats, from few to all points. Each has sqrt(2) times the splats of the one below it. None if
/// splats cannot be drawn.
[[nodiscard]] std::vector<Rung> rungs_of_splats(const Choices& choices);

}  // namespace splatvol
