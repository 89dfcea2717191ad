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
  if (const auto* image = std::get_if<const Image*>(&picture)) last_moving_ = {**image, *picture_.recipe};
}

// The picture at rest tells the errors of other ways to draw its view.
Status Session::learn_errors() {
  if (shows_surfaces() || !draws_aside()) return {};
  SPLATVOL_TRY_ASSIGN(choices, choices_for(true));
  Image copy;
  SPLATVOL_TRY_ASSIGN(rest, player_->image_or_copy(copy));
  const auto learn = [&](const Recipe& recipe, const Image& picture) -> Status {
    SPLATVOL_TRY_ASSIGN(difference, compare_images(picture, *rest));
    motion_.add({.recipe = recipe, .error = difference.rmse}, choices);
    return check_interruption();
  };
  motion_.forget_view();
  if (last_moving_ && last_moving_->picture.width == rest->width && last_moving_->picture.height == rest->height)
    SPLATVOL_TRY(learn(last_moving_->recipe, last_moving_->picture));
  last_moving_.reset();
  if (!player_->exact()) return {};
  for (int spacing = choices.widest_spacing; spacing > player_->sample_spacing(); spacing /= 2)
    SPLATVOL_TRY(learn(Recipe::of_cells(spacing), with_wide_samples(*rest, spacing, player_->refined_difference())));
  if (player_->shows_contours() || has_layers()) return {};
  for (const Recipe& recipe : motion_.unmeasured(choices)) {
    SPLATVOL_TRY(check_interruption());
    SPLATVOL_TRY_ASSIGN(outcome, player_->try_splats(recipe));
    if (outcome) motion_.add(*outcome, choices);
  }
  return {};
}

}  // namespace splatvol
