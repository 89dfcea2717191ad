#include "player/change_reader.h"

#include <utility>

#include "scene/scene_change.h"

namespace splatvol {
namespace {

// Whether two changes need the same parts of the file.
bool need_the_same(const Scene& a, const ViewSettings& a_settings, const Scene& b, const ViewSettings& b_settings) {
  const SceneChange change = change_between(a, b);
  return a_settings.memory == b_settings.memory && kernel_of(a_settings.drawing) == kernel_of(b_settings.drawing) &&
         !change.data && !change.surfaces && a.lighting.has_value() == b.lighting.has_value();
}

}  // namespace

bool ChangeReader::begin(SessionHost& host, const Player& player, const std::string& path, const Scene& scene,
                         const ViewSettings& settings) {
  if (is_begun() && (reads_step_ != step || !need_the_same(scene_, settings_, scene, settings))) end();
  if (is_begun()) return true;
  const Player::Reader reader = player.reader(scene, player_options(settings), step);
  if (!reader) {
    fits_function = fits_opacity = false;
    return false;
  }
  scene_ = scene, settings_ = settings, reads_step_ = step;
  file_ = {host, [reader, path, must_fit = fits_function, opacity_fits = fits_opacity]() -> Result<SessionFile> {
             SPLATVOL_TRY_ASSIGN(file, reader());
             SessionFile change{.source = {path}, .file = std::move(file)};
             if (change.file.streamer) return with_data(std::move(change), must_fit, opacity_fits);
             return change;
           }};
  return true;
}

}  // namespace splatvol
