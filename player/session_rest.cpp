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
  movement_.control.rest();
  keep_last_moving();
  cells_fail_ = !with_cells;
  ProgressiveRefinement::Start start{.splats = quality_of_splats()};
  if (settings.hurries && frame()) start.first_splats = std::bit_ceil(std::max(frame()->splats, least_first_splats));
  if (with_cells) start.first_spacing = first_exact_spacing();
  if (player_->shows_contours() && !player_->has_cells())
    troubles_.add_once(source_.path + ": it keeps no cells, and only these have contours: shells stand for them");
  else if (settings.quality.exact && !player_->has_cells())
    tell_of_splats(source_.path + ": it keeps no cells");
  rest_.is_to_make_ready = can_draw_aside() && (start.first_spacing > 0 || movement_.last);
  if (start.first_spacing > 0 && settings.hurries) follow_movement(start);
  rest_.refinement.emplace(start);
}

// Leaves out splats where cells were in the last picture of the movement, or are soon drawn.
void Session::follow_movement(ProgressiveRefinement::Start& start) const {
  const bool follows_cells = movement_.is_drawn && player_->exact();
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
  if (!movement_.is_drawn || !choices.cells || !player_->holds_cells()) return 0;
  for (int spacing = std::max(widest_moving_samples, finest_spacing()); spacing >= finest_spacing(); spacing /= 2)
    if (movement_.control.expected_seconds(Recipe::of_cells(spacing), choices) < quick_cells &&
        movement_.control.expected_error(Recipe::of_cells(spacing), choices).error <= shown_.recipe.error)
      return spacing;
  return 0;
}

// All points of a small file are soon there: nobody measures their error.
Quality Session::quality_of_splats() const {
  if (asks_for_splats(used_.settings.quality)) return used_.settings.quality;
  const Quality usual = default_splats(info().point_count());
  return usual.max_error && used_.settings.quality.max_error ? used_.settings.quality : usual;
}

// Returns how many segments an exact picture may have.
double Session::most_segments() const {
  return used_.settings.quality.exact ? std::numeric_limits<double>::infinity()
                                      : static_cast<double>(used_.settings.most_exact_segments);
}

// Returns the least spacing of samples in any picture.
int Session::finest_spacing() const { return used_.settings.drawing.sample_spacing.value_or(1); }

// Where nobody looks at coarser pictures, there are none. 0: splats are wanted, or there is nothing else. Splats have
// no contours.
int Session::first_exact_spacing() const {
  const ViewSettings& used = used_.settings;
  const bool wants_splats =
      asks_for_splats(used.quality) || kernel_of(used.drawing) == KernelKind::octant || most_segments() == 0;
  if ((wants_splats && !player_->shows_contours()) || !player_->has_cells()) return 0;
  return used.hurries ? std::max(first_spacing, finest_spacing()) : finest_spacing();
}

// Begins what makes ready for what moves, and for picks.
Status Session::begin_making_ready() {
  SPLATVOL_TRY(encode_picture());
  return draw_aside(Work::making_ready, [this] { return make_ready(); });
}

// Reads all cells of a file that is far, if there is time to draw them while something moves. Where cells do not answer
// picks, splats of this view do.
Status Session::make_ready() {
  SPLATVOL_TRY(learn_errors());
  if (!player_->exact()) return {};
  if (player_->streamer().volume().is_far()) {
    SPLATVOL_TRY_ASSIGN(choices, player_->choices({.cells = Chooser::Cells::all, .widest_spacing = widest_spacing}));
    const bool has_time =
        choices.cells && movement_.control.expected_seconds(Recipe::of_cells(widest_spacing), choices) <=
                             2 * used_.settings.moving.seconds;
    if (has_time) SPLATVOL_TRY(player_->hold_cells());
  }
  if (player_->cells_for_picks()) return {};
  const double expected_error = quality_of_splats().max_error.value_or(0);
  return player_->choose({.goal = ErrorGoal{expected_error, player_->device_splats()}});
}

Status Session::finish_making_ready(const Status& made) {
  if (!made && made.error().code == ErrorCode::cancelled) {
    rest_.refinement.reset();
    return {};
  }
  if (!made) troubles_.add(made.error().message);
  rest_.is_to_make_ready = false;
  settle();
  return {};
}

// Says once why there is no exact picture.
void Session::tell_of_splats(const std::string& reason) {
  troubles_.add_once(reason + ": splats are shown, no exact picture");
}

// Whether the last picture is there.
void Session::settle() {
  progress_.settled = rest_.refinement->is_done() && !rest_.is_to_make_ready;
  if (progress_.settled) read_ahead(step() + 1);
}

}  // namespace splatvol
