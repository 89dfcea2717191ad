#include "streamer/first/explain.h"

#include <algorithm>
#include <array>

#include "scene/box_in_view.h"
#include "streamer/first/survey.h"

namespace splatvol {
namespace {

bool is_in_sight(const View& view, const Box& box) {
  // A box is in sight if each of the five planes has a corner inside. Some boxes beside the view pass too.
  const std::array<dvec3, 8> corners = corners_in_view(view, box);
  for (int plane = 0; plane < 5; ++plane) {
    bool inside = false;
    for (const dvec3& p : corners) {
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

EmptyReason why_empty(const View& view, const Transfer& transfer, const ShownAttributes& attributes,
                      const Box& bounds) {
  const auto has_values = [](const format::Attribute& attribute) { return attribute.min <= attribute.max; };
  if (!has_values(attributes.values)) return {"no point has a value of the attribute", "choose another one"};
  if (!is_in_sight(view, bounds)) return {"the data lies outside of the view", "turn the camera to the data"};
  const auto hides_all = [&](const TransferFunction& function, const format::Attribute& attribute) {
    const auto low = static_cast<float>(attribute.stored(attribute.min));
    const auto high = static_cast<float>(attribute.stored(attribute.max));
    return view.slices.empty() && !ValueVisibility(function, attribute).shows(low, high, ~std::uint64_t{0});
  };
  if (hides_all(transfer.function, attributes.values))
    return {"the transfer function hides every value", "raise the density, or widen the domain"};
  if (transfer.opacity && attributes.opacity) {
    if (!has_values(*attributes.opacity) && view.slices.empty())
      return {"no point has a value of the opacity attribute", "choose another one"};
    if (hides_all(*transfer.opacity, *attributes.opacity))
      return {"the opacity's factors hide every value", "raise them, or widen their domain"};
  }
  if (ClipRegion{view.clip.box, {}}.excludes(bounds))
    return {"the clip box excludes all of the data", "move it, or leave it out"};
  if (view.clip.excludes(bounds)) return {"a clip plane excludes all of the data", "move it, turn it, or leave it out"};
  return {};
}

Result<EmptyReason> why_without_material(const format::Volume& volume) {
  if (volume.info().find_column(format::ColumnKind::moments) < 0) return EmptyReason{};
  constexpr std::uint64_t most_splats = 1000;  // coarse ones have the material of all others
  SPLATVOL_TRY_ASSIGN(found, survey_shapes(volume, most_splats));
  if (std::ranges::any_of(found.shapes, [](const SplatShape& shape) { return shape.mass > 0; })) return EmptyReason{};
  return EmptyReason{"no point has a volume: all cells are flat, or all points lie in a plane",
                     "give cells with a volume, or build with --connectivity none"};
}

EmptyReason why_empty_in_view(bool has_splats) {
  if (!has_splats) return {"the transfer function hides every value in view", "raise the density, or widen the domain"};
  return {"all that is in view is too faint to be seen", "raise the density"};
}

}  // namespace splatvol
