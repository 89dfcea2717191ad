#include "player/session_file.h"

#include <fmt/format.h>

#include <utility>

#include "format/mesh_box.h"
#include "player/session.h"
#include "streamer/splats/domain.h"

namespace splatvol {
namespace {

// Returns what `first` tells, and of the rest what `second` tells.
SceneUse joined(const SceneUse& first, const SceneUse& second) {
  SceneUse use = first;
  if (use.file.empty()) use.file = second.file, use.pieces = second.pieces;
  if (!use.step) use.step = second.step;
  use.quality = joined(first.quality, second.quality);
  use.drawing = joined(first.drawing, second.drawing);
  return use;
}

// Converts a mesh, or one that is in several pieces; none for another file.
Result<std::optional<ConvertedFile>> convert_mesh(const SceneUse& use, const Conversion& conversion) {
  ConversionRequest request{{use.file}, conversion.all_steps || use.step, conversion.preview};
  request.inputs.insert(request.inputs.end(), use.pieces.begin(), use.pieces.end());
  if (!needs_conversion(request.inputs)) return std::optional<ConvertedFile>();
  return convert(request, conversion.tell);
}

}  // namespace

PlayerOptions player_options(const ViewSettings& settings) {
  return {.memory = settings.memory,
          .gpu_memory = settings.gpu_memory,
          .device = settings.device,
          .in_current_context = settings.in_current_context,
          .drawing = settings.drawing,
          .first_picture = settings.first_picture,
          .takes_tubes = true,
          .read_surface = settings.read_surface};
}

ViewSettings with_use(ViewSettings settings, const SceneUse& use) {
  settings.quality = joined(use.quality, settings.quality);
  settings.drawing = joined(use.drawing, settings.drawing);
  return settings;
}

Status check_step(const format::Steps& steps, std::size_t step) {
  if (step <= steps.last()) return {};
  return fail(ErrorCode::invalid_argument, "{}: no step {}; {}", steps.name(), step,
              steps.times().empty() ? "the file is no time series" : fmt::format("the last one is {}", steps.last()));
}

Status read_histograms(const format::Volume& volume, const Scene& scene, SessionData& data) {
  SPLATVOL_TRY_ASSIGN(histograms, volume.read_histograms());
  const auto histogram_of = [&](const std::string& attribute) {
    const auto index = static_cast<std::size_t>(volume.info().find_attribute(attribute));
    return histograms.empty() ? std::array<std::uint64_t, 64>{} : histograms[index];
  };
  data.histogram = histogram_of(scene.attribute);
  if (scene.opacity) data.opacity_histogram = histogram_of(scene.opacity->attribute);
  return {};
}

Result<Box> mesh_box_of(const format::Volume& volume, const Box& bounds) {
  SPLATVOL_TRY_ASSIGN(of_cells, format::box_of_cells(volume));
  return of_cells.value_or(bounds);
}

Result<SessionFile> with_data(SessionFile read, bool must_fit, bool fits_opacity) {
  Streamer& streamer = *read.file.streamer;
  const Scene& scene = read.file.scene;
  SessionData& data = read.data;
  SPLATVOL_TRY(read_histograms(streamer.volume(), scene, data));
  if (fits_opacity)
    SPLATVOL_TRY_SET(read.fitting_opacity, splatvol::fitting_opacity(streamer.volume(), scene.opacity->attribute,
                                                                     {512, 512, scene.background}));
  SPLATVOL_TRY_SET(data.bounds, find_domain(streamer));
  SPLATVOL_TRY_SET(data.mesh_box, mesh_box_of(streamer.volume(), data.bounds));
  data.fitting = scene;
  if (read.fits) return read;
  auto fitting = default_scene(streamer.volume(), scene.attribute, {512, 512, scene.background});
  if (fitting)
    data.fitting = std::move(*fitting);
  else if (must_fit)
    return tl::unexpected(fitting.error());
  return read;
}

Result<SessionFile> Session::read(const SceneUse& asked, const std::string& scene_path, const ViewSettings& settings,
                                  const format::OpenFile& open_file, const Conversion& conversion) {
  std::optional<Scene> scene;
  SceneUse use = asked;
  if (!scene_path.empty()) {
    SPLATVOL_TRY_ASSIGN(loaded, load_used_scene(scene_path));
    scene = std::move(loaded.scene);
    use = joined(asked, loaded.use);
    if (use.file.empty())
      return fail(ErrorCode::invalid_argument, "{}: names no file: open a .svol file or a mesh, and then this scene",
                  scene_path.starts_with('{') ? "the scene" : scene_path);
  }
  SPLATVOL_TRY_ASSIGN(converted, convert_mesh(use, conversion));
  SPLATVOL_TRY_ASSIGN(steps, converted ? format::Steps::open(converted->path, open_as(use.file, *converted, open_file))
                                       : format::Steps::open(use.file, open_file));
  const std::size_t step = use.step.value_or(steps.last());
  SPLATVOL_TRY(check_step(steps, step));
  const ViewSettings used = with_use(settings, use);
  SPLATVOL_TRY_ASSIGN(file, Player::read(std::move(steps), step, scene, player_options(used), {}));
  return with_data({.source = {use.file, use.pieces, std::move(converted)},
                    .fits = !scene,
                    .settings = used,
                    .file = std::move(file)},
                   false);
}

}  // namespace splatvol
