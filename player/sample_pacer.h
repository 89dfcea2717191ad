// Chooses how far apart the samples of an exact picture are so that it takes a wanted time.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace splatvol {

/// Learns from picture to picture how much work the machine does in a second.
class SamplePacer {
 public:
  /// Of a picture with a sample for each pixel; about.
  struct Work {
    std::uint64_t tetrahedra;
    std::uint64_t segments;  // pieces of rays in one
  };

  /// Changes the time that pictures are to take. Requires it to be finite and above 0.
  void set_seconds(double seconds) { seconds_ = seconds; }

  /// Returns how many pixels apart samples are in the next picture: the fewest that there is time for; 0: there is none
  /// for any. It changes only if it must, or if there is much time left: pictures with other samples look different.
  [[nodiscard]] int spacing(const Work& work) {
    constexpr double too_long = 1.4, short_enough = 0.4;
    const auto share = [&](int spacing) { return units(work, spacing) * seconds_of_unit_ / seconds_; };
    if (spacing_ > 0 && share(spacing_) <= too_long && (spacing_ == 1 || share(spacing_ / 2) > short_enough))
      return spacing_;
    spacing_ = 0;
    for (const int spacing : {widest, 2, 1})
      if (share(spacing) <= 1) spacing_ = spacing;
    return spacing_;
  }

  /// Whether there would be time for samples far apart.
  [[nodiscard]] bool fits(const Work& work) const { return units(work, widest) * seconds_of_unit_ <= seconds_; }

  /// Adds the time of a picture.
  void add(const Work& work, int spacing, double seconds) {
    const double of_unit = seconds / std::max(units(work, spacing), 1.0);
    seconds_of_unit_ +=
        learning * (std::clamp(of_unit, 0.25 * seconds_of_unit_, 4 * seconds_of_unit_) - seconds_of_unit_);
  }

 private:
  // Samples farther apart are worse than splats that take the same time (docs/accuracy.md).
  static constexpr int widest = 4;
  static constexpr double learning = 0.3;

  // The work, as segments of a picture with a sample for each pixel. The fewer samples, the more each one takes.
  static double units(const Work& work, int spacing) {
    constexpr double of_tetrahedron = 4, of_spacing = 1.6;
    return of_tetrahedron * static_cast<double>(work.tetrahedra) +
           static_cast<double>(work.segments) / std::pow(spacing, of_spacing);
  }

  double seconds_ = 0.011;
  double seconds_of_unit_ = 1.1e-8;  // of two cores
  int spacing_ = 0;
};

}  // namespace splatvol
