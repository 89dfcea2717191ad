// The frames that svrender draws, and their times.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "renderer/rasterizer.h"
#include "scene/image.h"
#include "scene/scene.h"
#include "streamer/error_control.h"
#include "streamer/record.h"
#include "streamer/streamer.h"
#include "tools/svrender_options.h"
#include "tools/svrender_page.h"

namespace splatvol {

/// A frame of --progress-frames.
struct ProgressFrame {
  double seconds;  // from the program's start to the frame
  double advance;  // the part of them that choosing and gathering took
  std::uint64_t splats, bytes_read, missing_bytes;
};

/// A frame of --path.
struct PathFrame {
  std::uint64_t splats, fading;
  double change;  // RMSE against the frame before
};

/// A frame of --steps.
struct StepFrame {
  std::size_t step;
  double time;
  double seconds;  // from the change to this step to its picture
  std::uint64_t splats, bytes_read;
};

/// Times in seconds. `fetch` and `upload` are those of the first frame; the vectors hold a number for each frame.
struct Timings {
  std::vector<ProgressFrame> progress;
  std::vector<PathFrame> path;
  std::vector<StepFrame> steps;
  std::vector<std::uint64_t> pacing;  // splats of the frames that --milliseconds tried
  double first_image = 0;
  double fetch = 0;
  double upload = 0;
  std::vector<double> cut, sort, draw, frame;
};

struct Drawing {
  std::optional<format::Steps> steps;
  std::unique_ptr<Streamer> streamer;
  std::unique_ptr<Rasterizer> renderer;
  DetailOptions detail;
  std::optional<double> max_error;                 // that is looked for by comparing pictures
  std::optional<ErrorControl::Estimate> estimate;  // of max_error, for the view that it was measured at
  std::vector<ErrorControl::Tried> tried;          // cuts on the way to it
  int pictures_for_error = 0;
  const FrameSplats* frame = nullptr;
  int sample_spacing = 1;                         // of the last frame
  bool can_mix = false;                           // in slabs, as the options want it
  Compositing compositing = Compositing::splats;  // of the last frame

  [[nodiscard]] const char* raster() const { return compositing == Compositing::slabs ? "slabs" : "splats"; }
};

/// Opens the volume and sets up the renderer. Errors name the file or the option.
[[nodiscard]] Result<Drawing> prepare_drawing(const RenderOptions& options, const Scene& scene);

/// Draws the frames that the options ask for, up to the picture, and adds their times to `timings`. `start`: the
/// program's, by seconds_now. Returns the parts of the file that could not be read and were drawn coarser.
[[nodiscard]] Result<std::vector<Error>> draw_picture(const RenderOptions& options, const Composition& composition,
                                                      const View& view, Drawing& drawing, Timings& timings,
                                                      double start);

/// Draws --repeat frames of resident splats, and replaces the times of earlier frames.
[[nodiscard]] Status draw_steady_frames(const RenderOptions& options, const Scene& scene, View view, Drawing& drawing,
                                        Timings& timings);

/// Returns the provenance of the last frame.
[[nodiscard]] Provenance provenance_of(const RenderOptions& options, const Scene& scene, const Drawing& drawing);

}  // namespace splatvol
