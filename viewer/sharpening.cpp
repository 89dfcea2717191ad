#include "viewer/sharpening.h"

#include <algorithm>
#include <limits>

namespace splatvol {
namespace {

// The first tolerance.
constexpr double first_percent = 4;

}  // namespace

Sharpening::Sharpening(const Options& options) : options_(options) {
  if (options.tolerance) {
    // All points of a file are few, or somebody wants to see them.
    detail_.tolerance_percent = *options.tolerance > 0 ? std::max(first_percent, *options.tolerance) : 0;
    return;
  }
  control_.emplace(
      ErrorControl::Options{.max_error = options.max_error, .grows = true, .first_splats = options.first_splats});
  ask();
}

void Sharpening::ask() {
  if (const auto& next = control_->next())
    detail_.goal = next->goal;
  else
    done_ = true;
}

Status Sharpening::add(const FrameSplats& frame, const Rasterizer& renderer) {
  if (done_) return {};
  if (!control_) {
    done_ = detail_.tolerance_percent == *options_.tolerance;
    detail_.tolerance_percent = std::max(*options_.tolerance, detail_.tolerance_percent / 2);
    return {};
  }
  SPLATVOL_TRY_ASSIGN(image, renderer.read_image());
  std::uint64_t most_splats = std::numeric_limits<std::uint64_t>::max();
  if (frame.detail.goal && frame.detail.goal->max_splats < detail_.goal->max_splats)
    most_splats = frame.detail.goal->max_splats;
  control_->add({image, frame.splats, frame.goal_error, frame.finest, most_splats});
  ask();
  return {};
}

std::optional<double> Sharpening::error() const {
  if (!control_ || control_->pictures() < 2) return std::nullopt;
  return control_->estimate().error;
}

}  // namespace splatvol
