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

std::vector<std::size_t> pixels_of_rays(int width, int height, int spacing) {
  const int columns = rays_among(width, spacing), rows = rays_among(height, spacing);
  const int left = (width - 1 - (columns - 1) * spacing) / 2, top = (height - 1 - (rows - 1) * spacing) / 2;
  std::vector<std::size_t> pixels;
  pixels.reserve(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows));
  for (int y = 0; y < rows; ++y)
    for (int x = 0; x < columns; ++x)
      pixels.push_back(static_cast<std::size_t>(top + y * spacing) * static_cast<std::size_t>(width) +
                       static_cast<std::size_t>(left + x * spacing));
  return pixels;
}

std::vector<vec3> at_rays(const Image& picture, const Rays& rays) {
  std::vector<vec3> colors;
  colors.reserve(rays.image.pixels.size());
  for (const std::size_t pixel : pixels_of_rays(picture.width, picture.height, rays.spacing))
    colors.emplace_back(picture.pixels[pixel]);
  return colors;
}

}  // namespace splatvol
