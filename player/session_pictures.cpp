// The pictures of a session: each is begun, drawn, perhaps by a job, and taken over.
#include <algorithm>
#include <utility>

#include "player/choice.h"
#include "player/session.h"

namespace splatvol {
namespace {

// Longest time that the picture of the step before stays. Then the new one is drawn as coarse as it is.
constexpr double longest_wait_seconds = 2;

// Longest wait of one frame for the first picture of a step.
constexpr double step_wait_seconds = 0.02;

// Pixels between samples of cells, at most, in a picture at rest.
constexpr int widest_at_rest = 8;

// What a picture is made of, with the splats that are in it.
Recipe shown_recipe_of(const Outcome& outcome) {
  if (outcome.recipe.is_exact()) return outcome.recipe;
  return Recipe::of_splats(std::max<std::uint64_t>(outcome.splats, 1), outcome.recipe.sample_spacing);
}

// Surfaces need a sample for each pixel, and so do slices among splats: there, wide samples are pixels of a smaller
// picture.
Scene scaled(Scene scene, int sample_spacing) {
  scene.width = (scene.width + sample_spacing - 1) / sample_spacing;
  scene.height = (scene.height + sample_spacing - 1) / sample_spacing;
  return scene;
}

}  // namespace

// By a job where one may draw it: so the window goes on. A graphics card draws splats at once. Until the picture is
// there, the window shows a copy of the one before.
Status Session::begin_picture(bool moves, double seconds) {
  if (moves) begin_holding_cells();
  picture_ = {.moves = moves};
  const Work work = moves ? Work::moving : Work::refining;
  const bool may_be_aside = moves ? settings.works_aside : settings.hurries;
  if (may_be_aside && (draws_aside() || (!moves && rest_.refinement->has_all_splats()))) {
    SPLATVOL_TRY(encode_picture());
    return draw_aside(work, [this, seconds]() -> Status {
      SPLATVOL_TRY(choose_picture());
      return draw_picture(seconds);
    });
  }
  SPLATVOL_TRY(choose_picture());
  if (may_be_aside && picture_.recipe && picture_.recipe->is_exact()) {
    SPLATVOL_TRY(encode_picture());
    return draw_aside(work, [this, seconds] { return draw_picture(seconds); });
  }
  return finish_picture(draw_picture(seconds));
}

Status Session::choose_picture() {
  awaited_.is_awaited_after = awaited_.is_awaited;
  Result<Choices> choices = choices_for(picture_.moves);
  if (!choices && is_unfinished(choices.error())) return tl::unexpected(choices.error());
  if (!choices) {
    picture_.cells = tl::unexpected(choices.error());
    return {};
  }
  picture_.choices = *std::move(choices);
  if (picture_.moves)
    picture_.recipe = movement_.control.next(picture_.choices);
  else if (rest_.refinement->has_all_splats() && !picture_.choices.cells)
    picture_.cells =
        fail(ErrorCode::unsupported, "{}: some of its cells have shapes that only a newer svview knows", source_.path);
  else
    picture_.recipe = rest_.refinement->next(picture_.choices);
  return {};
}

// Returns what the view has. What rests as splats moves as splats. With surfaces, wide samples are allowed, too: what
// moves becomes a small picture (draw_picture), and the player draws each sample at rest.
Result<Choices> Session::choices_for(bool moves) const {
  Chooser::Needs needs = moves ? movement_.control.needs() : rest_.refinement->needs();
  const bool has_contours = player_->shows_contours();
  const bool must_read = player_->streamer().volume().is_far() && !player_->holds_cells();  // most of the work
  if (moves && (first_exact_spacing() == 0 || cells_fail_ || !player_->holds_cells()))
    needs.cells = Chooser::Cells::none;
  SPLATVOL_TRY_ASSIGN(choices, player_->choices(needs));
  if (!has_contours) choices.most_segments = most_segments();
  choices.finest_spacing = finest_spacing();
  choices.widest_spacing = must_read ? finest_spacing() : std::max(finest_spacing(), widest_at_rest);
  if (!moves) return choices;
  if (spacing_of_cells(choices) == 0) choices.cells.reset();
  choices.has_splats = true;
  choices.widest_spacing = std::max(finest_spacing(), widest_moving_samples);
  if (!draws_aside()) choices.first_cells_seconds = 1.0 / 60;  // a graphics card draws as many pictures of splats
  return choices;
}

Status Session::draw_picture(double seconds) {
  if (!picture_.recipe) return {};
  Recipe drawn = *picture_.recipe;
  const bool needs_all_samples = drawn.is_exact() ? shows_surfaces() : has_layers();
  if (picture_.moves && drawn.sample_spacing > 1 && needs_all_samples) {
    SPLATVOL_TRY(player_->set_scene(scaled(used_.scene, drawn.sample_spacing)));
    drawn.sample_spacing = 1;
  }
  const double start = host_.now();
  if (!drawn.is_exact()) {
    SPLATVOL_TRY(draw_splats(drawn, seconds));
  } else if (const Result<Outcome> exact = player_->draw(drawn); exact) {
    picture_.outcome = *exact;
    awaited_.is_awaited_after = false;
  } else if (is_unfinished(exact.error())) {
    return tl::unexpected(exact.error());
  } else {
    picture_.cells = tl::unexpected(exact.error());
  }
  picture_.seconds = host_.now() - start;
  if (picture_.outcome) encode_aside();
  return {};
}

// The picture of the step before stays until there is one that is as fine.
Status Session::draw_splats(const Recipe& recipe, double seconds) {
  SPLATVOL_TRY(player_->choose(*recipe.splats, awaited_.is_awaited ? step_wait_seconds : 0));
  awaited_.seconds += seconds;
  awaited_.is_awaited_after =
      awaited_.is_awaited && !player_->frame()->progress.settled && awaited_.seconds < longest_wait_seconds;
  if (awaited_.is_awaited_after) return {};
  SPLATVOL_TRY(player_->draw_chosen(recipe.sample_spacing));
  picture_.outcome = player_->outcome();
  return {};
}

// After an interruption, a view at rest begins anew.
Status Session::finish_picture(const Status& drawn) {
  if (!drawn && drawn.error().code == ErrorCode::cancelled) {
    if (!picture_.moves) rest_.refinement.reset();
    return {};
  }
  SPLATVOL_TRY(drawn);
  if (!picture_.cells) {
    go_on_without_cells();
    return {};
  }
  if (!picture_.recipe) {
    rest_.is_to_make_ready = rest_.is_to_make_ready && rest_.refinement->shows_cells();
    rest_.refinement->skip_cells();
    settle();
    return {};
  }
  if (!picture_.recipe->is_exact()) note_frame();
  awaited_.is_awaited = awaited_.is_awaited_after;
  if (!picture_.outcome) return {};
  return picture_.moves ? finish_moving() : finish_refining();
}

// What moves is drawn of splats by the next call, and the reason is told at rest.
void Session::go_on_without_cells() {
  cells_fail_ = true;
  if (picture_.moves) return;
  tell_of_splats(picture_.cells.error().message);
  if (rest_.refinement->shows_splats() && frame())
    rest_.refinement->skip_cells();
  else
    begin_rest(false);
  rest_.is_to_make_ready = false;
  settle();
}

Status Session::finish_moving() {
  Outcome& outcome = *picture_.outcome;
  const bool is_exact = outcome.recipe.is_exact();
  outcome.recipe.sample_spacing = picture_.recipe->sample_spacing;
  // Fewer splats would hardly change the time of surfaces.
  outcome.seconds = std::max(picture_.seconds - (is_exact ? 0 : player_->times().surfaces), 0.0);
  movement_.control.add(outcome, picture_.choices);
  const MotionControl::Expected expected = movement_.control.expected_error(outcome.recipe, picture_.choices);
  note_drawn({shown_recipe_of(outcome), true, expected.error, expected.is_measured});
  movement_.is_drawn = is_exact || frame()->progress.settled;
  return {};
}

// Goes on to a finer picture, unless this one is the last.
Status Session::finish_refining() {
  Outcome& outcome = *picture_.outcome;
  note_drawn({shown_recipe_of(outcome)});
  if (outcome.recipe.is_exact()) {
    // While cells are not held, the time is that of reading.
    outcome.seconds = player_->holds_cells() ? shown_.seconds : 0;
    movement_.control.add(outcome, picture_.choices);
    begin_holding_cells();
  } else if (!frame()->progress.settled) {
    return {};
  }
  Image copy;
  if (rest_.refinement->needs().picture) SPLATVOL_TRY_SET(outcome.picture, player_->image_or_copy(copy));
  rest_.refinement->add(outcome, picture_.choices);
  outcome.picture = nullptr;
  settle();
  return {};
}

}  // namespace splatvol
