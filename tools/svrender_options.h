// The options of svrender.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "streamer/streamer.h"
#include "tools/steps.h"

namespace splatvol {

struct RenderOptions {
  std::string volume;
  std::string scene;
  std::string output;
  std::string size;
  std::string stats;
  std::string progress_frames;  // folder; empty: none
  std::vector<double> path;     // frames, degrees, factor; empty: none
  StepChoice step;
  std::string steps;  // to draw one after another: "all" or "A:B"; empty: one
  int fade = 1;       // frames that a change of resolution takes
  std::string memory = "512M";
  std::string gpu_memory = "1G";
  std::string sort = "exact";
  std::string kernel = "moments";
  std::string sampling = "auto";
  DetailOptions detail;
  std::optional<double> max_error;
  std::optional<std::uint64_t> splats;
  std::optional<double> milliseconds;
  int repeat = 1;
};

/// Adds all options to `app`. Parsing writes into `options`, which must live as long as `app`.
void add_options(CLI::App& app, RenderOptions& options);

}  // namespace splatvol
