// Chooses the number of splats of a frame so that frames take a wanted time.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace splatvol {

/// Learns from frame to frame. Assumes that a frame's time grows with its splats, a little less than in proportion.
/// After a change of view, splats may cover more pixels or fewer: the next frame adapts.
class FramePacer {
 public:
  /// Requires `seconds` to be finite and above 0, here and in `set_seconds`.
  explicit FramePacer(double seconds)
      : seconds_(seconds), splats_(std::clamp(first_rate * seconds, 1.0, most_splats)) {}

  /// Changes the time that frames are to take.
  void set_seconds(double seconds) {
    splats_ = std::clamp(splats_ * seconds / seconds_, 1.0, most_splats);
    seconds_ = seconds;
  }

  /// Returns the number of splats for the next frame.
  [[nodiscard]] std::uint64_t splats() const { return static_cast<std::uint64_t>(splats_); }

  /// Adds the time of a frame that was drawn with `splats`, all of them resident. Ignores times of 0 or less.
  void add(std::uint64_t splats, double seconds) {
    if (seconds <= 0 || splats == 0) return;
    const double ratio = std::clamp(std::pow(seconds_ / seconds, damping), 0.25, 4.0);
    splats_ = std::clamp(ratio * static_cast<double>(splats), 1.0, most_splats);
  }

  /// Whether a time is near enough to the wanted time.
  [[nodiscard]] bool is_near(double seconds) const { return std::abs(seconds - seconds_) <= 0.1 * seconds_; }

 private:
  static constexpr double first_rate = 3e5;  // splats a second for the first frame: as of a software rasterizer
  static constexpr double damping = 0.8;
  static constexpr double most_splats = 1e15;

  double seconds_;
  double splats_;
};

}  // namespace splatvol
