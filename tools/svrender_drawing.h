// The frames that svrender draws, and their times.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "format/steps.h"
#include "player/player.h"
#include "tools/svrender_options.h"
#include "tools/svrender_page.h"

namespace splatvol {

/// A frame of --progress-frames.
struct ProgressFrame {
  double seconds;  // from the program's start to the frame
  double advance;  // the part of them that choosing and gathering took
  std::uint64_t splats, bytes_read, missing_bytes;
};

/// A frame of --steps.
struct StepFrame {
  std::size_t step;
  double time;
  double seconds;  // from the change to this step to its picture
  std::uint64_t splats, bytes_read;
};

/// Times in seconds. `fetch` and `upload` are those of the first picture; the vectors hold a number for each frame.
struct Timings {
  std::vector<ProgressFrame> progress;
  std::vector<StepFrame> steps;
  std::vector<Recipe> rungs;  // that --milliseconds tried; at the end that of the picture
  double first_image = 0;
  double fetch = 0;
  double upload = 0;
  std::vector<double> cut, sort, draw, frame;

  /// Adds the times of the player's last frame.
  void add(const PlayerTimes& times);
};

/// What svrender draws with, and what came of it.
struct Drawn {
  std::unique_ptr<Player> player = nullptr;
  ChosenQuality chosen = {};               // of the pictures
  Detail splats = {};                      // of frames that are drawn one after another
  int sample_spacing = 0;                  // of these
  bool is_exact = false;                   // these are exact where the file has cells
  std::optional<ErrorSearch> search = {};  // of an error, for the view that it was measured at
};

/// Opens a player for the step that the options name. Errors name the file or the option.
[[nodiscard]] Result<Drawn> prepare(const RenderOptions& options, format::Steps steps, const Scene& scene);

/// Draws the frames that the options ask for, up to the picture, and adds their times to `timings`. `start`: the
/// program's, by seconds_now. Returns the parts of the file that could not be read and were drawn coarser.
[[nodiscard]] Result<std::vector<Error>> draw_pictures(const RenderOptions& options, const Composition& composition,
                                                       Drawn& drawn, Timings& timings, double start);

/// Draws --repeat frames of resident splats, and replaces the times of earlier frames.
[[nodiscard]] Status draw_steady_frames(const RenderOptions& options, Drawn& drawn, Timings& timings);

/// Returns the time of the step that is shown; none: the file is no series.
[[nodiscard]] std::optional<double> time_of(const Player& player);

/// Returns the splats of the last frame: of an exact picture none.
[[nodiscard]] const FrameSplats& splats_of(const Player& player);

/// Returns the provenance of the last frame.
[[nodiscard]] Provenance provenance_of(const RenderOptions& options, const Drawn& drawn);

}  // namespace splatvol
