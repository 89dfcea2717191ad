// The pictures of a view at rest, from coarse to fine.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>

#include "base/error.h"
#include "pictures/image.h"
#include "player/error_control.h"
#include "streamer/streamer.h"

namespace splatvol {

/// Decides how fine the next picture of a view at rest is. Each picture is a frame's work, so that a user who moves
/// again need not wait for the finest one.
class Sharpening {
 public:
  /// What the pictures end in.
  struct Options {
    double max_error = default_max_error;            // RMSE against the exact picture
    std::optional<double> tolerance = std::nullopt;  // per cent, instead of an error; 0: all points
    std::uint64_t first_splats = 0;                  // of the first picture for an error; 0: what the model expects
  };

  explicit Sharpening(const Options& options);

  /// Returns the detail of the next picture, or of the last one if all are drawn.
  [[nodiscard]] const DetailOptions& detail() const { return detail_; }

  /// Adds a frame of `detail` that has settled and was drawn. `picture` returns its picture, and is called if that is
  /// needed. Fails if it fails.
  [[nodiscard]] Status add(const FrameSplats& frame, const std::function<Result<Image>()>& picture);

  /// Leaves all pictures out: there is a better one.
  void skip() { done_ = true; }

  /// Whether the last picture is there.
  [[nodiscard]] bool is_done() const { return done_; }

  /// Returns the measured error of the last picture. None before the second, and for a tolerance.
  [[nodiscard]] std::optional<double> error() const;

  /// Whether the last picture has the wanted error, or all that the file has.
  [[nodiscard]] bool has_reached() const { return control_ && control_->estimate().reached; }

 private:
  void ask();

  Options options_;
  std::optional<ErrorControl> control_;  // of an error
  DetailOptions detail_;
  bool done_ = false;
};

}  // namespace splatvol
