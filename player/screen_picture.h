// The last picture as a screen takes it.
#pragma once

#include <cstdint>
#include <vector>

#include "base/math.h"
#include "pictures/image.h"
#include "scene/scene.h"

namespace splatvol {

/// A picture of the processor as a screen takes it: sRGB bytes of red, green, blue and alpha over the background, with
/// the scene's outline, the highest row first. Its width is 0 before the first.
struct EncodedPicture {
  int width = 0, height = 0;
  std::vector<std::uint8_t> bytes = {};
};

/// Lays a picture over the background of `scene`, with the outline of `box` if the scene has one.
void encode_picture(const Image& picture, const View& view, const Scene& scene, const Box& box,
                    EncodedPicture& encoded);

/// Keeps the last picture for a screen. The next one may be encoded meanwhile, by another thread.
class ScreenPicture {
 public:
  [[nodiscard]] const EncodedPicture& encoded() const { return shown_; }

  /// Whether it is that of the last picture, over the background and with the outline of `scene`.
  [[nodiscard]] bool is_of(const Scene& scene) const {
    return !is_old_ && background_ == scene.background && has_outline_ == scene.outline;
  }

  /// Returns whether the bytes have changed since the last call.
  [[nodiscard]] bool take_news();

  /// Encodes the last picture.
  void encode(const Image& picture, const View& view, const Scene& scene, const Box& box);

  /// Encodes the next picture, which `take_next` takes over. Another thread may call it.
  void encode_next(const Image& picture, const View& view, const Scene& scene, const Box& box) {
    encode_picture(picture, view, scene, box, next_);
  }
  void drop_next() { next_.bytes.clear(); }

  /// There is another last picture. `scene`: of the one that was encoded next, if one was.
  void take_next(const Scene& scene);

 private:
  void note(const Scene& scene);

  EncodedPicture shown_, next_;
  dvec3 background_{0};
  bool has_outline_ = false;
  bool is_old_ = true;
  bool is_new_ = false;
};

}  // namespace splatvol
