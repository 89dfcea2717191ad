// The box that a file's material fills.
#pragma once

#include "base/error.h"
#include "base/math.h"

namespace splatvol {

class Streamer;

/// Returns a box round the material of the coarsest splats, in world units. Reads them, and takes the place of the
/// streamer's last frame.
[[nodiscard]] Result<Box> find_domain(Streamer& streamer);

}  // namespace splatvol
