#include "player/scalar_bars.h"

#include <utility>

namespace splatvol {

Result<std::vector<PageBar>> scalar_bars_of(const Scene& scene, const format::VolumeInfo& info,
                                            const std::string& file) {
  std::vector<PageBar> bars;
  std::vector<BarColors> colors = bar_colors_of(scene);
  for (BarColors& of : colors) {
    SPLATVOL_TRY_ASSIGN(number, format::find_attribute(info, of.attribute, file));
    format::Attribute shown = info.attributes[static_cast<std::size_t>(number)];
    const bool has_its_unit = of.attribute == scene.attribute || colors.size() == 1;
    if (has_its_unit && !scene.scalar_bar.unit.empty()) shown.unit = scene.scalar_bar.unit;
    bars.push_back({format::label_of(shown), std::move(of.function)});
  }
  return bars;
}

}  // namespace splatvol
