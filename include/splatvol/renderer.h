// Draws .svol files. Component `render`.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "splatvol/device.h"
#include "splatvol/error.h"
#include "splatvol/export.h"
#include "splatvol/image.h"
#include "splatvol/quality.h"
#include "splatvol/scene.h"
#include "splatvol/surface_depths.h"

namespace splatvol {

struct RendererOptions {
  std::uint64_t memory = std::uint64_t{512} << 20;    // bytes to hold of what is read, and while it is drawn
  std::uint64_t gpu_memory = std::uint64_t{1} << 30;  // bytes that OpenGL may take
  Device device = Device::automatic;                  // the processor, unless a GlRenderer draws

  /// Called when parts of the file have come that `render_now` did not wait for: time to call it again. Runs on threads
  /// of the renderer, and must not call it: to wake the thread that draws.
  std::function<void()> on_data = {};
};

/// Facts of the last picture: its splats and error, and its bytes and time.
struct RenderStatistics {
  std::uint64_t splats = 0;         // 0: the picture is exact
  double error = 0;                 // estimated, against the exact picture
  bool is_complete = true;          // nothing is missing of what was asked for
  bool is_settled = true;           // it will not change: what is missing cannot be read or held
  std::uint64_t missing_bytes = 0;  // of the file, still to be read for the picture
  std::uint64_t bytes_read = 0;     // of the file, since it was opened
  std::uint64_t bytes_held = 0;     // of RendererOptions::memory, the most at any time
  std::uint64_t requests = 0;       // reads of the file, since it was opened; from a server, requests
  double seconds = 0;

  /// Errors of parts that could not be read, each once: their places are drawn coarser. ErrorCode::out_of_budget: the
  /// picture lacks patches of the boundary, for which a quarter of RendererOptions::memory is too little.
  std::vector<Error> unreadable;
};

/// An open file, its scene, and a device that draws it. Errors name the file. Calls may come from any thread, one at a
/// time; `cancel` at any time. A thread of its own draws, so contexts and state of the caller's OpenGL stay as they
/// are.
class SPLATVOL_EXPORT Renderer {
 public:
  /// Opens a .svol file, or an index of files (.svols), by its path or address, at its last step. Without a scene: one
  /// that fits the data.
  [[nodiscard]] static Result<Renderer> open(const std::string& path, const std::optional<Scene>& scene = std::nullopt,
                                             const RendererOptions& options = {});
  Renderer(Renderer&&) noexcept;
  Renderer& operator=(Renderer&&) noexcept;
  ~Renderer();

  [[nodiscard]] const Scene& scene() const;

  /// Changes what is drawn. Another camera or size costs nothing, another function or lighting little; another
  /// attribute reads other parts of the file. If it fails, all stays as it was.
  [[nodiscard]] Status set_scene(const Scene& scene);

  /// Returns a scene of this size that fits the data, for an attribute; empty: the one with most to see.
  [[nodiscard]] Result<Scene> fitting_scene(const std::string& attribute = "", int width = 512, int height = 512) const;

  /// Hides what lies behind surfaces of another program, exactly: the part of each splat that is in front is drawn.
  /// Holds for pictures of this size, until the next call. None: no surfaces. If it fails, all stays as it was. Fails
  /// if the scene shows slices.
  [[nodiscard]] Status set_surface_depths(std::optional<SurfaceDepths> depths);

  /// Returns the times of the steps, which rise; none if the file is no time series.
  [[nodiscard]] const std::vector<double>& times() const;
  [[nodiscard]] std::size_t step() const;

  /// Changes to another step. If it fails, the step before is shown.
  [[nodiscard]] Status show_step(std::size_t step);

  /// Draws the complete picture. If the budgets allow only a coarser one, draws that: never one with holes. Fails if a
  /// part of the file cannot be read, if `quality` has more than one member, and if a number of it is out of range.
  [[nodiscard]] Result<Image> render(const Quality& quality = {});

  /// Draws as `render` with Quality::milliseconds.
  [[deprecated("render({.milliseconds = 1e3 * seconds})")]] [[nodiscard]] Result<Image> render_within(double seconds);

  /// Draws the picture of what has been read, and waits up to `wait_seconds` for more. Threads go on reading until the
  /// next call. Calls with the same scene and quality end in a picture with `is_settled`. A `max_error` counts as
  /// expected, not as measured. Fails as `render`, and for an exact picture or one in milliseconds.
  [[nodiscard]] Result<Image> render_now(double wait_seconds = 0, const Quality& quality = {});

  [[nodiscard]] const RenderStatistics& statistics() const;

  /// Ends the call that is in progress in another thread: it fails with ErrorCode::cancelled, within a tenth of a
  /// second besides the time of a frame. Thread-safe.
  void cancel();

  /// Returns the device in words.
  [[nodiscard]] std::string device() const;

 private:
  struct Contents;
  explicit Renderer(std::unique_ptr<Contents> contents);
  std::unique_ptr<Contents> contents_;
};

}  // namespace splatvol
