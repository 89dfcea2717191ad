#include "builder/sources/time_steps.h"

#include <cmath>

namespace splatvol {

std::optional<TimeStep> choose_step(const std::vector<double>& times, std::optional<double> time) {
  if (times.empty()) return std::nullopt;
  std::size_t best = 0;
  for (std::size_t i = 1; i < times.size(); ++i) {
    const bool better = time ? std::abs(times[i] - *time) < std::abs(times[best] - *time) : times[i] >= times[best];
    if (better) best = i;
  }
  return TimeStep{times[best], best, times};
}

}  // namespace splatvol
