#include "pictures/contrast.h"

namespace splatvol {
namespace {

constexpr double density_ratio = 2;  // of a light to a dark background
constexpr double brightest_on_light = 0.3;
constexpr double darkest_on_dark = 0.04;

}  // namespace

double luminance(const dvec3& rgb) { return glm::dot(rgb, dvec3(0.2126, 0.7152, 0.0722)); }

// The luminance that is as far from black as from white to the eye (CIE lightness 50).
bool is_light(const dvec3& background) { return luminance(background) > 0.184; }

void adapt_to_background(Scene& scene, const dvec3& background) {
  const bool was_light = is_light(scene.background), light = is_light(background);
  scene.background = background;
  for (auto& density : scene.transfer_function.densities)
    if (light != was_light) density.extinction *= light ? density_ratio : 1 / density_ratio;
  for (auto& [t, rgb] : scene.transfer_function.colors) {
    const double now = luminance(rgb);
    if (light && now > brightest_on_light) rgb *= brightest_on_light / now;
    if (!light && now < darkest_on_dark) rgb += dvec3(darkest_on_dark - now);
  }
}

}  // namespace splatvol
