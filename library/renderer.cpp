#include "splatvol/renderer.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <utility>

#include "library/worker.h"
#include "player/player.h"

namespace splatvol {
namespace {

constexpr double default_error = .002;

double seconds_now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

Status check(const Quality& quality) {
  const int numbers = quality.max_error.has_value() + quality.max_splats.has_value() +
                      quality.tolerance_percent.has_value() + quality.resolution.has_value();
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

// All that draws lives on the worker's thread.
struct Renderer::Contents {
  std::unique_ptr<Player> player;
  RenderStatistics statistics;
  Worker worker;

  ~Contents() {
    worker.run([&] { player.reset(); });
  }

  Result<Image> take_picture(double start, const Status& drawn, std::optional<double> error = std::nullopt) {
    if (!drawn) return tl::unexpected(drawn.error());
    const FrameSplats& frame = *player->frame();
    const StreamerStatistics read = player->streamer().statistics();
    statistics = {.splats = frame.splats,
                  .error = error.value_or(frame.expected_error),
                  .is_complete = frame.progress.complete,
                  .is_settled = frame.progress.settled,
                  .missing_bytes = frame.progress.missing_bytes,
                  .bytes_read = read.bytes_read,
                  .bytes_held = read.bytes_resident_peak,
                  .seconds = seconds_now() - start,
                  .unreadable = frame.progress.errors};
    return player->image();
  }

  Result<Image> render(const Quality& quality) {
    const double start = seconds_now();
    SPLATVOL_TRY(check(quality));
    const DetailOptions detail = detail_of(quality, player->info().point_count());
    const bool compares = detail.goal && detail.goal->max_error > 0;
    if (!compares) return take_picture(start, player->draw_frame({.detail = detail}));
    SPLATVOL_TRY_ASSIGN(search, player->draw_to_error(detail.goal->max_error, !quality.max_error));
    return take_picture(start, {}, search.estimate.error);
  }

  Result<Image> render_within(double seconds) {
    const double start = seconds_now();
    return take_picture(start, player->draw_within(seconds));
  }

  Result<Image> render_now(double wait_seconds, const Quality& quality) {
    const double start = seconds_now();
    SPLATVOL_TRY(check(quality));
    const DetailOptions detail = detail_of(quality, player->info().point_count());
    return take_picture(start, player->draw_frame({.detail = detail, .wait_seconds = std::max(wait_seconds, 0.0)}));
  }
};

Renderer::Renderer(std::unique_ptr<Contents> contents) : contents_(std::move(contents)) {}
Renderer::Renderer(Renderer&&) noexcept = default;
Renderer& Renderer::operator=(Renderer&&) noexcept = default;
Renderer::~Renderer() = default;

Result<Renderer> Renderer::open(const std::string& path, const std::optional<Scene>& scene,
                                const RendererOptions& options) {
  auto contents = std::make_unique<Contents>();
  const PlayerOptions player_options{
      .memory = options.memory, .gpu_memory = options.gpu_memory, .device = options.device, .on_data = options.on_data};
  SPLATVOL_TRY(contents->worker.run([&]() -> Status {
    SPLATVOL_TRY_ASSIGN(player, Player::open(path, scene, player_options));
    contents->player = std::move(player);
    return {};
  }));
  return Renderer(std::move(contents));
}

const Scene& Renderer::scene() const { return contents_->player->scene(); }
const std::vector<double>& Renderer::times() const { return contents_->player->steps().times(); }
std::size_t Renderer::step() const { return contents_->player->step(); }
const RenderStatistics& Renderer::statistics() const { return contents_->statistics; }
std::string Renderer::device() const { return contents_->player->rasterizer().description(); }
void Renderer::cancel() { contents_->player->cancel(); }

Status Renderer::set_scene(const Scene& scene) {
  return contents_->worker.run([&] { return contents_->player->set_scene(scene); });
}

Result<Scene> Renderer::fitting_scene(const std::string& attribute, int width, int height) const {
  return contents_->worker.run(
      [&] { return contents_->player->fitting_scene(attribute, {.width = width, .height = height}); });
}

Status Renderer::set_surface_depths(std::optional<SurfaceDepths> depths) {
  std::shared_ptr<const SurfaceDepths> shared;
  if (depths) shared = std::make_shared<SurfaceDepths>(std::move(*depths));
  return contents_->worker.run([&] { return contents_->player->set_surface_depths(shared); });
}

Status Renderer::show_step(std::size_t step) {
  return contents_->worker.run([&] { return contents_->player->show_step(step); });
}

Result<Image> Renderer::render(const Quality& quality) {
  return contents_->worker.run([&] { return contents_->render(quality); });
}

Result<Image> Renderer::render_within(double seconds) {
  return contents_->worker.run([&] { return contents_->render_within(seconds); });
}

Result<Image> Renderer::render_now(double wait_seconds, const Quality& quality) {
  return contents_->worker.run([&] { return contents_->render_now(wait_seconds, quality); });
}

}  // namespace splatvol
