#include "bench/moving/pictures.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "renderer/cpu/srgb_bytes.h"
#include "scene/srgb.h"

namespace splatvol {
namespace {

// Samples in a row of so many pixels: about the same way from both ends, so that the middle stays the same point.
int samples_of(int pixels) {
  const int most = (pixels + 2) / SampledPixels::spacing;
  return (most - pixels) % 2 == 0 ? most : most - 1;
}

int first_of(int pixels) { return (pixels - 1 - SampledPixels::spacing * (samples_of(pixels) - 1)) / 2; }

double light_of(const vec4& pixel) { return double{pixel.r} + pixel.g + pixel.b; }

double squared(double number) { return number * number; }

}  // namespace

SampledPixels SampledPixels::of(int picture_width, int picture_height) {
  return {samples_of(picture_width), samples_of(picture_height), first_of(picture_width), first_of(picture_height)};
}

Image sampled(const Image& picture) {
  const SampledPixels pixels = SampledPixels::of(picture.width, picture.height);
  Image sample{pixels.width, pixels.height, {}};
  sample.pixels.reserve(static_cast<std::size_t>(pixels.width) * static_cast<std::size_t>(pixels.height));
  for (int y = 0; y < pixels.height; ++y) {
    const vec4* row = &picture.at(pixels.left, pixels.top + SampledPixels::spacing * y);
    for (int x = 0; x < pixels.width; ++x) sample.pixels.push_back(row[SampledPixels::spacing * x]);
  }
  return sample;
}

Scene sampled_scene(Scene scene) {
  const SampledPixels pixels = SampledPixels::of(scene.width, scene.height);
  const double share = static_cast<double>(SampledPixels::spacing * pixels.height) / scene.height;
  constexpr double half_degree = std::numbers::pi / 360;
  Camera& camera = scene.camera;
  camera.vertical_fov_degrees = std::atan(share * std::tan(half_degree * camera.vertical_fov_degrees)) / half_degree;
  camera.parallel_height *= share;
  scene.width = pixels.width;
  scene.height = pixels.height;
  return scene;
}

void PictureKeeper::add(const CompletePicture& picture) {
  KeptPicture kept{picture.number, picture.scene, picture.step, picture.recipe, picture.seconds};
  kept.scene.width = picture.image.width;
  kept.scene.height = picture.image.height;
  kept.sample = sampled(picture.image);
  if (keeps_bytes_) encode_srgb(picture.image, picture.scene.background, kept.bytes);
  const std::lock_guard lock(mutex_);
  pictures_.push_back(std::move(kept));
}

void PictureKeeper::note_shown(std::uint64_t number, double time) {
  const std::lock_guard lock(mutex_);
  for (KeptPicture& picture : pictures_)
    if (picture.number == number && !picture.shown) picture.shown = time;
}

std::vector<KeptPicture> PictureKeeper::take_shown() {
  const std::lock_guard lock(mutex_);
  std::vector<KeptPicture> taken = std::exchange(pictures_, {});
  std::erase_if(taken, [](const KeptPicture& picture) { return !picture.shown; });
  return taken;
}

Differences compare(const Image& exact, const Image& picture, dvec3 background) {
  double squares = 0, srgb_squares = 0, light = 0, exact_light = 0, alpha = 0, exact_alpha = 0;
  for (std::size_t i = 0; i < exact.pixels.size(); ++i) {
    const vec4 &a = exact.pixels[i], &b = picture.pixels[i];
    exact_light += light_of(a), light += light_of(b);
    exact_alpha += a.a, alpha += b.a;
    for (int c = 0; c < 3; ++c) {
      squares += squared(double{a[c]} - b[c]);
      if (a == b) continue;
      srgb_squares += squared(srgb_of(a[c] + (1 - a.a) * background[c]) - srgb_of(b[c] + (1 - b.a) * background[c]));
    }
  }
  const auto count = static_cast<double>(exact.pixels.size());
  const auto ratio = [count](double sum, double exact_sum) {
    constexpr double nothing = 1e-3;  // of a pixel, in the mean
    return exact_sum > nothing * count ? std::optional(sum / exact_sum) : std::nullopt;
  };
  return {std::sqrt(squares / (3 * count)), std::sqrt(srgb_squares / (3 * count)), ratio(light, exact_light),
          ratio(alpha, exact_alpha)};
}

Result<ExactPictures> ExactPictures::open(const std::string& file, const Scene& scene, std::uint64_t memory) {
  SPLATVOL_TRY_ASSIGN(player, Player::open(file, scene, {.memory = memory, .device = Device::cpu}));
  if (player->has_cells()) SPLATVOL_TRY(player->hold_cells());
  return ExactPictures(std::move(player));
}

Result<const Image*> ExactPictures::sample_of(const Scene& scene, std::size_t step) {
  if (step_ == step && scene_ == scene) return &sample_;
  // The size of a splat's pixel counts, so that its picture needs all pixels.
  SPLATVOL_TRY_ASSIGN(picture, picture_of(player_->has_cells() ? sampled_scene(scene) : scene, step));
  sample_ = player_->has_cells() ? std::move(picture) : sampled(picture);
  scene_ = scene;
  step_ = step;
  return &sample_;
}

Result<Image> ExactPictures::picture_of(const Scene& scene, std::size_t step) {
  if (step != player_->step()) SPLATVOL_TRY(player_->show_step(step));
  SPLATVOL_TRY(player_->set_scene(scene));
  if (player_->has_cells())
    SPLATVOL_TRY(player_->draw(Recipe::of_cells()));
  else
    SPLATVOL_TRY(player_->draw_picture({.tolerance_percent = 0}));
  return player_->image();
}

}  // namespace splatvol
