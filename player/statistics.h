// What a frame shows and costs, as JSON.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "player/player.h"

namespace splatvol {

/// Returns the statistics of the last frame, as `svrender --stats` writes them. Requires a frame, or an
/// exact picture.
[[nodiscard]] nlohmann::ordered_json statistics_of(const Player& player);

/// Returns those of a search for an error.
[[nodiscard]] nlohmann::ordered_json statistics_of(const ErrorSearch& search);

}  // namespace splatvol
