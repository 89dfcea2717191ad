// What is drawn for a quality: one rule for all programs.
#pragma once

#include <cstdint>

#include "player/recipe.h"
#include "splatvol/quality.h"

namespace splatvol {

/// Says whether cells or splats are drawn where nobody asks for one of them. Returns the finest distance of samples
/// with which cells have at most Choices::most_segments; 0: splats are drawn. Contours are cells, whatever the work.
[[nodiscard]] int spacing_of_cells(const Choices& choices);

/// Returns the quality of splats for which nothing is asked: all points of a file of few points, else the default
/// error.
[[nodiscard]] Quality default_splats(std::uint64_t points);

/// Whether a quality asks for splats of another kind than those that have an error.
[[nodiscard]] bool asks_for_splats(const Quality& quality);

/// Returns the detail of a quality without comparing pictures: it expects a `max_error`, and measures none. Requires a
/// number of splats, an error, a tolerance or a resolution.
[[nodiscard]] Detail expected_detail(const Quality& quality);

}  // namespace splatvol
