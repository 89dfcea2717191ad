#include "streamer/explain.h"

#include <algorithm>
#include <array>

#include "streamer/survey.h"
#include "streamer/visibility.h"

namespace splatvol {
namespace {

bool is_in_sight(const View& view, const Box& box) {
  // A box is in sight if each of the five planes has a corner inside. Some boxes beside the view pass too.
  for (int plane = 0; plane < 5; ++plane) {
    bool inside = false;
    for (int corner = 0; corner < 8; ++corner) {
      const dvec3 p = view.to_view({corner & 1 ? box.high.x : box.low.x, corner & 2 ? box.high.y : box.low.y,
                                    corner & 4 ? box.high.z : box.low.z});
      const double depth = view.orthographic ? 1 : p.z;
      const double x = view.focal * p.x, y = view.focal * p.y;
      const double half_width = 0.5 * view.width * depth, half_height = 0.5 * view.height * depth;
      const std::array<double, 5> distances = {view.orthographic ? 1 : p.z, half_width - x, half_width + x,
                                               half_height - y, half_height + y};
      inside = inside || distances[static_cast<std::size_t>(plane)] > 0;
    }
    if (!inside) return false;
  }
  return true;
}

}  // namespace

EmptyReason why_empty(const View& view, const TransferFunction& function, const format::Attribute& attribute,
                      const Box& bounds) {
  if (!(attribute.min <= attribute.max)) return {"no point has a value of the attribute", "choose another one"};
  if (!is_in_sight(view, bounds)) return {"the data lies outside of the view", "turn the camera to the data"};
  const ValueVisibility visibility(function, attribute);
  const auto low = static_cast<float>(attribute.stored(attribute.min));
  const auto high = static_cast<float>(attribute.stored(attribute.max));
  if (view.slices.empty() && !visibility.shows(low, high, ~std::uint64_t{0}))
    return {"the transfer function hides every value", "raise the density, or widen the domain"};
  if (ClipRegion{view.clip.box, {}}.excludes(bounds))
    return {"the clip box excludes all of the data", "move it, or leave it out"};
  if (view.clip.excludes(bounds)) return {"a clip plane excludes all of the data", "move it, turn it, or leave it out"};
  return {};
}

Result<EmptyReason> why_without_material(const format::Volume& volume) {
  if (volume.info().find_column(format::ColumnKind::moments) < 0) return EmptyReason{};
  constexpr std::uint64_t most_splats = 1000;  // coarse ones have the material of all others
  SPLATVOL_TRY_ASSIGN(found, survey_shapes(volume, most_splats));
  if (std::ranges::any_of(found.shapes, [](const format::SplatShape& shape) { return shape.mass > 0; }))
    return EmptyReason{};
  return EmptyReason{"no point has a volume: all cells are flat, or all points lie in a plane",
                     "give cells with a volume, or build with --connectivity none"};
}

EmptyReason why_empty_in_view(bool has_splats) {
  if (!has_splats) return {"the transfer function hides every value in view", "raise the density, or widen the domain"};
  return {"all that is in view is too faint to be seen", "raise the density"};
}

}  // namespace splatvol
