#include "library/renderer_core.h"

#include <algorithm>
#include <utility>

#include "player/choice.h"

namespace splatvol {

Result<std::unique_ptr<RendererCore>> RendererCore::open(const std::string& path, const std::optional<Scene>& scene,
                                                         const RendererOptions& options, bool in_current_context) {
  const bool is_automatic = options.device == Device::automatic;
  SPLATVOL_TRY_ASSIGN(player,
                      Player::open(path, scene,
                                   {.memory = options.memory,
                                    .gpu_memory = options.gpu_memory,
                                    .device = is_automatic && !in_current_context ? Device::cpu : options.device,
                                    .in_current_context = in_current_context,
                                    .on_data = options.on_data}));
  return std::unique_ptr<RendererCore>(new RendererCore(std::move(player)));
}

void RendererCore::take_statistics(Clock::time_point start, const std::optional<ErrorSearch>& search) {
  statistics_ = {};
  if (!player_->exact()) {
    const FrameSplats& frame = *player_->frame();
    statistics_ = {.splats = frame.splats,
                   .error = search ? search->estimate.error : frame.expected_error,
                   .is_complete = frame.progress.complete,
                   .is_settled = frame.progress.settled,
                   .missing_bytes = frame.progress.missing_bytes,
                   .unreadable = frame.progress.errors};
  }
  const StreamerStatistics read = player_->streamer().statistics();
  statistics_.bytes_read = read.bytes_read;
  statistics_.bytes_held = read.bytes_resident_peak;
  statistics_.requests = read.requests;
  statistics_.seconds = seconds_since(start);
  const auto left_out = player_->left_out();
  if (!left_out) return;
  statistics_.is_complete = false;
  statistics_.unreadable.push_back(*left_out);
}

Status RendererCore::draw(const Quality& quality) {
  const auto start = Clock::now();
  SPLATVOL_TRY(check_quality(quality));
  if (quality.exact && player_->options().in_current_context)
    return fail(ErrorCode::invalid_argument, "OpenGL draws no exact pictures: take a Renderer, or draw splats");
  SPLATVOL_TRY_ASSIGN(drawn, player_->draw_picture(quality));
  take_statistics(start, drawn.search);
  return {};
}

Status RendererCore::draw_now(double wait_seconds, const Quality& quality) {
  const auto start = Clock::now();
  SPLATVOL_TRY(check_quality(quality));
  if (quality.exact || quality.milliseconds)
    return fail(ErrorCode::invalid_argument, "{} has no frames on the way to it: render the complete one",
                quality.exact ? "an exact picture" : "a picture in a time");
  const bool is_default = quality == Quality();
  const Detail detail = expected_detail(is_default ? default_splats(player_->info().point_count()) : quality);
  SPLATVOL_TRY(player_->draw({detail}, std::max(0.0, wait_seconds)));
  take_statistics(start, std::nullopt);
  return {};
}

Result<Scene> RendererCore::fitting_scene(const std::string& attribute, int width, int height) const {
  return player_->fitting_scene(attribute, {.width = width, .height = height});
}

}  // namespace splatvol
