// How many splats a frame may have to take no longer than it should.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace splatvol {

/// Learns from frame to frame. A frame's time is taken to grow with its splats, a little less than in proportion: a
/// view in which they cover more pixels is answered by the next frame.
class FramePacer {
 public:
  explicit FramePacer(double seconds) : seconds_(seconds), splats_(first_rate * seconds) {}

  /// For the next frame.
  [[nodiscard]] std::uint64_t splats() const { return static_cast<std::uint64_t>(std::max(splats_, 1.0)); }

  /// What a frame took that was drawn with `splats`, all of them resident. Times of 0 or less mean nothing.
  void add(std::uint64_t splats, double seconds) {
    if (seconds <= 0 || splats == 0) return;
    const double ratio = std::clamp(std::pow(seconds_ / seconds, damping), 0.25, 4.0);
    splats_ = std::clamp(ratio * static_cast<double>(splats), 1.0, 1e15);
  }

  /// Whether a time is near enough to the one that was asked for.
  [[nodiscard]] bool is_near(double seconds) const { return std::abs(seconds - seconds_) <= 0.1 * seconds_; }

 private:
  static constexpr double first_rate = 3e5;  // splats a second, before anything is known: a software rasterizer
  static constexpr double damping = 0.8;

  double seconds_;
  double splats_;
};

}  // namespace splatvol
