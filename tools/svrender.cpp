// svrender: a picture of a .svol file.
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <optional>
#include <utility>
#include <vector>

#include "base/addresses.h"
#include "base/file.h"
#include "base/printable.h"
#include "player/conversion.h"
#include "streamer/first/default_scene.h"
#include "streamer/first/explain.h"
#include "tools/svrender_drawing.h"
#include "tools/svrender_options.h"
#include "tools/svrender_page.h"
#include "tools/svrender_statistics.h"
#include "tools/tool.h"

namespace splatvol {
namespace {

// Creates the statistics' file before the work begins: if it cannot be written, no picture is drawn either.
Result<std::optional<AtomicFile>> create_statistics(const std::string& path) {
  if (path.empty() || path == "-") return std::optional<AtomicFile>();
  SPLATVOL_TRY_ASSIGN(file, AtomicFile::create(path));
  return std::optional<AtomicFile>(std::move(file));
}

// The pictures are written; the exit code says that they lack parts of the file.
Status failure_of(const std::vector<Error>& unreadable) {
  if (unreadable.empty()) return {};
  return fail(unreadable.front().code, "parts of the file that could not be read: {}, the first: {}", unreadable.size(),
              unreadable.front().message);
}

Status write_statistics(std::optional<AtomicFile>& file, const std::string& text) {
  if (!file) {
    fmt::print("{}", text);
    return {};
  }
  SPLATVOL_TRY(file->append(std::as_bytes(std::span(text))));
  return file->commit();
}

// Names the values of contours that no point has; empty: there are none.
Result<std::string> contours_outside(const Player& player) {
  const format::Volume& volume = player.streamer().volume();
  std::vector<double> values;
  for (const Contour& contour : contours_of(player.scene()).surfaces) values.push_back(contour.value);
  if (values.empty()) return std::string();
  SPLATVOL_TRY_ASSIGN(index, format::find_attribute(volume.info(), player.scene().attribute, volume.name()));
  const format::Attribute& attribute = volume.info().attributes[static_cast<std::size_t>(index)];
  std::erase_if(values, [&](double value) { return !(value < attribute.min || value > attribute.max); });
  if (values.empty()) return std::string();
  return fmt::format("{} lies outside of the values of {}, which are {} to {}", fmt::join(values, ", "),
                     printable(player.scene().attribute), attribute.min, attribute.max);
}

// What stands for contours is no exact surface.
void tell_of_shells(const RenderOptions& options, const Player& player) {
  if (player.shows_shells())
    fmt::print(stderr, "svrender: {}: translucent shells stand for the contours, as {}\n", options.written(),
               player.has_cells() ? "splats have none"
                                  : "the file keeps no cells: build it from a mesh, or from points "
                                    "by --connectivity delaunay, without --drop-cells");
}

// An empty picture is a picture, but hardly the one that was meant. A contour that is nowhere may be missed, too.
Status warn_if_empty(const RenderOptions& options, const Player& player, const Image& image) {
  constexpr float least_alpha = 0.5f / 255;  // what 8 bits show
  SPLATVOL_TRY_ASSIGN(outside, contours_outside(player));
  if (std::ranges::any_of(image.pixels, [](const vec4& pixel) { return pixel.a >= least_alpha; })) {
    if (!outside.empty()) fmt::print(stderr, "svrender: {}\n", outside);
    return {};
  }
  SPLATVOL_TRY_ASSIGN(bounds, domain_of(player.streamer().volume()));
  EmptyReason why = why_empty(player.view(), transfer_of(player.scene()), player.streamer().shown_attributes(), bounds);
  if (player.shows_contours()) {
    why = {"no contour is in the picture", "take values that are in the data, or move the camera"};
  } else if (!why) {
    SPLATVOL_TRY_ASSIGN(without_material, why_without_material(player.streamer().volume()));
    const bool draws = player.exact() ? player.exact()->chunks > 0 : player.frame()->splats > 0;
    why = without_material ? without_material : why_empty_in_view(draws);
  }
  fmt::print(stderr, "svrender: {} shows nothing: {}{}{}; {}\n", options.written(), why.reason,
             outside.empty() ? "" : ": ", outside, why.remedy);
  return {};
}

// Takes over what the scene tells of its use, unless an option tells it.
Status use_scene(RenderOptions& options) {
  if (options.scene.empty()) return {};
  SPLATVOL_TRY_ASSIGN(used, load_used_scene(options.scene));
  const SceneUse& use = used.use;
  options.quality = joined(options.quality, use.quality);
  options.drawing = joined(options.drawing, use.drawing);
  if (!options.step.step && !options.step.time && options.steps.empty()) options.step.step = use.step;
  return {};
}

// An exact picture has no splats. So options that say how to draw splats would do nothing.
Status check_exact(const RenderOptions& options) {
  if (!options.quality.exact) return {};
  const auto refuse = [](std::string_view option, std::string_view reason) {
    return fail(ErrorCode::invalid_argument, "{}: an exact picture {}: leave it out, or draw splats without --exact",
                option, reason);
  };
  if (kernel_of(options.drawing) == KernelKind::octant) return refuse("--kernel octant", "has no splats");
  if (sort_of(options.drawing) != SortMode::exact) return refuse("--sort", "has no splats");
  if (options.device == "gl") return refuse("--device gl", "is drawn by the processor");
  if (options.progresses()) return refuse("--progress-frames", "has no frames on the way to it");
  return {};
}

// Converts a mesh by svbuild; none for another file.
Result<std::optional<ConvertedFile>> convert_mesh(const RenderOptions& options) {
  if (!needs_conversion(options.inputs)) return std::optional<ConvertedFile>();
  std::optional<ProgressBar> bar(std::in_place, "reading");
  const auto tell = [&](const ConversionProgress& progress) {
    bar->rename(progress.stage);
    bar->update(progress.share);
  };
  const bool all_steps = options.step.step || options.step.time || options.plays();
  auto converted = convert({options.inputs, all_steps}, tell);
  bar.reset();
  if (!converted) return tl::unexpected(converted.error());
  for (const std::string& note : converted->notes) fmt::print(stderr, "svrender: {}\n", one_line(note));
  if (converted->was_built && !converted->is_temporary)
    fmt::print(stderr, "svrender: {} is kept for the next picture, as {}; svbuild --forget removes it\n",
               one_line(options.inputs[0]), one_line(converted->path));
  return converted;
}

Status render(RenderOptions options) {
  const double start = seconds_now();
  SPLATVOL_TRY(use_scene(options));
  SPLATVOL_TRY(check_exact(options));
  std::vector<std::string> read = options.inputs;
  read.push_back(options.scene);
  SPLATVOL_TRY(check_outputs({options.output, options.stats, options.movie}, read));
  SPLATVOL_TRY_ASSIGN(converted, convert_mesh(options));
  options.volume = converted ? converted->path : options.inputs[0];
  SPLATVOL_TRY_ASSIGN(
      steps, converted ? format::Steps::open(options.volume, open_as(options.inputs[0], *converted, open_file_or_url))
                       : open_steps(options.volume));
  SPLATVOL_TRY_ASSIGN(composition, compose(options, steps));
  const Scene& scene = composition.scene;
  if (!options.progress_frames.empty()) SPLATVOL_TRY(make_folder(options.progress_frames));
  SPLATVOL_TRY_ASSIGN(statistics_file, create_statistics(options.stats));
  if (const auto view = make_view(scene); !view)
    return fail_in(options.scene.empty() ? options.inputs[0] : options.scene, view.error());
  SPLATVOL_TRY_ASSIGN(drawn, prepare(options, std::move(steps), scene));

  Timings timings;
  SPLATVOL_TRY_ASSIGN(unreadable, draw_pictures(options, composition, drawn, timings, start));
  const Player& player = *drawn.player;
  SPLATVOL_TRY_ASSIGN(image, player.image());
  timings.first_image = seconds_now() - start;
  tell_of_shells(options, player);
  SPLATVOL_TRY(warn_if_empty(options, player, image));
  if (const auto left_out = player.left_out())
    fmt::print(stderr, "svrender: {}: --memory grants more\n", left_out->message);
  if (player.exact() && player.exact()->unknown_cells > 0)
    fmt::print(stderr, "svrender: {}: {} cells of shapes that this version does not know are left out\n",
               options.inputs[0], player.exact()->unknown_cells);
  if (player.has_joined_surfaces())
    fmt::print(stderr,
               "svrender: more than {} translucent surfaces lie one behind the other; the volume between those behind "
               "is drawn behind all of them\n",
               most_surface_layers);
  if (!options.output.empty())
    SPLATVOL_TRY(write_page(composition, player.view(), time_of(player), std::move(image), options.output,
                            provenance_of(options, drawn)));

  if (!options.stats.empty()) {
    if (!options.moves()) SPLATVOL_TRY(draw_steady_frames(options, drawn, timings));
    SPLATVOL_TRY(write_statistics(statistics_file, statistics_text(options, drawn, timings)));
  }
  const bool terminal_holds_statistics = !options.stats.empty() && !statistics_file;
  if (!terminal_holds_statistics) print_summary(options, composition.written_size(), drawn, timings);
  return failure_of(unreadable);
}

}  // namespace
}  // namespace splatvol

int main(int argc, char** argv) {
  splatvol::RenderOptions options;
  splatvol::CommandLine app("Draws a .svol file as splats, as fine as the view needs.", "svrender");
  splatvol::add_options(app, options);
  return splatvol::run_tool(app, argc, argv, [&] { return splatvol::render(options); });
}
