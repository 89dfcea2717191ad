#include "player/progressive_refinement.h"

#include <algorithm>

#include "player/choice.h"

namespace splatvol {
namespace {

// The first tolerance.
constexpr double first_percent = 4;

}  // namespace

ProgressiveRefinement::ProgressiveRefinement(const Quality& quality, std::uint64_t first_splats) {
  if (quality.tolerance_percent) {
    last_tolerance_ = *quality.tolerance_percent;
    // All points of a file are few, or somebody wants to see them.
    detail_.tolerance_percent = last_tolerance_ > 0 ? std::max(first_percent, last_tolerance_) : 0;
  } else if (quality.max_splats || quality.resolution) {
    detail_ = expected_detail(quality);
    last_tolerance_ = detail_.tolerance_percent;
  } else {
    control_.emplace(*quality.max_error, ErrorControl::Search{.grows = true, .first_splats = first_splats});
    ask();
  }
}

void ProgressiveRefinement::ask() {
  if (const auto& next = control_->next())
    detail_.goal = next->goal;
  else
    done_ = true;
}

Status ProgressiveRefinement::add(const FrameSplats& frame, const std::function<Result<Image>()>& picture) {
  if (done_) return {};
  if (!control_) {
    done_ = detail_.tolerance_percent == last_tolerance_;
    detail_.tolerance_percent = std::max(last_tolerance_, detail_.tolerance_percent / 2);
    return {};
  }
  SPLATVOL_TRY_ASSIGN(image, picture());
  const std::uint64_t allowed = frame.detail.goal.value_or(ErrorGoal{}).max_splats;
  control_->add({image, frame.splats, frame.goal_error, frame.finest, allowed});
  ask();
  return {};
}

std::optional<double> ProgressiveRefinement::error() const {
  if (!control_ || control_->pictures() < 2) return std::nullopt;
  return control_->estimate().error;
}

}  // namespace splatvol
