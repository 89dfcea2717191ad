#include "player/recipe.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace splatvol {
namespace {

// Splats of the first rung. Each one has about sqrt(2) times those of the one below it.
constexpr double fewest_splats = 64;

// Up to so many splats, samples are so many pixels apart; from as many on, they come closer together.
constexpr std::array ends = {std::pair{4, std::uint64_t{23170}}, std::pair{2, std::uint64_t{65536}},
                             std::pair{1, std::numeric_limits<std::uint64_t>::max()}};

}  // namespace

std::vector<Recipe> ladder_of_splats(const Choices& choices) {
  std::vector<Recipe> rungs;
  if (!choices.has_splats) return rungs;
  std::uint64_t before = 0;
  for (int step = 0; rungs.empty() || before < choices.points; ++step) {
    const auto usual = static_cast<std::uint64_t>(std::round(fewest_splats * std::exp2(0.5 * step)));
    const std::uint64_t splats = std::clamp(usual, std::min(choices.least_splats, choices.points), choices.points);
    std::uint64_t begin = 0;
    for (const auto& [usual_spacing, end] : ends) {
      const int spacing = std::clamp(usual_spacing, choices.finest_spacing, choices.widest_spacing);
      const bool is_here = (splats >= begin || splats == choices.points) && splats <= end;
      begin = end;
      const Recipe rung = Recipe::of_splats(splats, spacing);
      if (is_here && (rungs.empty() || rungs.back() != rung)) rungs.push_back(rung);
    }
    before = splats;
  }
  return rungs;
}

}  // namespace splatvol
