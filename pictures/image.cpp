#include "pictures/image.h"

#include <cmath>

namespace splatvol {
namespace {

/// Like std::max, but NaN counts as the largest.
double max_or_nan(double a, double b) { return std::isnan(b) || b > a ? b : a; }

}  // namespace

Result<ImageDifference> compare_images(const Image& a, const Image& b) {
  if (a.width != b.width || a.height != b.height || a.pixels.size() != b.pixels.size())
    return fail(ErrorCode::invalid_argument, "sizes differ: {} x {} and {} x {}", a.width, a.height, b.width, b.height);
  if (a.pixels.empty()) return fail(ErrorCode::invalid_argument, "the pictures are empty");

  ImageDifference difference{};
  double squares = 0;
  for (std::size_t i = 0; i < a.pixels.size(); ++i) {
    for (int channel = 0; channel < 3; ++channel) {
      const double value_a = a.pixels[i][channel];
      const double value_b = b.pixels[i][channel];
      squares += (value_a - value_b) * (value_a - value_b);
      difference.max = max_or_nan(difference.max, std::abs(value_a - value_b));
      difference.mean_a += value_a;
      difference.mean_b += value_b;
    }
  }
  const double count = 3.0 * static_cast<double>(a.pixels.size());
  difference.rmse = std::sqrt(squares / count);
  difference.psnr = -20 * std::log10(difference.rmse);
  difference.mean_a /= count;
  difference.mean_b /= count;
  return difference;
}

}  // namespace splatvol
