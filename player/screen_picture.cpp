#include "player/screen_picture.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "pictures/contrast.h"
#include "pictures/outline.h"
#include "renderer/cpu/srgb_bytes.h"

namespace splatvol {

// Only pixels with strokes are encoded again.
void encode_picture(const Image& picture, const View& view, const Scene& scene, const Box& box,
                    EncodedPicture& encoded) {
  encode_srgb(picture, scene.background, encoded.bytes);
  encoded.width = picture.width, encoded.height = picture.height;
  if (!scene.outline || view.width != picture.width || view.height != picture.height) return;
  const dvec3 ink = ink_on(scene.background);
  std::vector<std::size_t> places;
  Image changed;
  for (const OutlineStroke& stroke : outline_strokes(view, box)) {
    if (places.empty() || places.back() != stroke.pixel) {
      places.push_back(stroke.pixel);
      changed.pixels.push_back(picture.pixels[stroke.pixel]);
    }
    changed.pixels.back() = with_stroke(changed.pixels.back(), stroke, ink);
  }
  changed.width = static_cast<int>(places.size()), changed.height = 1;
  std::vector<std::uint8_t> bytes;
  encode_srgb(changed, scene.background, bytes);
  for (std::size_t i = 0; i < places.size(); ++i) std::copy_n(&bytes[4 * i], 4, &encoded.bytes[4 * places[i]]);
}

bool ScreenPicture::take_news() { return std::exchange(is_new_, false); }

void ScreenPicture::encode(const Image& picture, const View& view, const Scene& scene, const Box& box) {
  encode_picture(picture, view, scene, box, shown_);
  note(scene);
}

void ScreenPicture::take_next(const Scene& scene) {
  is_old_ = true;
  if (next_.bytes.empty()) return;
  std::swap(shown_, next_);
  next_.bytes.clear();
  note(scene);
}

void ScreenPicture::note(const Scene& scene) {
  background_ = scene.background;
  has_outline_ = scene.outline;
  is_old_ = false;
  is_new_ = true;
}

}  // namespace splatvol
