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

namespace splatvol {

bool Session::shows_surfaces() const {
  return std::ranges::any_of(used_.scene.surfaces, &SceneSurface::shown) ||
         std::ranges::any_of(used_.scene.streamlines, &SceneStreamlines::shown);
}

// While steps play and the view stays, a picture may take most of the step's time, and as much to be finer.
MotionLimits Session::moving_limits(bool is_busy) const {
  MotionLimits limits = settings.moving;
  if (is_playing() && !is_busy) limits.seconds = limits.smooth_seconds = playback.picture_seconds();
  return limits;
}

// Cells can only move once they are in memory. They are read beside the pictures.
void Session::begin_holding_cells() {
  if (movement_.holding_cells.is_begun() || !settings.hurries || cells_fail_ || first_exact_spacing() == 0) return;
  if (std::function<Status()> read = player_->cells_reader())
    movement_.holding_cells = {host_, std::move(read), SessionHost::Priority::low};
}

// The last picture of a movement has the view of the picture at rest, which tells its error.
void Session::keep_last_moving() {
  movement_.last.reset();
  if (!movement_.is_drawn || player_->exact() || has_layers()) return;
  const DevicePicture picture = player_->picture();
  if (const auto* image = std::get_if<const Image*>(&picture)) movement_.last = {**image, *picture_.recipe};
}

// The picture at rest tells the errors of other ways to draw its view.
Status Session::learn_errors() {
  if (shows_surfaces() || !draws_aside()) return {};
  SPLATVOL_TRY_ASSIGN(choices, choices_for(true));
  Image copy;
  SPLATVOL_TRY_ASSIGN(rest, player_->image_or_copy(copy));
  const auto learn = [&](const Recipe& recipe, const Image& picture) -> Status {
    SPLATVOL_TRY_ASSIGN(difference, compare_images(picture, *rest));
    movement_.control.add({.recipe = recipe, .error = difference.rmse}, choices);
    return check_interruption();
  };
  movement_.control.forget_view();
  if (movement_.last && movement_.last->picture.width == rest->width && movement_.last->picture.height == rest->height)
    SPLATVOL_TRY(learn(movement_.last->recipe, movement_.last->picture));
  movement_.last.reset();
  if (!player_->exact()) return {};
  for (int spacing = choices.widest_spacing; spacing > player_->sample_spacing(); spacing /= 2)
    SPLATVOL_TRY(learn(Recipe::of_cells(spacing), with_wide_samples(*rest, spacing, player_->refined_difference())));
  if (player_->shows_contours() || has_layers()) return {};
  for (const Recipe& recipe : movement_.control.unmeasured(choices)) {
    SPLATVOL_TRY(check_interruption());
    SPLATVOL_TRY_ASSIGN(outcome, player_->try_splats(recipe));
    if (outcome) movement_.control.add(*outcome, choices);
  }
  return {};
}

}  // namespace splatvol
