// What is drawn for a quality: one rule for all programs.
#pragma once

#include <cstdint>

#include "splatvol/quality.h"
#include "streamer/splats/detail.h"

namespace splatvol {

/// Returns the quality of splats for which nothing is asked: all points of a file of few points, else the default
/// error.
[[nodiscard]] Quality default_splats(std::uint64_t points);

/// Whether a quality asks for splats of another kind than those that have an error.
[[nodiscard]] bool asks_for_splats(const Quality& quality);

/// Returns the detail of a quality without comparing pictures: it expects a `max_error`, and measures none. Requires a
/// number of splats, an error, a tolerance or a resolution.
[[nodiscard]] Detail expected_detail(const Quality& quality);

}  // namespace splatvol
