#include "streamer/splats/detail.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace splatvol {
namespace {

// A tolerance that does not fit is doubled until it fits, and then refined by halving the interval.
constexpr double largest_raised_tolerance = 1 << 20;
constexpr int refinements = 4;

double next_tolerance(double refused) {
  if (refused >= largest_raised_tolerance) return std::numeric_limits<double>::infinity();
  return std::max(2 * refused, smallest_raised_tolerance);
}

// The coarseness is the number that is raised for less detail: the tolerance, or the inverse of a goal's splats.
double coarseness(const Detail& detail) {
  return detail.goal ? 1 / static_cast<double>(detail.goal->max_splats) : detail.tolerance_percent;
}

Detail with_coarseness(Detail detail, double coarseness) {
  if (detail.goal)
    detail.goal->max_splats = static_cast<std::uint64_t>(1 / coarseness);
  else
    detail.tolerance_percent = coarseness;
  return detail;
}

}  // namespace

Status check_detail(const Detail& detail) {
  if (detail.goal && !(detail.goal->expected_error >= 0))
    return fail(ErrorCode::invalid_argument, "an error of {} is out of range", detail.goal->expected_error);
  if (detail.tolerance_percent >= 0) return {};
  return fail(ErrorCode::invalid_argument, "a tolerance of {} % is out of range", detail.tolerance_percent);
}

bool make_coarser(Detail& detail) {
  if (detail.goal) return detail.goal->max_splats > 1 && (detail.goal->max_splats /= 2, true);
  if (detail.resolution) return *detail.resolution > 0 && (--*detail.resolution, true);
  if (std::isinf(detail.tolerance_percent)) return false;
  detail.tolerance_percent = next_tolerance(detail.tolerance_percent);
  return true;
}

bool is_finer(const Detail& detail, const Detail& other) {
  if (!detail.goal && detail.resolution && other.resolution) return *detail.resolution > *other.resolution;
  return coarseness(detail) < coarseness(other);
}

Result<Choice> choose_finest(Detail detail, const std::function<Result<Cut>(const Detail&)>& try_cut) {
  // Makes the detail coarser until it fits.
  Detail refused = detail;
  auto cut = try_cut(detail);
  while (!cut) {
    refused = detail;
    if (cut.error().code != ErrorCode::out_of_budget || !make_coarser(detail)) return tl::unexpected(cut.error());
    cut = try_cut(detail);
  }
  Choice best{std::move(*cut), detail};
  if (detail.resolution && !detail.goal) return best;

  // Makes it finer again while it fits.
  double too_fine = coarseness(refused);
  for (int i = 0; i < refinements; ++i) {
    const double fits = coarseness(best.detail);
    if (!(too_fine > 0 && too_fine < fits && std::isfinite(fits))) break;
    detail = with_coarseness(detail, std::sqrt(too_fine * fits));
    cut = try_cut(detail);
    if (cut)
      best = Choice{std::move(*cut), detail};
    else
      too_fine = coarseness(detail);
  }
  return best;
}

}  // namespace splatvol
