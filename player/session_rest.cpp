// Pictures of a session at rest: finer and finer ones, to the exact one.
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <limits>
#include <utility>

#include "player/choice.h"
#include "player/session.h"

namespace splatvol {
namespace {

// The first picture at rest for an error has at least so many splats: it costs little.
constexpr std::uint64_t least_first_splats = std::uint64_t{1} << 13;

// Pixels between samples of the first exact picture at rest, unless it follows one of cells or has many segments.
constexpr int first_spacing = 4, widest_spacing = 8;

// No splats come before cells that are as quick as this, in seconds.
constexpr double quick_cells = 0.25;

}  // namespace

bool Session::can_draw_aside() const { return settings.hurries && draws_aside(); }

// Begins with a picture that is no coarser than the last one of the movement. Rounds its splats, which depend on the
// machine's load.
void Session::begin_rest() {
  motion_.rest();
  keep_last_moving();
  cells_fail_ = false;
  std::uint64_t first_splats = 0;
  if (settings.hurries && frame()) first_splats = std::bit_ceil(std::max(frame()->splats, least_first_splats));
  refinement_.emplace(quality_of_splats(), first_splats);
  exact_spacing_ = first_exact_spacing();
  if (player_->shows_contours() && !player_->has_cells())
    tell_of_splats(path_ + ": it keeps no cells, and only these have contours");
  else if (settings.quality.exact && !player_->has_cells())
    tell_of_splats(path_ + ": it keeps no cells");
  is_to_make_ready_ = can_draw_aside() && (exact_spacing_ > 0 || last_moving_);
  const bool follows_cells = moving_is_drawn_ && player_->exact();
  const int quick_spacing = exact_spacing_ > 0 ? this->quick_spacing() : 0;
  skips_splats_ = exact_spacing_ > 0 && settings.hurries && (follows_cells || quick_spacing > 0);
  if (!skips_splats_) return;
  refinement_->skip();
  // With surfaces, the last picture may be a small one.
  if (follows_cells && !shows_surfaces())
    exact_spacing_ = finer_exact_spacing();
  else if (quick_spacing > 0)
    exact_spacing_ = quick_spacing;
}

// Returns the widest spacing of samples of cells that are held, soon drawn, and no worse than the last picture of the
// movement; 0: there is none.
int Session::quick_spacing() const {
  const Choices& choices = moving_.choices;
  if (!moving_is_drawn_ || !choices.cells || !player_->holds_cells()) return 0;
  for (int spacing = std::max(widest_moving_samples, finest_spacing()); spacing >= finest_spacing(); spacing /= 2)
    if (motion_.expected_seconds({0, spacing}, choices) < quick_cells &&
        motion_.expected_error({0, spacing}, choices).error <= shown_recipe_.error)
      return spacing;
  return 0;
}

// Begins a finer picture of splats.
Status Session::begin_splats(double seconds) {
  const FrameRequest request{.detail = refinement_->detail(), .wait_seconds = 0};
  if (can_draw_aside())
    return draw_aside(Work::splats, [this, request, seconds] { return draw_splats(request, seconds); });
  return finish_splats(draw_splats(request, seconds));
}

// Chooses splats and draws them.
Status Session::draw_splats(const FrameRequest& request, double seconds) {
  const double start = host_.now();
  SPLATVOL_TRY(choose_splats(request, seconds));
  if (still_awaits_step_) return {};
  SPLATVOL_TRY(player_->draw());
  took_seconds_ = host_.now() - start;
  if (!draws_aside()) return {};
  SPLATVOL_TRY(encode_aside());
  if (!request.detail.goal || !player_->frame()->progress.settled) return {};
  // What `finish_picture` compares. It is copied here, where nobody waits for it.
  SPLATVOL_TRY_SET(drawn_aside_, player_->image());
  return {};
}

Status Session::finish_splats(const Status& drawn) {
  std::optional<Image> image = std::exchange(drawn_aside_, std::nullopt);
  if (!drawn && drawn.error().code == ErrorCode::cancelled) return {};
  SPLATVOL_TRY(drawn);
  note_frame();
  awaits_step_ = still_awaits_step_;
  if (awaits_step_) return {};
  note_drawn({.rung = {std::max<std::uint64_t>(frame()->splats, 1), player_->sample_spacing()}});
  return frame()->progress.settled ? finish_picture(std::move(image)) : Status{};
}

// All points of a small file are soon there: nobody measures their error.
Quality Session::quality_of_splats() const {
  if (asks_for_splats(used_settings_.quality)) return used_settings_.quality;
  const Quality usual = default_splats(info().point_count());
  return usual.max_error && used_settings_.quality.max_error ? used_settings_.quality : usual;
}

// Returns how many segments an exact picture may have.
std::uint64_t Session::most_segments() const {
  return used_settings_.quality.exact ? std::numeric_limits<std::uint64_t>::max() : used_settings_.most_exact_segments;
}

// Returns the least spacing of samples in any picture.
int Session::finest_spacing() const { return used_settings_.drawing.sample_spacing.value_or(1); }

// Where nobody looks at coarser pictures, there are none. 0: splats are wanted, or there is nothing else. Splats have
// no contours.
int Session::first_exact_spacing() const {
  const ViewSettings& used = used_settings_;
  const bool wants_splats =
      asks_for_splats(used.quality) || kernel_of(used.drawing) == KernelKind::octant || most_segments() == 0;
  if ((wants_splats && !player_->shows_contours()) || !player_->has_cells()) return 0;
  return used.hurries ? std::max(first_spacing, finest_spacing()) : finest_spacing();
}

// Returns the finest spacing of samples that is not too much work; 0: there is none. Contours are exact, whatever the
// work.
int Session::finest_exact_spacing(double segments) const {
  const int finest = finest_spacing();
  if (player_->shows_contours()) return finest;
  const bool must_read = player_->streamer().volume().is_far() && !player_->holds_cells();  // most of the work
  for (int spacing = finest; spacing <= (must_read ? finest : std::max(finest, widest_spacing)); spacing *= 2)
    if (sampled_segments({0, segments}, spacing) <= static_cast<double>(most_segments())) return spacing;
  return 0;
}

// Returns the spacing of the exact picture after the last one; 0: that was the finest. With surfaces, all are.
int Session::finer_exact_spacing() const {
  const int last = player_->sample_spacing();
  return last > finest_spacing() ? std::max(std::min(last / 2, first_spacing), finest_spacing()) : 0;
}

// Begins the next exact picture. Until it is there, the window shows a copy of the one before.
Status Session::begin_exact() {
  SPLATVOL_TRY(encode_picture());
  if (settings.hurries) return draw_aside(Work::exact, [this] { return draw_exact(); });
  return finish_exact(draw_exact());
}

// Draws it, unless it is too much work: then none follows. Needs no context of OpenGL.
Status Session::draw_exact() {
  SPLATVOL_TRY_ASSIGN(estimate, player_->estimate_exact());
  if (estimate.unknown_cells > 0)
    return fail(ErrorCode::unsupported, "{}: {} of its cells have shapes that only a newer svview knows", path_,
                estimate.unknown_cells);
  const int finest = finest_exact_spacing(estimate.counted_segments());
  const bool is_there = player_->exact() && !shows_surfaces() && player_->sample_spacing() <= finest;
  if (finest == 0 || is_there) {
    exact_spacing_ = 0;
    is_to_make_ready_ = is_to_make_ready_ && is_there;
    return {};
  }
  exact_spacing_ = std::max(exact_spacing_, finest);
  const double start = host_.now();
  SPLATVOL_TRY(player_->draw_exact({}, exact_spacing_));
  took_seconds_ = host_.now() - start;
  return encode_aside();
}

// Goes on to finer samples. If the picture cannot be drawn, splats are. After an interruption all begins anew.
Status Session::finish_exact(const Status& drawn) {
  if (!drawn && drawn.error().code == ErrorCode::cancelled) {
    refinement_.reset();
    return {};
  }
  if (!drawn) {
    tell_of_splats(drawn.error().message);
    const bool shows_splats = !skips_splats_ && exact_spacing_ == first_exact_spacing() && frame();
    if (!shows_splats) begin_rest();
    exact_spacing_ = 0;
    is_to_make_ready_ = false;
    cells_fail_ = true;
  } else if (exact_spacing_ > 0) {
    note_drawn({.rung = {0, player_->sample_spacing()}});
    SPLATVOL_TRY(learn_time());
    begin_holding_cells();
    exact_spacing_ = finer_exact_spacing();
  }
  settle();
  return {};
}

// Begins what makes ready for what moves, and for probes.
Status Session::begin_making_ready() {
  SPLATVOL_TRY(encode_picture());
  return draw_aside(Work::making_ready, [this] { return make_ready(); });
}

// Reads all cells of a file that is far, if there is time to draw them while something moves. Probes need the splats of
// this view.
Status Session::make_ready() {
  SPLATVOL_TRY(learn_errors());
  if (!player_->exact()) return {};
  if (player_->streamer().volume().is_far()) {
    SPLATVOL_TRY_ASSIGN(choices, player_->choices(true, widest_spacing));
    const bool has_time =
        choices.cells && motion_.expected_seconds({0, widest_spacing}, choices) <= 2 * used_settings_.moving.seconds;
    if (has_time) SPLATVOL_TRY(player_->hold_cells());
  }
  const double expected_error = quality_of_splats().max_error.value_or(0);
  return player_->choose({.detail = {.goal = ErrorGoal{expected_error, player_->device_splats()}}});
}

Status Session::finish_making_ready(const Status& made) {
  if (!made && made.error().code == ErrorCode::cancelled) {
    refinement_.reset();
    return {};
  }
  if (!made) troubles_.push_back(made.error().message);
  is_to_make_ready_ = false;
  settle();
  return {};
}

// Says once why there is no exact picture.
void Session::tell_of_splats(const std::string& reason) { tell_once(reason + ": splats are shown, no exact picture"); }

// Whether the last picture is there.
void Session::settle() {
  settled_ = refinement_->is_done() && exact_spacing_ == 0 && !is_to_make_ready_;
  if (settled_) read_ahead(step() + 1);
}

// Goes on to a finer picture, unless this one is the last. `drawn`: this one, unless the player still has to copy it.
Status Session::finish_picture(std::optional<Image> drawn) {
  SPLATVOL_TRY(refinement_->add(*frame(), [&]() -> Result<Image> {
    if (drawn) return *std::move(drawn);
    return player_->image();
  }));
  settle();
  return {};
}

}  // namespace splatvol
