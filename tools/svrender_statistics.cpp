#include "tools/svrender_statistics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <vector>

#include "base/json.h"
#include "player/statistics.h"
#include "tools/steps.h"

namespace splatvol {
namespace {

using json = nlohmann::ordered_json;

double median(std::vector<double> numbers) {
  if (numbers.empty()) return 0;
  std::ranges::sort(numbers);
  const std::size_t middle = numbers.size() / 2;
  return numbers.size() % 2 == 1 ? numbers[middle] : 0.5 * (numbers[middle - 1] + numbers[middle]);
}

json seconds_of(const Timings& timings) {
  return {{"cut", median(timings.cut)},
          {"fetch", timings.fetch},
          {"upload", timings.upload},
          {"sort", median(timings.sort)},
          {"draw", median(timings.draw)},
          {"frame", median(timings.frame)},
          {"frame_min", std::ranges::min(timings.frame)},
          {"frame_max", std::ranges::max(timings.frame)}};
}

void add_frames(const Timings& timings, json& document) {
  for (const ProgressFrame& shown : timings.progress)
    document["progress_frames"].push_back({{"seconds", shown.seconds},
                                           {"advance_seconds", shown.advance},
                                           {"splats", shown.splats},
                                           {"bytes_read", shown.bytes_read},
                                           {"missing_bytes", shown.missing_bytes}});
  for (const StepFrame& drawn : timings.steps)
    document["step_frames"].push_back({{"step", drawn.step},
                                       {"time", drawn.time},
                                       {"seconds", drawn.seconds},
                                       {"splats", drawn.splats},
                                       {"bytes_read", drawn.bytes_read}});
}

// The options that draw the picture of a rung again.
std::string options_of(const Recipe& rung) {
  const std::string what = rung.is_exact() ? "--exact" : fmt::format("--splats {}", rung.most_splats());
  return fmt::format("{} --sampling {}", what, rung.sample_spacing);
}

void add_rungs(const Drawn& drawn, const Timings& timings, json& document) {
  if (timings.rungs.empty()) return;
  document["milliseconds"] = *drawn.chosen.quality.milliseconds;
  document["rung"] = options_of(timings.rungs.back());
  for (const Recipe& rung : timings.rungs) document["rungs_tried"].push_back(options_of(rung));
}

// The detail that was asked for and the detail that the budgets allowed.
void add_detail(const Drawn& drawn, json& document) {
  const Detail& asked = drawn.player->asked_detail();
  const Detail& detail = drawn.player->frame()->detail;
  if (detail.goal) {
    const Quality& quality = drawn.chosen.quality;
    if (quality.max_error) document["max_error"] = *quality.max_error;
    if (quality.max_splats) document["max_splats"] = *quality.max_splats;
    document["effective_max_splats"] = detail.goal->max_splats;
  } else {
    document["tolerance"] = asked.tolerance_percent;
    document["effective_tolerance"] = detail.tolerance_percent;
  }
  if (detail.resolution) {
    document["resolution"] = *asked.resolution;
    document["effective_resolution"] = *detail.resolution;
  }
}

// The limits of a picture's splats.
std::string limits_of(const RenderOptions& options, const Drawn& drawn) {
  const std::uint64_t splats = drawn.player->device_splats();
  const bool is_limit =
      splats < std::numeric_limits<std::uint32_t>::max();  // what a device without memory of its own has
  if (!is_limit) return fmt::format("--memory {}", options.memory);
  return fmt::format("--memory {} and the {} splats that --gpu-memory {} holds", options.memory, splats,
                     options.gpu_memory);
}

// Says what error was measured, and why it is more than the wanted one.
void print_estimate(const RenderOptions& options, const Drawn& drawn) {
  const ErrorControl::Estimate& estimate = drawn.search->estimate;
  const double max_error = *drawn.chosen.quality.max_error;
  const int spacing = drawn.player->sample_spacing();
  const std::string drawn_as =
      drawn.player->exact() ? "cells" : fmt::format("{} splats", drawn.player->frame()->splats);
  const std::string samples = spacing > 1 ? fmt::format(" by samples {} pixels apart", spacing) : "";
  print_out("{}: {}{}, an error of {}{:.2g} by comparing {} pictures{}\n", options.written(), drawn_as, samples,
            estimate.measured ? "" : "about ", estimate.error, drawn.search->pictures,
            estimate.measured ? " with exact rays" : "");
  if (estimate.error > max_error && estimate.file_error > max_error)
    print_out("{}: more than {:.2g}: even all points of the file have about {:.2g}\n", options.written(), max_error,
              estimate.file_error);
  else if (!estimate.reached)
    print_out("{}: more than {:.2g}, to stay within {}\n", options.written(), max_error, limits_of(options, drawn));
}

// Says what error all points have, and what would help.
void print_estimate_of_all(const RenderOptions& options, const Drawn& drawn) {
  constexpr double much = 0.005;
  const double error = drawn.search->estimate.error;
  print_out("{}: all points, an error of {}{:.2g}\n", options.written(),
            drawn.search->estimate.measured ? "" : "about ", error);
  if (error > much && !drawn.player->has_cells())
    fmt::print(
        stderr,
        "svrender: {}: all points have an error of about {:.2g}, and the file keeps no cells: a file that is "
        "built from a mesh, or from points by --connectivity delaunay, without --drop-cells, has exact pictures\n",
        options.written(), error);
}

// "5 of 9 bytes read", and how many were read more than once.
std::string bytes_read_text(const format::Volume& volume) {
  const std::uint64_t again = volume.bytes_read_again();
  return fmt::format("{} of {} bytes read{}", volume.bytes_read() - again, volume.file_bytes(),
                     again > 0 ? fmt::format(" ({} more again)", again) : "");
}

// Says how near the picture comes to the goal.
void print_goal(const RenderOptions& options, const Drawn& drawn) {
  const FrameSplats& frame = *drawn.player->frame();
  if (drawn.search) return print_estimate(options, drawn);
  print_out("{}: {} splats, an error of {:.2g} expected\n", options.written(), frame.splats, frame.expected_error);
  if (frame.splats > drawn.player->asked_detail().goal->max_splats)
    print_out("{}: more than {} splats: the coarsest that the view has\n", options.written(),
              drawn.player->asked_detail().goal->max_splats);
}

}  // namespace

std::string statistics_text(const RenderOptions& options, const Drawn& drawn, const Timings& timings) {
  json document = statistics_of(*drawn.player);
  document["scene"] = options.scene.empty() ? json(nullptr) : json(options.scene);
  document["repeat"] = options.repeat;
  document["seconds"] = seconds_of(timings);
  document["first_image_seconds"] = timings.first_image;
  add_frames(timings, document);
  add_rungs(drawn, timings, document);
  if (!drawn.player->exact())
    add_detail(drawn, document);
  else if (drawn.search)
    document["max_error"] = *drawn.chosen.quality.max_error;
  if (drawn.search) document.update(statistics_of(*drawn.search));
  return json_text(document, 1) + "\n";
}

void print_summary(const RenderOptions& options, std::array<int, 2> size, const Drawn& drawn, const Timings& timings) {
  tell_nearest(options.written(), drawn.player->steps(), options.step, drawn.player->step());
  if (!timings.rungs.empty()) print_out("{}: the picture of {}\n", options.written(), options_of(timings.rungs.back()));
  const Streamer& streamer = drawn.player->streamer();
  if (const auto& exact = drawn.player->exact()) {
    const int spacing = drawn.player->sample_spacing();
    const std::string samples = spacing > 1 ? fmt::format("samples {} pixels apart", spacing) : "exact";
    print_out("{}: {} x {} pixels, {}, {} segments in {} chunks of cells, {}, {:.3f} s\n", options.written(), size[0],
              size[1], samples, exact->segments, exact->chunks, bytes_read_text(streamer.volume()),
              timings.first_image);
    if (drawn.search) print_estimate(options, drawn);
    return;
  }
  const FrameSplats& frame = *drawn.player->frame();
  print_out("{}: {} x {} pixels, {} splats in {} nodes, {}, {:.3f} s\n", options.written(), size[0], size[1],
            frame.splats, frame.nodes, bytes_read_text(streamer.volume()), timings.first_image);
  if (drawn.chosen.too_many_segments > 0)
    print_out("{}: splats, as the file's cells are the work of about {:.0f} million segments: --exact draws them\n",
              options.written(), static_cast<double>(drawn.chosen.too_many_segments) / 1e6);
  if (frame.detail.goal) {
    print_goal(options, drawn);
    return;
  }
  if (drawn.search) print_estimate_of_all(options, drawn);
  const Detail& asked = drawn.player->asked_detail();
  if (frame.detail.resolution && *frame.detail.resolution < *asked.resolution &&
      frame.splats_by_resolution.size() > *asked.resolution)
    print_out("{}: resolution {} instead of {}, to stay within {}\n", options.written(), *frame.detail.resolution,
              *asked.resolution, limits_of(options, drawn));
  if (frame.detail.resolution || frame.detail.tolerance_percent <= asked.tolerance_percent) return;
  if (std::isinf(frame.detail.tolerance_percent))
    print_out("{}: the fewest splats that there are instead of a tolerance of {:.3g} %, to stay within {}\n",
              options.written(), asked.tolerance_percent, limits_of(options, drawn));
  else
    print_out("{}: tolerance {:.3g} % instead of {:.3g} %, to stay within {}\n", options.written(),
              frame.detail.tolerance_percent, asked.tolerance_percent, limits_of(options, drawn));
}

}  // namespace splatvol
