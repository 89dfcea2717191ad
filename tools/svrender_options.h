// The options of svrender.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "scene/drawing.h"
#include "tools/plane_options.h"
#include "tools/reading.h"
#include "tools/steps.h"
#include "tools/tool.h"

namespace splatvol {

struct RenderOptions {
  std::vector<std::string> inputs;  // the .svol file, or the files of a mesh
  std::string volume;               // that is drawn: the first of them, or what the mesh became
  std::string scene;                // empty: one that fits the data
  std::string attribute;            // without a scene; empty: the best
  std::string opacity_attribute;    // likewise; empty: the opacity is that of the same attribute
  std::string output;
  std::string size;
  std::string stats;
  std::string progress_frames;  // folder; empty: none
  std::vector<double> path;     // frames, degrees, factor; empty: none
  int turntable = 0;            // frames of a full turn; 0: none
  StepChoice step;
  std::string steps;  // to draw one after another: "all" or "A:B"; empty: one
  std::string movie;  // .mp4; empty: none
  double frames_per_second = 30;
  std::string background;  // see parse_color; empty: the scene's
  PlaneOptions planes;
  std::string title;
  bool has_time = false;  // in the title
  bool scalar_bar = false;
  std::optional<int> ticks;         // of the scalar bar
  std::optional<std::string> unit;  // in place of the attribute's
  bool transparent = false;
  std::string memory = default_memory(512);
  std::string gpu_memory = "1G";
  std::string device = "auto";
  ReadingOptions reading;              // of surfaces
  std::string kernel, sort, sampling;  // empty: not told
  Quality quality;                     // what options tell, and what the scene does besides
  Drawing drawing;                     // likewise
  int repeat = 1;

  /// The picture, or the movie if there is no picture.
  [[nodiscard]] const std::string& written() const { return output.empty() ? movie : output; }

  /// Whether frames of a moving camera are drawn.
  [[nodiscard]] bool moves() const { return !path.empty() || turntable > 0; }

  /// Whether frames of several steps are drawn.
  [[nodiscard]] bool plays() const { return !steps.empty(); }

  /// Whether frames are drawn while one picture is read.
  [[nodiscard]] bool progresses() const { return !progress_frames.empty() && !moves() && !plays(); }
};

/// Adds all options to `app`. Parsing writes into `options`, which must live as long as `app`.
void add_options(CommandLine& app, RenderOptions& options);

}  // namespace splatvol
