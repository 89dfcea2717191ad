// The choice of a time step.
#pragma once

#include <optional>
#include <vector>

#include "builder/sources/source.h"

namespace splatvol {

/// Chooses the step nearest to `time`, or without one the step of the largest time. Nothing if there are no times.
[[nodiscard]] std::optional<TimeStep> choose_step(const std::vector<double>& times, std::optional<double> time);

}  // namespace splatvol
