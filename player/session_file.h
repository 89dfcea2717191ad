// What a session reads of a file, before it shows a picture.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "base/addresses.h"
#include "base/error.h"
#include "format/volume.h"
#include "player/conversion.h"
#include "player/motion_control.h"
#include "player/player.h"
#include "player/recipe.h"
#include "scene/scene.h"
#include "streamer/first/default_scene.h"

namespace splatvol {

/// What a picture is made of, and what is known of its error.
struct ShownRecipe {
  Recipe recipe = {};        // as it was drawn
  bool moves = false;        // drawn while something moved
  double error = 0;          // of one that moves; root mean square of linear RGB
  bool is_measured = false;  // the error, in about this view; else it is expected
};

/// A picture that is complete, before it is shown.
struct CompletePicture {
  std::uint64_t number;  // of the session's pictures, from 1 on
  const Image& image;    // linear and premultiplied; valid during the call
  const Scene& scene;
  std::size_t step;
  const ShownRecipe& recipe;
  double seconds;  // from its beginning until it can be shown
};

/// How the file is to be shown, named like svrender's options.
struct ViewSettings {
  std::uint64_t memory = std::uint64_t{512} << 20;
  std::uint64_t gpu_memory = std::uint64_t{1} << 30;
  Device device = Device::automatic;
  bool in_current_context = true;   // of OpenGL; else the renderer makes a context of its own if it needs one
  Quality quality = {};             // at rest, without milliseconds; a small file shows all points instead of an error
  Drawing drawing = {};             // at rest
  bool hurries = true;              // coarser pictures while something moves; false: nobody waits
  MotionLimits moving = {};         // how good these are
  ReadSurface read_surface = {};    // as in PlayerOptions
  FirstPicture first_picture = {};  // as in PlayerOptions; its size may turn out to be another

  // Whether a thread reads what another attribute, kernel or memory, or surfaces need, while pictures are drawn without
  // the change, and draws what moves. Else the next draw does both.
  bool works_aside = true;

  // Segments that a picture may have to be of cells, in all of its samples, unless `quality` asks for an exact one; 0:
  // splats.
  std::uint64_t most_exact_segments = splatvol::most_exact_segments;

  // Called by `draw` with each picture of the processor that will be shown.
  std::function<void(const CompletePicture&)> on_picture = {};
};

/// How a mesh is converted.
struct Conversion {
  std::function<void(const ConversionProgress&)> tell = {};  // called on the thread that reads
  std::string preview = {};                                  // as in ConversionRequest
  bool all_steps = false;                                    // else the last one, unless a step is asked for
};

/// What a session shows of a file besides pictures.
struct SessionData {
  Box bounds = {};                                    // of the material
  Box mesh_box = {};                                  // as bounds, if the file keeps no cells
  std::array<std::uint64_t, 64> histogram{};          // of the scene's attribute
  std::array<std::uint64_t, 64> opacity_histogram{};  // of the opacity attribute, if there is one
  Scene fitting = {};                                 // fits the scene's attribute, on the scene's background
};

/// Where a file comes from.
struct SessionSource {
  std::string path = {};
  std::vector<std::string> pieces = {};         // of the mesh
  std::optional<ConvertedFile> converted = {};  // from a mesh
};

/// What a session reads of a file. Made on any thread.
struct SessionFile {
  SessionSource source;
  bool fits = false;  // the scene is one that fits the data
  ViewSettings settings = {};
  PlayerFile file;
  SessionData data = {};
  std::optional<FittingOpacity> fitting_opacity = {};  // if it is to fit
};

[[nodiscard]] PlayerOptions player_options(const ViewSettings& settings);

/// Returns `settings` with what `use` tells.
[[nodiscard]] ViewSettings with_use(ViewSettings settings, const SceneUse& use);

/// Reads the histograms of a scene's attributes. Without an opacity, its histogram stays.
[[nodiscard]] Status read_histograms(const format::Volume& volume, const Scene& scene, SessionData& data);

/// Returns the box round the mesh's cells; `bounds` if the file keeps none.
[[nodiscard]] Result<Box> mesh_box_of(const format::Volume& volume, const Box& bounds);

/// Adds what a session shows besides splats. Reads the coarsest splats, too. Unless it `must_fit`, the scene takes the
/// place of one that fits a file which is damaged.
[[nodiscard]] Result<SessionFile> with_data(SessionFile read, bool must_fit, bool fits_opacity = false);

/// Fails for a step that a series does not have.
[[nodiscard]] Status check_step(const format::Steps& steps, std::size_t step);

}  // namespace splatvol
