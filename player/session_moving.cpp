// Pictures of a session while something moves, and what it learns for them at rest.
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "base/interruption.h"
#include "pictures/image.h"
#include "player/session.h"
#include "renderer/cpu/srgb_bytes.h"
#include "renderer/cpu/wide_samples.h"
#include "scene/isovalue.h"

namespace splatvol {
namespace {

// Longest time that the picture of the step before stays. Then the new one is drawn as coarse as it is.
constexpr double longest_wait_seconds = 2;

// Longest wait of one frame for the first picture of a step.
constexpr double step_wait_seconds = 0.02;

// Surfaces need a sample for each pixel, and so do slices among splats: there, wide samples are pixels of a smaller
// picture.
Scene scaled(Scene scene, int sample_spacing) {
  scene.width = (scene.width + sample_spacing - 1) / sample_spacing;
  scene.height = (scene.height + sample_spacing - 1) / sample_spacing;
  return scene;
}

}  // namespace

// By a job where one may draw it: so the window goes on. A graphics card draws splats at once.
Status Session::begin_moving(double seconds) {
  motion_.set_limits(settings.moving);
  begin_holding_cells();
  if (settings.works_aside && draws_aside())
    return draw_aside(Work::moving, [this, seconds]() -> Status {
      SPLATVOL_TRY(choose_moving());
      return draw_moving(seconds);
    });
  SPLATVOL_TRY(choose_moving());
  if (settings.works_aside && moving_.rung.is_exact()) {
    SPLATVOL_TRY(encode_picture());
    return draw_aside(Work::moving, [this, seconds] { return draw_moving(seconds); });
  }
  return finish_moving(draw_moving(seconds));
}

Status Session::choose_moving() {
  const bool may_be_exact = first_exact_spacing() > 0 && !cells_fail_;
  SPLATVOL_TRY_ASSIGN(choices, player_->moving_choices(may_be_exact));
  if (!player_->shows_contours()) choices.most_segments = static_cast<double>(most_segments());
  const bool rests_as_splats =
      choices.cells && finest_exact_spacing(choices.cells->segment_work * choices.cells->segments) == 0;
  if (rests_as_splats) choices.cells.reset();
  if (!draws_aside()) choices.first_cells_seconds = 1.0 / 60;  // a graphics card draws as many pictures of splats
  moving_ = {.choices = choices, .rung = motion_.next(choices)};
  still_awaits_step_ = awaits_step_;
  return {};
}

// A picture that cannot be drawn of cells is drawn of splats, by the next call. At rest the reason is told.
Status Session::draw_moving(double seconds) {
  const bool is_small = moving_.rung.sample_spacing > 1 && (moving_.rung.is_exact() ? shows_surfaces() : has_layers());
  if (is_small) SPLATVOL_TRY(player_->set_scene(scaled(used_scene_, moving_.rung.sample_spacing)));
  const Rung drawn{moving_.rung.splats, is_small ? 1 : moving_.rung.sample_spacing};
  const double start = host_.now();
  if (!drawn.is_exact()) {
    SPLATVOL_TRY(draw_moving_splats(drawn, seconds));
  } else if (const Status exact = player_->draw_exact({}, drawn.sample_spacing); exact) {
    moving_.is_drawn = true;
    still_awaits_step_ = false;
  } else if (exact.error().code == ErrorCode::cancelled) {
    return exact;
  } else {
    moving_.has_failed = true;
  }
  took_seconds_ = host_.now() - start;
  return moving_.is_drawn ? encode_aside() : Status{};
}

Status Session::draw_moving_splats(const Rung& rung, double seconds) {
  SPLATVOL_TRY(choose_splats({.detail = {.goal = ErrorGoal{0, rung.splats}}, .wait_seconds = 0}, seconds));
  if (still_awaits_step_) return {};
  SPLATVOL_TRY(player_->draw({.sample_spacing = rung.sample_spacing}));
  moving_.is_drawn = true;
  return {};
}

// Contours are shells then. The picture of the step before stays until there is one that is as fine.
Status Session::choose_splats(const FrameRequest& request, double seconds) {
  if (player_->shows_contours())
    SPLATVOL_TRY(player_->set_scene(with_shells(player_->scene(), glm::length(bounds_.extent()))));
  FrameRequest waiting = request;
  if (awaits_step_) waiting.wait_seconds = step_wait_seconds;
  SPLATVOL_TRY(player_->choose(waiting));
  awaited_seconds_ += seconds;
  still_awaits_step_ = awaits_step_ && !player_->frame()->progress.settled && awaited_seconds_ < longest_wait_seconds;
  return {};
}

Status Session::finish_moving(const Status& drawn) {
  if (!drawn && drawn.error().code == ErrorCode::cancelled) return {};
  SPLATVOL_TRY(drawn);
  cells_fail_ = cells_fail_ || moving_.has_failed;
  if (moving_.has_failed) return {};
  const bool is_exact = moving_.rung.is_exact();
  if (!is_exact) note_frame();
  awaits_step_ = still_awaits_step_;
  if (!moving_.is_drawn) return {};

  MotionControl::Outcome outcome{.rung = moving_.rung};
  const bool is_whole = is_exact || frame()->progress.settled;
  if (!is_exact) {
    outcome.rung.splats = player_->counted(moving_.rung).splats;
    outcome.fragments = player_->times().draw.fragments;
    if (frame()->progress.complete) outcome.model_error = frame()->goal_error;
  }
  // Fewer splats would hardly change the time of surfaces.
  outcome.seconds = std::max(took_seconds_ - (is_exact ? 0 : player_->times().surfaces), 0.0);
  motion_.add(outcome, moving_.choices);
  const MotionControl::Expected expected = motion_.expected_error(outcome.rung, moving_.choices);
  const Rung shown{is_exact ? 0 : std::max<std::uint64_t>(frame()->splats, 1), moving_.rung.sample_spacing};
  note_drawn({shown, true, expected.error, expected.is_measured});
  moving_is_drawn_ = is_whole;
  return {};
}

bool Session::shows_surfaces() const { return std::ranges::any_of(used_scene_.surfaces, &SceneSurface::shown); }

// Cells can only move once they are in memory. They are read beside the pictures.
void Session::begin_holding_cells() {
  if (holding_cells_.is_begun() || !settings.hurries || cells_fail_ || first_exact_spacing() == 0) return;
  std::function<Status()> read = player_->cells_reader();
  if (!read) return;
  stop_holding_ = std::stop_source();
  const auto read_interruptibly = [read = std::move(read), stop = stop_holding_.get_token()] {
    const Interruptible interruptible(stop);
    return read();
  };
  holding_cells_ = {host_, read_interruptibly, SessionHost::Priority::low};
}

// Waits for the chunk that is being read. Whoever draws the cells meets an error of reading.
void Session::end_holding_cells() {
  stop_holding_.request_stop();
  if (holding_cells_.is_begun()) static_cast<void>(holding_cells_.take());
}

// The last picture of a movement has the view of the picture at rest, which tells its error.
void Session::keep_last_moving() {
  last_moving_.reset();
  if (!moving_is_drawn_ || player_->exact() || has_layers()) return;
  const DevicePicture picture = player_->picture();
  if (const auto* image = std::get_if<const Image*>(&picture)) last_moving_ = {**image, moving_.rung};
}

// Of an exact picture. While cells are not held, its time is that of reading.
Status Session::learn_time() {
  if (!player_->holds_cells()) return {};
  SPLATVOL_TRY_ASSIGN(choices, player_->moving_choices(true));
  if (choices.cells) motion_.add({.rung = {0, player_->sample_spacing()}, .seconds = draw_seconds_}, choices);
  return {};
}

// The picture at rest tells the errors of other ways to draw its view.
Status Session::learn_errors() {
  if (shows_surfaces() || !draws_aside()) return {};
  SPLATVOL_TRY_ASSIGN(choices, player_->moving_choices(first_exact_spacing() > 0));
  Image copy;
  SPLATVOL_TRY_ASSIGN(rest, player_->image_or_copy(copy));
  const auto learn = [&](const Rung& rung, const Image& picture) -> Status {
    SPLATVOL_TRY_ASSIGN(difference, compare_images(picture, *rest));
    motion_.add({.rung = rung, .error = difference.rmse}, choices);
    return check_interruption();
  };
  motion_.forget_view();
  if (last_moving_ && last_moving_->picture.width == rest->width && last_moving_->picture.height == rest->height)
    SPLATVOL_TRY(learn(last_moving_->rung, last_moving_->picture));
  last_moving_.reset();
  if (!player_->exact()) return {};
  for (int spacing = choices.widest_spacing; spacing > player_->sample_spacing(); spacing /= 2)
    SPLATVOL_TRY(learn({0, spacing}, with_wide_samples(*rest, spacing, player_->refined_difference())));
  if (player_->shows_contours() || has_layers()) return {};
  for (const Rung& rung : motion_.unmeasured(choices)) {
    SPLATVOL_TRY(check_interruption());
    SPLATVOL_TRY_ASSIGN(outcome, player_->try_splats(rung));
    if (outcome) motion_.add(*outcome, choices);
  }
  return {};
}

}  // namespace splatvol
