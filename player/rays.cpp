#include "player/rays.h"

#include <algorithm>
#include <cmath>

namespace splatvol {
namespace {

constexpr double fewest_rays = 8192;  // of a picture with more pixels

// As many as there is room for, an odd number if `pixels` is odd: then the middle of both is the same pixel or edge.
int rays_among(int pixels, int spacing) {
  const int most = (pixels - 1) / spacing + 1;
  return most - (pixels - most) % 2;
}

}  // namespace

int spacing_of_rays(int width, int height) {
  const double spacing = std::sqrt(static_cast<double>(width) * height / fewest_rays);
  const int most = std::min(static_cast<int>(spacing), std::min(width, height) - 1);
  return most < 1 ? 1 : most - (most + 1) % 2;
}

View view_of_rays(View view, int spacing) {
  view.width = rays_among(view.width, spacing);
  view.height = rays_among(view.height, spacing);
  view.focal /= spacing;
  return view;
}

std::vector<vec3> at_rays(const Image& picture, const Rays& rays) {
  const int left = (picture.width - 1 - (rays.image.width - 1) * rays.spacing) / 2;
  const int top = (picture.height - 1 - (rays.image.height - 1) * rays.spacing) / 2;
  std::vector<vec3> colors;
  colors.reserve(rays.image.pixels.size());
  for (int y = 0; y < rays.image.height; ++y)
    for (int x = 0; x < rays.image.width; ++x)
      colors.emplace_back(picture.at(left + x * rays.spacing, top + y * rays.spacing));
  return colors;
}

}  // namespace splatvol
