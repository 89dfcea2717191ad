#include "player/choice.h"

namespace splatvol {

int spacing_of_cells(const Choices& choices) {
  if (!choices.cells) return 0;
  if (!choices.has_splats) return choices.finest_spacing;
  for (int spacing = choices.finest_spacing; spacing <= choices.widest_spacing; spacing *= 2)
    if (choices.cells->segment_work * sampled_segments(*choices.cells, spacing) <= choices.most_segments)
      return spacing;
  return 0;
}

Quality default_splats(std::uint64_t points) {
  if (points <= most_points_at_once) return {.tolerance_percent = 0};
  return {.max_error = default_max_error};
}

bool asks_for_splats(const Quality& quality) {
  return quality.tolerance_percent || quality.max_splats || quality.resolution;
}

Detail expected_detail(const Quality& quality) {
  if (quality.tolerance_percent) return {.tolerance_percent = *quality.tolerance_percent};
  if (quality.resolution) return {.resolution = quality.resolution};
  if (quality.max_splats) return {.goal = ErrorGoal{0, *quality.max_splats}};
  return {.goal = ErrorGoal{*quality.max_error}};
}

}  // namespace splatvol
