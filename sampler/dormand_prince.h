// Steps along the curves of a vector field.
#pragma once

#include <array>
#include <cstddef>
#include <optional>

#include "base/math.h"

namespace splatvol {

/// Where a step has led.
struct RungeKuttaStep {
  dvec3 position, velocity;
  dvec3 error;    // estimated, of the position
  double length;  // of the way, likewise of order 5
};

/// Takes a step of the Runge-Kutta method of Dormand and Prince: order 5, with an error estimate of order 4 (J. Comput.
/// Appl. Math. 6, 1980). `velocity(position)` returns an optional dvec3, and is called last for the step's position. If
/// it returns none, so does this. `first`: the velocity at `from`.
template <class Velocity>
[[nodiscard]] std::optional<RungeKuttaStep> dormand_prince_step(const Velocity& velocity, const dvec3& from,
                                                                const dvec3& first, double time) {
  constexpr std::array<std::array<double, 6>, 6> weights = {
      {{1. / 5},
       {3. / 40, 9. / 40},
       {44. / 45, -56. / 15, 32. / 9},
       {19372. / 6561, -25360. / 2187, 64448. / 6561, -212. / 729},
       {9017. / 3168, -355. / 33, 46732. / 5247, 49. / 176, -5103. / 18656},
       {35. / 384, 0, 500. / 1113, 125. / 192, -2187. / 6784, 11. / 84}}};
  constexpr std::array<double, 7> of_error = {71. / 57600,      0,         -71. / 16695, 71. / 1920,
                                              -17253. / 339200, 22. / 525, -1. / 40};
  std::array<dvec3, 7> velocities{first};
  RungeKuttaStep step{};
  for (std::size_t stage = 1; stage < velocities.size(); ++stage) {
    dvec3 mean(0);
    for (std::size_t k = 0; k < stage; ++k) mean += weights[stage - 1][k] * velocities[k];
    step.position = from + time * mean;
    const std::optional<dvec3> found = velocity(step.position);
    if (!found) return {};
    velocities[stage] = *found;
  }
  for (std::size_t k = 0; k < velocities.size(); ++k) step.error += time * of_error[k] * velocities[k];
  for (std::size_t k = 0; k < weights.back().size(); ++k)
    step.length += time * weights.back()[k] * glm::length(velocities[k]);
  step.velocity = velocities.back();
  return step;
}

}  // namespace splatvol
