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

// Pixels between samples of the first exact picture at rest, unless it follows one of cells or has many segments; and
// of one that may move.
constexpr int first_spacing = 4, widest_spacing = 8;

// No splats come before cells that are as quick as this, in seconds.
constexpr double quick_cells = 0.25;

}  // namespace

bool Session::can_draw_aside() const { return settings.hurries && draws_aside(); }

// Begins with a picture that is no coarser than the last one of the movement. Rounds its splats, which depend on the
// machine's load.
void Session::begin_rest(bool with_cells) {
  motion_.rest();
  keep_last_moving();
  cells_fail_ = !with_cells;
  ProgressiveRefinement::Start start{.splats = quality_of_splats()};
  if (settings.hurries && frame()) start.first_splats = std::bit_ceil(std::max(frame()->splats, least_first_splats));
  if (with_cells) start.first_spacing = first_exact_spacing();
  if (player_->shows_contours() && !player_->has_cells())
    tell_of_splats(path_ + ": it keeps no cells, and only these have contours");
  else if (settings.quality.exact && !player_->has_cells())
    tell_of_splats(path_ + ": it keeps no cells");
  is_to_make_ready_ = can_draw_aside() && (start.first_spacing > 0 || last_moving_);
  if (start.first_spacing > 0 && settings.hurries) follow_movement(start);
  refinement_.emplace(start);
}

// Leaves out splats where cells were in the last picture of the movement, or are soon drawn.
void Session::follow_movement(ProgressiveRefinement::Start& start) const {
  const bool follows_cells = moving_is_drawn_ && player_->exact();
  const int quick_spacing = this->quick_spacing();
  if (follows_cells || quick_spacing > 0) start.splats.reset();
  // With surfaces, the last picture may be a small one.
  if (follows_cells && !shows_surfaces()) {
    start.shown = Recipe::of_cells(player_->sample_spacing());
    start.first_spacing = ProgressiveRefinement::finer_spacing(player_->sample_spacing(), finest_spacing());
  } else if (quick_spacing > 0) {
    start.first_spacing = quick_spacing;
  }
}

// Returns the widest spacing of samples of cells that are held, soon drawn, and no worse than the last picture of the
// movement; 0: there is none.
int Session::quick_spacing() const {
  const Choices& choices = picture_.choices;
  if (!moving_is_drawn_ || !choices.cells || !player_->holds_cells()) return 0;
  for (int spacing = std::max(widest_moving_samples, finest_spacing()); spacing >= finest_spacing(); spacing /= 2)
    if (motion_.expected_seconds(Recipe::of_cells(spacing), choices) < quick_cells &&
        motion_.expected_error(Recipe::of_cells(spacing), choices).error <= shown_recipe_.error)
      return spacing;
  return 0;
}

// All points of a small file are soon there: nobody measures their error.
Quality Session::quality_of_splats() const {
  if (asks_for_splats(used_settings_.quality)) return used_settings_.quality;
  const Quality usual = default_splats(info().point_count());
  return usual.max_error && used_settings_.quality.max_error ? used_settings_.quality : usual;
}

// Returns how many segments an exact picture may have.
double Session::most_segments() const {
  return used_settings_.quality.exact ? std::numeric_limits<double>::infinity()
                                      : static_cast<double>(used_settings_.most_exact_segments);
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
    SPLATVOL_TRY_ASSIGN(choices, player_->choices({.cells = Chooser::Cells::all, .widest_spacing = widest_spacing}));
    const bool has_time = choices.cells && motion_.expected_seconds(Recipe::of_cells(widest_spacing), choices) <=
                                               2 * used_settings_.moving.seconds;
    if (has_time) SPLATVOL_TRY(player_->hold_cells());
  }
  const double expected_error = quality_of_splats().max_error.value_or(0);
  return player_->choose({.goal = ErrorGoal{expected_error, player_->device_splats()}});
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
  settled_ = refinement_->is_done() && !is_to_make_ready_;
  if (settled_) read_ahead(step() + 1);
}

}  // namespace splatvol
