// The pictures that a session shows, kept to be compared with exact ones.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "player/player.h"
#include "player/session.h"

namespace splatvol {

/// Every third pixel of a picture, both ways. Pictures with samples 2, 4 or 8 pixels apart have as many samples among
/// them as among all pixels.
struct SampledPixels {
  static constexpr int spacing = 3;
  int width, height;  // of the samples
  int left, top;      // the first pixel

  /// Requires a picture of at least 4 x 4 pixels.
  [[nodiscard]] static SampledPixels of(int picture_width, int picture_height);
};

/// Returns these pixels of a picture as a picture.
[[nodiscard]] Image sampled(const Image& picture);

/// Returns a scene whose pixels are the pixels that `sampled` takes of this scene's: each has the same ray.
[[nodiscard]] Scene sampled_scene(Scene scene);

/// A picture that was drawn.
struct KeptPicture {
  std::uint64_t number;
  Scene scene;
  std::size_t step;
  ShownRecipe recipe;
  double seconds;                        // that drawing took
  std::optional<double> shown = {};      // when it was first seen; none: never
  Image sample = {};                     // empty: it is not compared
  std::vector<std::uint8_t> bytes = {};  // of all pixels, as EncodedPicture; empty unless they are asked for
};

/// Keeps pictures while a session draws. Thread-safe.
class PictureKeeper {
 public:
  explicit PictureKeeper(bool keeps_bytes) : keeps_bytes_(keeps_bytes) {}

  void add(const CompletePicture& picture);
  void note_shown(std::uint64_t number, double time);

  /// Returns the pictures that were shown, in their order, and forgets all.
  [[nodiscard]] std::vector<KeptPicture> take_shown();

 private:
  bool keeps_bytes_;
  std::mutex mutex_;
  std::vector<KeptPicture> pictures_;
};

/// How a picture differs from the exact one.
struct Differences {
  double rmse;                         // of linear premultiplied RGB
  double srgb_rmse;                    // over the scene's background, as on a screen
  std::optional<double> light, alpha;  // sum over that of the exact picture; none: that is about 0
};
[[nodiscard]] Differences compare(const Image& exact, const Image& picture, dvec3 background);

/// Draws exact pictures: of cells, or of all points of a file without cells.
class ExactPictures {
 public:
  [[nodiscard]] static Result<ExactPictures> open(const std::string& file, const Scene& scene, std::uint64_t memory);

  [[nodiscard]] bool has_cells() const { return player_->has_cells(); }

  /// Returns the sampled pixels of a scene's exact picture. Valid until the next call.
  [[nodiscard]] Result<const Image*> sample_of(const Scene& scene, std::size_t step);

  /// Returns all pixels of it.
  [[nodiscard]] Result<Image> picture_of(const Scene& scene, std::size_t step);

 private:
  explicit ExactPictures(std::unique_ptr<Player> player) : player_(std::move(player)) {}

  std::unique_ptr<Player> player_;
  Scene scene_;  // of the last sample
  std::optional<std::size_t> step_;
  Image sample_;
};

}  // namespace splatvol
