#include "tools/svrender_options.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdlib>
#include <utility>

#include "player/movie.h"
#include "tools/scene_options.h"
#include "tools/svrender_page.h"
#include "tools/tool.h"

namespace splatvol {
namespace {

// The heading in --help of options that compare ways to draw, and measure them. The defaults are the best.
constexpr const char* for_measurements = "For measurements";

std::string check_not_negative(const std::string& text) {
  const double number = std::strtod(text.c_str(), nullptr);
  return number >= 0 && std::isfinite(number) ? "" : "'" + text + "' is not a number from 0 up";
}

std::string check_sampling(const std::string& text) {
  return text == "auto" ? "" : check_range(text, 1, max_sample_spacing);
}

void add_file_options(CommandLine& app, RenderOptions& options) {
  app.add_option(
         "FILE", options.inputs,
         "The .svol file, the index of a series of files (.svols), or its address (http://, https:// or ssh://); or a "
         "mesh or points, in one file, several files or a folder, which svbuild converts and keeps in its cache")
      ->required()
      ->type_name("FILE.svol|URL|MESH...");
  auto* scene = app.add_option("--scene", options.scene, "Scene file (JSON); default: a scene that fits the data")
                    ->type_name("S.json");
  app.add_option("--attribute", options.attribute, "Without a scene: the attribute to show")
      ->type_name("NAME")
      ->excludes(scene);
  app.add_option("--opacity-attribute", options.opacity_attribute,
                 "Without a scene: the attribute whose values give the opacity, instead of the one that is shown")
      ->type_name("NAME")
      ->excludes(scene);
  app.add_option("-o,--output", options.output, "Picture to write: .exr or .png; with --movie it may be left out")
      ->type_name("OUT")
      ->check(check_image_path);
}

void add_page_options(CommandLine& app, RenderOptions& options) {
  app.add_option("--background", options.background,
                 "white, black or #RRGGBB (sRGB), instead of the scene's; from dark to light, densities double and "
                 "bright colours get darker, so that the contrast stays")
      ->type_name("COLOUR")
      ->check(check_of(parse_color));
  app.add_flag("--scalar-bar", options.scalar_bar,
               "Show the attribute's name, unit, colours and values right of the picture (.png)");
  app.add_flag("--colour-bar,--color-bar", options.scalar_bar, "As --scalar-bar, in older scripts")->group("");
  app.add_option("--ticks", options.ticks,
                 "At most about so many ticks beside the scalar bar; default: the scene's, or 5")
      ->range(2, 20);
  app.add_option("--unit", options.unit, "Unit over the scalar bar, in place of the attribute's")->type_name("WORDS");
  app.add_option("--title", options.title, "Words over the picture (.png)")->type_name("WORDS");
  app.add_flag("--time-label", options.has_time, "Show the time of the step over the picture, behind the title (.png)");
  app.add_flag(
      "--transparent", options.transparent,
      "Keep the alpha of a .png, so that what lies behind shows through; words have a halo, to be read on anything");
}

// How fine the picture is: by one of these options only.
void add_detail_options(CommandLine& app, RenderOptions& options) {
  auto* tolerance = app.add_option("--tolerance", options.quality.tolerance_percent,
                                   "Largest share of the image's shorter side that one splat may cover, instead of an "
                                   "error; 0: all points; 1 with --progress-frames and no other of these options")
                        ->type_name("PERCENT")
                        ->check(check_not_negative);
  auto* resolution = app.add_option("--resolution", options.quality.resolution,
                                    "One resolution for everything, 0 the coarsest, instead of an error")
                         ->range(0, 1000);
  auto* max_error =
      app.add_option(
             "--max-error", options.quality.max_error,
             fmt::format("Error of the picture (root mean square of linear RGB): draws splats or the file's cells, "
                         "with the least work that reaches it. It tries a few pictures, and measures their errors. "
                         "Without any of these options: an exact picture, or finer and finer ones up to an error of {}",
                         default_max_error))
          ->type_name("RMSE")
          ->check(check_positive)
          ->excludes(tolerance)
          ->excludes(resolution);
  auto* splats = app.add_option("--splats", options.quality.max_splats,
                                "Most splats to draw, chosen for the smallest expected error")
                     ->check(check_positive)
                     ->excludes(tolerance)
                     ->excludes(resolution)
                     ->excludes(max_error);
  auto* milliseconds =
      app.add_option("--milliseconds", options.quality.milliseconds,
                     "Time to draw a frame: the best of splats and cells, with samples up to 4 pixels apart, that can "
                     "be drawn in this time; the program draws a few pictures to find it, and tells the options that "
                     "draw it again")
          ->check(check_positive)
          ->excludes(tolerance)
          ->excludes(resolution)
          ->excludes(max_error)
          ->excludes(splats);
  app.add_flag("--exact", options.quality.exact, "Draw the cells of the mesh exactly, by the processor, and no splats")
      ->excludes(tolerance)
      ->excludes(resolution)
      ->excludes(max_error)
      ->excludes(splats)
      ->excludes(milliseconds);
}

void add_drawing_options(CommandLine& app, RenderOptions& options) {
  app.add_option("--kernel", options.kernel,
                 "Shape of a splat: moments: an ellipsoid that matches the material; octant: round, as in the paper of "
                 "2001")
      ->one_of({"moments", "octant"})
      ->default_str("moments")
      ->group(for_measurements);
  app.add_option("--sort", options.sort,
                 "Order of drawing, back to front: none: by node; axis: along the axis nearest to the line of sight, "
                 "sorted once for all views; exact: for each view")
      ->one_of({"none", "axis", "exact"})
      ->default_str("exact")
      ->group(for_measurements);
  app.add_option("--sampling", options.sampling,
                 "Pixels from one sample of the picture to the next, 1 to 64; the rest is interpolated. auto: a "
                 "twelfth of what the tolerance lets a splat cover, at most 6; with --max-error up to 4, as far as the "
                 "error holds; with --milliseconds up to 4; else 1")
      ->type_name("PIXELS")
      ->check(check_sampling)
      ->default_str("auto")
      ->group(for_measurements);
}

void add_budget_options(CommandLine& app, RenderOptions& options) {
  add_device_option(app, options.device, "the processor, so that all machines draw the same picture");
  app.add_option("--memory", options.memory,
                 "Bytes to hold of what is read, and while it is drawn, such as 512M; splats that would need more are "
                 "coarser. Patches of the boundary may take a quarter of it: the largest are left out, and named")
      ->type_name("SIZE")
      ->check(check_of(parse_bytes))
      ->capture_default_str();
  app.add_option("--gpu-memory", options.gpu_memory,
                 "Bytes that OpenGL may hold on the graphics card, with the same effect")
      ->type_name("SIZE")
      ->check(check_of(parse_bytes))
      ->capture_default_str();
  add_reading_options(app, options.reading);
}

// Refuses frames that nobody gets, and a movie without frames.
void check_frames(const RenderOptions& options) {
  const bool kept = !options.progress_frames.empty() || !options.movie.empty();
  for (const auto& [option, is_given] : {std::pair("--path", !options.path.empty() && options.stats.empty()),
                                         {"--turntable", options.turntable > 0},
                                         {"--steps", options.plays()}})
    if (is_given && !kept) wrong_option(option, "its frames go nowhere: give --progress-frames DIR or --movie OUT.mp4");
  if (!options.movie.empty() && !options.moves() && !options.plays())
    wrong_option("--movie", "needs frames: give --turntable N, --path FRAMES,DEGREES,FACTOR or --steps A:B");
  if (options.output.empty() && options.movie.empty()) missing_option("--output");
}

void add_frame_options(CommandLine& app, RenderOptions& options) {
  auto* milliseconds = app.get_option("--milliseconds");
  app.add_option("--size", options.size, "Size of the picture in pixels, instead of the scene's")
      ->type_name("WxH")
      ->check(check_of(parse_image_size));
  app.add_option("--repeat", options.repeat, "Frames to draw for the times in the statistics")
      ->range(1, 1000000)
      ->capture_default_str()
      ->group(for_measurements);
  app.add_option("--progress-frames", options.progress_frames,
                 "Draw frames while the file is read, from the parts that are there, and write them into this folder")
      ->type_name("DIR")
      ->excludes(milliseconds);
  app.add_option(
         "--path", options.path,
         "Draw FRAMES frames of a camera that turns round its focal point by DEGREES in all, while its distance "
         "is multiplied by FACTOR; --progress-frames or --movie takes the frames, --stats their times")
      ->type_name("FRAMES,DEGREES,FACTOR")
      ->excludes(milliseconds)
      ->delimiter(',')
      ->expected(3)
      ->check(check_finite)
      ->group(for_measurements);
  app.add_option("--turntable", options.turntable,
                 "Draw N frames of a full turn round the camera's up axis, through the middle of what is visible; "
                 "--progress-frames or --movie takes them")
      ->type_name("N")
      ->range(1, 100000)
      ->excludes(milliseconds)
      ->excludes(app.get_option("--path"));
  auto* movie = app.add_option("--movie", options.movie, "Join the frames to a movie, with ffmpeg if it is installed")
                    ->type_name("OUT.mp4")
                    ->check(check_movie_path);
  app.add_option("--fps", options.frames_per_second, "Frames for each second of the movie")
      ->range(0.1, 1000.0)
      ->check(check_finite)
      ->needs(movie)
      ->capture_default_str();
  app.callback([&options] {
    check_frames(options);
    options.drawing = {.kernel = kernel_named(options.kernel), .sort = sort_named(options.sort)};
    if (!options.sampling.empty() && options.sampling != "auto")
      options.drawing.sample_spacing = std::atoi(options.sampling.c_str());
  });
  app.add_option("--stats", options.stats, "Write statistics as JSON to this file, - for the terminal")
      ->type_name("OUT.json|-")
      ->check(check_json_path);
}

void add_series_options(CommandLine& app, RenderOptions& options) {
  add_step_options(app, options.step);
  app.add_option("--steps", options.steps,
                 "Of a time series: draw the steps A to B, or all of them; --progress-frames or --movie takes a frame "
                 "for each, with the number of its step")
      ->type_name("all|A:B")
      ->check(check_step_range)
      ->excludes(app.get_option("--milliseconds"))
      ->excludes(app.get_option("--path"))
      ->excludes(app.get_option("--turntable"))
      ->excludes(app.get_option("--time"))
      ->excludes(app.get_option("--step"));
}

}  // namespace

void add_options(CommandLine& app, RenderOptions& options) {
  add_file_options(app, options);
  add_plane_options(app, options.planes);
  add_page_options(app, options);
  add_detail_options(app, options);
  add_drawing_options(app, options);
  add_budget_options(app, options);
  add_frame_options(app, options);
  add_series_options(app, options);
}

}  // namespace splatvol
