#include <algorithm>
#include <cmath>
#include <numbers>

#include "pictures/image.h"

namespace splatvol {
namespace {

constexpr float least_alpha = 1.0F / 255;  // of what a picture of 8 bits shows
constexpr int outline_reach = 3;           // pixels
constexpr double pattern_period = 16;      // pixels; a wave of this period keeps half of its height

/// Numbers of a picture's pixels.
struct Plane {
  int width, height;
  std::vector<double> numbers;

  [[nodiscard]] double& at(int x, int y) { return numbers[static_cast<std::size_t>(y) * width + x]; }
  [[nodiscard]] double at(int x, int y) const { return numbers[static_cast<std::size_t>(y) * width + x]; }
};

/// Returns 1 where a pixel is within outline_reach of an outline, and 0 elsewhere.
Plane outline_of(const Image& exact) {
  Plane near{exact.width, exact.height, std::vector<double>(exact.pixels.size())};
  const auto is_inside = [&](int x, int y) { return exact.at(x, y).a > least_alpha; };
  const auto mark = [&](int at_x, int at_y) {
    for (int y = std::max(at_y - outline_reach, 0); y <= std::min(at_y + outline_reach, exact.height - 1); ++y)
      for (int x = std::max(at_x - outline_reach, 0); x <= std::min(at_x + outline_reach, exact.width - 1); ++x)
        if ((x - at_x) * (x - at_x) + (y - at_y) * (y - at_y) <= outline_reach * outline_reach) near.at(x, y) = 1;
  };
  const auto mark_edge = [&](int x, int y, int other_x, int other_y) {
    if (other_x == exact.width || other_y == exact.height || is_inside(x, y) == is_inside(other_x, other_y)) return;
    mark(x, y);
    mark(other_x, other_y);
  };
  for (int y = 0; y < exact.height; ++y)
    for (int x = 0; x < exact.width; ++x) {
      mark_edge(x, y, x + 1, y);
      mark_edge(x, y, x, y + 1);
    }
  return near;
}

/// Weights of the Gaussian that halves a wave of pattern_period, from its middle on.
std::vector<double> gaussian() {
  const double deviation = pattern_period * std::sqrt(std::numbers::ln2 / 2) / std::numbers::pi;
  std::vector<double> weights(static_cast<std::size_t>(std::ceil(4 * deviation)) + 1);
  for (std::size_t i = 0; i < weights.size(); ++i) {
    const double x = static_cast<double>(i) / deviation;
    weights[i] = std::exp(-0.5 * x * x);
  }
  return weights;
}

Plane blurred_along(const Plane& from, const std::vector<double>& weights, int step_x, int step_y) {
  Plane to{from.width, from.height, std::vector<double>(from.numbers.size())};
  const int reach = static_cast<int>(weights.size()) - 1;
  for (int y = 0; y < from.height; ++y)
    for (int x = 0; x < from.width; ++x) {
      const int at = step_x * x + step_y * y, size = step_x * from.width + step_y * from.height;
      double sum = 0;
      for (int i = std::max(-reach, -at); i <= std::min(reach, size - 1 - at); ++i)
        sum += weights[static_cast<std::size_t>(std::abs(i))] * from.at(x + step_x * i, y + step_y * i);
      to.at(x, y) = sum;
    }
  return to;
}

Plane blurred(const Plane& plane, const std::vector<double>& weights) {
  return blurred_along(blurred_along(plane, weights, 1, 0), weights, 0, 1);
}

/// Root of the mean of squares.
struct RootMean {
  double squares = 0, count = 0;

  void add(double number) {
    squares += number * number;
    ++count;
  }
  [[nodiscard]] double root() const { return count > 0 ? std::sqrt(squares / count) : 0; }
};

}  // namespace

Result<SeenDifference> compare_as_seen(const Image& exact, const Image& picture) {
  SPLATVOL_TRY(compare_images(exact, picture).map([](const auto&) {}));  // they have the same size
  const Plane outline = outline_of(exact);
  Plane beside = outline;
  for (double& weight : beside.numbers) weight = 1 - weight;
  const std::vector<double> weights = gaussian();
  const Plane total = blurred(beside, weights);

  RootMean ripple, at_outline;
  for (int channel = 0; channel < 3; ++channel) {
    Plane difference = beside;
    for (std::size_t i = 0; i < exact.pixels.size(); ++i) {
      const double all = double{picture.pixels[i][channel]} - double{exact.pixels[i][channel]};
      if (outline.numbers[i] > 0) at_outline.add(all);
      difference.numbers[i] = beside.numbers[i] > 0 ? all : 0;
    }
    const Plane wide = blurred(difference, weights);
    for (std::size_t i = 0; i < exact.pixels.size(); ++i)
      if (beside.numbers[i] > 0) ripple.add(difference.numbers[i] - wide.numbers[i] / total.numbers[i]);
  }
  return SeenDifference{ripple.root(), at_outline.root()};
}

}  // namespace splatvol
