#include "tools/svrender_statistics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <vector>

namespace splatvol {
namespace {

using json = nlohmann::ordered_json;

double median(std::vector<double> numbers) {
  if (numbers.empty()) return 0;
  std::ranges::sort(numbers);
  const std::size_t middle = numbers.size() / 2;
  return numbers.size() % 2 == 1 ? numbers[middle] : 0.5 * (numbers[middle - 1] + numbers[middle]);
}

// As in a scene file.
json lighting_of(const Scene& scene) {
  if (!scene.lighting) return false;
  return {{"ambient", scene.lighting->ambient}, {"diffuse", scene.lighting->diffuse}};
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

json picture_of(const RenderOptions& options, const Scene& scene, const Drawing& drawing) {
  const FrameSplats& frame = *drawing.frame;
  const StreamerStatistics statistics = drawing.streamer->statistics();
  return {{"file", drawing.streamer->volume().name()},
          {"scene", options.scene.empty() ? json(nullptr) : json(options.scene)},
          {"attribute", scene.attribute},
          {"width", scene.width},
          {"height", scene.height},
          {"kernel", options.kernel},
          {"sort", options.sort},
          {"raster", drawing.raster()},
          {"lighting", lighting_of(scene)},
          {"sample_spacing", drawing.sample_spacing},
          {"splats", frame.splats},
          {"nodes", frame.nodes},
          {"expected_error", frame.expected_error},
          {"resolution_histogram", frame.nodes_by_resolution},
          {"splats_by_resolution", frame.splats_by_resolution},
          {"file_bytes", drawing.streamer->volume().file_bytes()},
          {"bytes_read", statistics.bytes_read},
          {"bytes_resident_peak", statistics.bytes_resident_peak},
          {"gpu_bytes", drawing.renderer->device_bytes()},
          {"complete", frame.progress.complete},
          {"missing_rows", frame.progress.missing_rows},
          {"missing_pages", frame.progress.missing_pages},
          {"missing_bytes", frame.progress.missing_bytes}};
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
  for (const PathFrame& drawn : timings.path)
    document["path_frames"].push_back({{"splats", drawn.splats}, {"fading", drawn.fading}, {"step", drawn.change}});
}

// The detail that was asked for and the detail that the budgets allowed.
void add_detail(const RenderOptions& options, const Drawing& drawing, const Timings& timings, json& document) {
  const FrameSplats& frame = *drawing.frame;
  if (frame.detail.goal) {
    if (drawing.max_error) document["max_error"] = *drawing.max_error;
    if (drawing.estimate) {
      document["estimated_error"] = drawing.estimate->error;
      document["file_error"] = drawing.estimate->file_error;
      document["pictures_for_error"] = drawing.pictures_for_error;
      for (const auto& [splats, error] : drawing.tried)
        document["tried_for_error"].push_back({{"splats", splats}, {"estimated_error", error}});
    }
    if (options.splats) document["max_splats"] = *options.splats;
    if (options.milliseconds) {
      document["milliseconds"] = *options.milliseconds;
      document["splats_while_pacing"] = timings.pacing;
    }
    document["effective_max_splats"] = frame.detail.goal->max_splats;
  } else {
    document["tolerance"] = options.detail.tolerance_percent;
    document["effective_tolerance"] = frame.detail.tolerance_percent;
  }
  if (frame.detail.resolution) {
    document["resolution"] = *options.detail.resolution;
    document["effective_resolution"] = *frame.detail.resolution;
  }
}

// The limits of a picture's splats.
std::string limits_of(const RenderOptions& options, const Drawing& drawing) {
  const std::uint64_t splats = drawing.detail.device_splats;
  const bool is_limit =
      splats < std::numeric_limits<std::uint32_t>::max();  // what a device without memory of its own has
  if (!is_limit) return fmt::format("--memory {}", options.memory);
  return fmt::format("--memory {} and the {} splats that --gpu-memory {} holds", options.memory, splats,
                     options.gpu_memory);
}

// Says what error was measured, and why it is more than the wanted one.
void print_estimate(const RenderOptions& options, const Drawing& drawing) {
  const ErrorControl::Estimate& estimate = *drawing.estimate;
  print_out("{}: {} splats, an error of about {:.2g} by comparing {} pictures\n", options.output, drawing.frame->splats,
            estimate.error, drawing.pictures_for_error);
  if (estimate.file_error > *drawing.max_error)
    print_out("{}: more than {:.2g}: even all points of the file have about {:.2g}\n", options.output,
              *drawing.max_error, estimate.file_error);
  else if (!estimate.reached)
    print_out("{}: more than {:.2g}, to stay within {}\n", options.output, *drawing.max_error,
              limits_of(options, drawing));
}

// Says how near the picture comes to the goal.
void print_goal(const RenderOptions& options, const Drawing& drawing) {
  const FrameSplats& frame = *drawing.frame;
  if (drawing.estimate) return print_estimate(options, drawing);
  print_out("{}: {} splats, an error of {:.2g} expected\n", options.output, frame.splats, frame.expected_error);
  if (frame.splats > drawing.detail.goal->max_splats)
    print_out("{}: more than {} splats: the coarsest that the view has\n", options.output,
              drawing.detail.goal->max_splats);
}

}  // namespace

std::string statistics_text(const RenderOptions& options, const Scene& scene, const Drawing& drawing,
                            const Timings& timings) {
  json document = picture_of(options, scene, drawing);
  document["repeat"] = options.repeat;
  document["seconds"] = seconds_of(timings);
  document["first_image_seconds"] = timings.first_image;
  document["renderer"] = drawing.renderer->description();
  add_frames(timings, document);
  add_detail(options, drawing, timings, document);
  return document.dump(1, ' ', false, json::error_handler_t::replace) + "\n";
}

void print_summary(const RenderOptions& options, const Scene& scene, const Drawing& drawing, const Timings& timings) {
  const FrameSplats& frame = *drawing.frame;
  print_out("{}: {} x {} pixels, {} splats in {} nodes, {} of {} bytes read, {:.3f} s\n",
            options.output.empty() ? options.movie : options.output, scene.width, scene.height, frame.splats,
            frame.nodes, drawing.streamer->statistics().bytes_read, drawing.streamer->volume().file_bytes(),
            timings.first_image);
  if (frame.detail.goal) {
    print_goal(options, drawing);
    return;
  }
  if (frame.detail.resolution && *frame.detail.resolution < *options.detail.resolution &&
      frame.splats_by_resolution.size() > *options.detail.resolution)
    print_out("{}: resolution {} instead of {}, to stay within {}\n", options.output, *frame.detail.resolution,
              *options.detail.resolution, limits_of(options, drawing));
  if (frame.detail.resolution || frame.detail.tolerance_percent <= options.detail.tolerance_percent) return;
  if (std::isinf(frame.detail.tolerance_percent))
    print_out("{}: the fewest splats that there are instead of a tolerance of {:.3g} %, to stay within {}\n",
              options.output, options.detail.tolerance_percent, limits_of(options, drawing));
  else
    print_out("{}: tolerance {:.3g} % instead of {:.3g} %, to stay within {}\n", options.output,
              frame.detail.tolerance_percent, options.detail.tolerance_percent, limits_of(options, drawing));
}

}  // namespace splatvol
