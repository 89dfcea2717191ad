// The pictures of a view at rest, from coarse to fine.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>

#include "base/error.h"
#include "pictures/image.h"
#include "player/error_control.h"
#include "splatvol/quality.h"
#include "streamer/splats/streamer.h"

namespace splatvol {

/// Decides how fine the next picture of a view at rest is. Each picture is a frame's work, so that a user who moves
/// again need not wait for the finest one.
class ProgressiveRefinement {
 public:
  /// Ends in a picture of `quality`, which has an error, a tolerance, a number of splats or a resolution. The last two
  /// are one picture. `first_splats`: of the first picture for an error; 0: what the model expects.
  explicit ProgressiveRefinement(const Quality& quality, std::uint64_t first_splats = 0);

  /// Returns the detail of the next picture, or of the last one if all are drawn.
  [[nodiscard]] const Detail& detail() const { return detail_; }

  /// Adds a frame of `detail` that has settled and was drawn. `picture` returns its picture, and is called if that is
  /// needed. Fails if it fails.
  [[nodiscard]] Status add(const FrameSplats& frame, const std::function<Result<Image>()>& picture);

  /// Leaves all pictures out: there is a better one.
  void skip() { done_ = true; }

  /// Whether the last picture is there.
  [[nodiscard]] bool is_done() const { return done_; }

  /// Returns the measured error of the last picture. None before the second, and unless it sharpens to an error.
  [[nodiscard]] std::optional<double> error() const;

  /// Whether it sharpens to an error.
  [[nodiscard]] bool seeks_error() const { return control_.has_value(); }

  /// Whether the last picture has the wanted error, or all that the file has.
  [[nodiscard]] bool has_reached() const { return control_ && control_->estimate().reached; }

 private:
  void ask();

  double last_tolerance_ = 0;            // per cent
  std::optional<ErrorControl> control_;  // of an error
  Detail detail_;
  bool done_ = false;
};

}  // namespace splatvol
