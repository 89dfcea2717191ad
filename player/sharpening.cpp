#include "player/sharpening.h"

#include <algorithm>

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

Status Sharpening::add(const FrameSplats& frame, const std::function<Result<Image>()>& picture) {
  if (done_) return {};
  if (!control_) {
    done_ = detail_.tolerance_percent == *options_.tolerance;
    detail_.tolerance_percent = std::max(*options_.tolerance, detail_.tolerance_percent / 2);
    return {};
  }
  SPLATVOL_TRY_ASSIGN(image, picture());
  const std::uint64_t allowed = frame.detail.goal.value_or(ErrorGoal{}).max_splats;
  control_->add({image, frame.splats, frame.goal_error, frame.finest, allowed});
  ask();
  return {};
}

std::optional<double> Sharpening::error() const {
  if (!control_ || control_->pictures() < 2) return std::nullopt;
  return control_->estimate().error;
}

}  // namespace splatvol
