#include "library/renderer_core.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <utility>

namespace splatvol {
namespace {

constexpr double default_error = .002;

double seconds_now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

int number_count(const Quality& quality) {
  return quality.max_error.has_value() + quality.max_splats.has_value() + quality.tolerance_percent.has_value() +
         quality.resolution.has_value() + (quality.exact ? 1 : 0);
}

Status check(const Quality& quality) {
  const int numbers = number_count(quality);
  if (numbers > 1) return fail(ErrorCode::invalid_argument, "a quality has one number, not {}", numbers);
  if (quality.max_error && !(*quality.max_error > 0 && std::isfinite(*quality.max_error)))
    return fail(ErrorCode::invalid_argument, "an error of {}: take one above 0", *quality.max_error);
  if (quality.max_splats && *quality.max_splats == 0)
    return fail(ErrorCode::invalid_argument, "0 splats show nothing: take more");
  return {};
}

// The detail of a quality, without comparing pictures.
DetailOptions detail_of(const Quality& quality, std::uint64_t points) {
  DetailOptions detail;
  if (quality.tolerance_percent) {
    detail.tolerance_percent = *quality.tolerance_percent;
  } else if (quality.resolution) {
    detail.resolution = quality.resolution;
  } else if (quality.max_splats) {
    detail.goal = ErrorGoal{0, *quality.max_splats};
  } else if (!quality.max_error && points <= points_drawn_at_once) {
    detail.tolerance_percent = 0;
  } else {
    detail.goal = ErrorGoal{quality.max_error.value_or(default_error), std::numeric_limits<std::uint64_t>::max()};
  }
  return detail;
}

}  // namespace

Result<std::unique_ptr<RendererCore>> RendererCore::open(const std::string& path, const std::optional<Scene>& scene,
                                                         const RendererOptions& options, bool in_current_context) {
  SPLATVOL_TRY_ASSIGN(player, Player::open(path, scene,
                                           {.memory = options.memory,
                                            .gpu_memory = options.gpu_memory,
                                            .device = options.device,
                                            .in_current_context = in_current_context,
                                            .on_data = options.on_data}));
  return std::unique_ptr<RendererCore>(new RendererCore(std::move(player)));
}

Status RendererCore::take_statistics(double start, const Status& drawn, std::optional<double> error) {
  if (!drawn) return drawn;
  const FrameSplats& frame = *player_->frame();
  const StreamerStatistics read = player_->streamer().statistics();
  statistics_ = {.splats = frame.splats,
                 .error = error.value_or(frame.expected_error),
                 .is_complete = frame.progress.complete,
                 .is_settled = frame.progress.settled,
                 .missing_bytes = frame.progress.missing_bytes,
                 .bytes_read = read.bytes_read,
                 .bytes_held = read.bytes_resident_peak,
                 .seconds = seconds_now() - start,
                 .unreadable = frame.progress.errors};
  add_left_out();
  return {};
}

void RendererCore::add_left_out() {
  const auto left_out = player_->left_out();
  if (!left_out) return;
  statistics_.is_complete = false;
  statistics_.unreadable.push_back(*left_out);
}

Status RendererCore::draw_exact() {
  const double start = seconds_now();
  if (player_->options().in_current_context)
    return fail(ErrorCode::invalid_argument, "OpenGL draws no exact pictures: take a Renderer, or draw splats");
  SPLATVOL_TRY(player_->draw_exact());
  statistics_ = {};
  statistics_.bytes_read = player_->streamer().volume().bytes_read();
  statistics_.seconds = seconds_now() - start;
  add_left_out();
  return {};
}

// Whether cells are drawn where nobody tells how good a picture is to be.
Result<bool> RendererCore::is_exact_by_default() {
  const PlayerOptions& options = player_->options();
  if (options.in_current_context || options.device == Device::gl || !player_->has_cells()) return false;
  if (player_->shows_contours()) return true;
  SPLATVOL_TRY_ASSIGN(estimate, player_->estimate_exact());
  return estimate.segments <= most_exact_segments && estimate.unknown_cells == 0;
}

Status RendererCore::draw(const Quality& quality) {
  const double start = seconds_now();
  SPLATVOL_TRY(check(quality));
  if (quality.exact) return draw_exact();
  if (number_count(quality) == 0) {
    SPLATVOL_TRY_ASSIGN(is_exact, is_exact_by_default());
    if (is_exact) {
      const Status drawn = draw_exact();
      // Cells too thin for an exact picture are drawn as splats.
      if (drawn || drawn.error().code != ErrorCode::unsupported) return drawn;
    }
  }
  const DetailOptions detail = detail_of(quality, player_->info().point_count());
  const bool compares = detail.goal && detail.goal->max_error > 0;
  if (!compares) return take_statistics(start, player_->draw_frame({.detail = detail}));
  SPLATVOL_TRY_ASSIGN(search, player_->draw_to_error(detail.goal->max_error, !quality.max_error));
  return take_statistics(start, {}, search.estimate.error);
}

Status RendererCore::draw_within(double seconds) {
  const double start = seconds_now();
  return take_statistics(start, player_->draw_within(seconds));
}

Status RendererCore::draw_now(double wait_seconds, const Quality& quality) {
  const double start = seconds_now();
  SPLATVOL_TRY(check(quality));
  if (quality.exact)
    return fail(ErrorCode::invalid_argument,
                "an exact picture has no frames on the way to it: render the complete one");
  const DetailOptions detail = detail_of(quality, player_->info().point_count());
  return take_statistics(start, player_->draw_frame({.detail = detail, .wait_seconds = std::max(0.0, wait_seconds)}));
}

Result<Scene> RendererCore::fitting_scene(const std::string& attribute, int width, int height) const {
  return player_->fitting_scene(attribute, {.width = width, .height = height});
}

}  // namespace splatvol
