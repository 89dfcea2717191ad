// A file that is shown: its streamer, renderer and scene. Decides how fine a picture there is time for.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "format/steps.h"
#include "format/volume.h"
#include "renderer/device/device.h"
#include "scene/page.h"
#include "scene/scene.h"
#include "streamer/frame_pacer.h"
#include "streamer/record.h"
#include "streamer/streamer.h"
#include "viewer/screen.h"
#include "viewer/sharpening.h"

namespace splatvol {

/// How the file is to be shown, named like svrender's options.
struct ViewSettings {
  std::uint64_t memory = std::uint64_t{512} << 20;
  std::uint64_t gpu_memory = std::uint64_t{1} << 30;
  Device device = Device::automatic;
  bool in_current_context = true;  // of OpenGL; else the renderer makes a context of its own if it needs one
  KernelKind kernel = KernelKind::moments;
  double max_error = default_max_error;            // at rest; a small file shows all points
  std::optional<double> tolerance = std::nullopt;  // percent, at rest, instead of an error
  bool hurries = true;                             // coarser pictures while something moves; false: nobody waits
  SortMode sort = SortMode::exact;
  bool mixes = true;  // at rest, in slabs, where the device can
};

/// Draws one file. Draws only after a change. Needs the context that was current at `open`, if
/// `settings` say so.
class Session {
 public:
  ~Session();

  /// Opens a volume with a scene; `scene_path` empty: with a scene that fits the data. Errors name the file or the
  /// scene.
  [[nodiscard]] static Result<std::unique_ptr<Session>> open(const std::string& path, const std::string& scene_path,
                                                             const ViewSettings& settings);

  /// Updates the picture for `scene` and `settings`, as well as one frame has time for: coarse while they change, finer
  /// from call to call at rest. `seconds`: since the last call.
  [[nodiscard]] Status draw(int width, int height, double seconds);

  /// Returns whether another call without a change would draw the same.
  [[nodiscard]] bool is_settled() const { return settled_; }

  /// Shows another attribute, with a transfer function of its own. The camera stays.
  [[nodiscard]] Status show_attribute(const std::string& name);

  /// Returns the times of the steps of a time series, in one file or in several; none for another file.
  [[nodiscard]] const std::vector<double>& times() const { return steps_->times(); }

  /// Returns the number of the step that is shown; 0 for a file that is no series.
  [[nodiscard]] std::size_t step() const { return step_; }

  /// Shows another step of a series. Camera and transfer function stay. The picture stays that of the step before until
  /// there is one as fine as a moving picture is. If the step cannot be read, the one before is opened again.
  [[nodiscard]] Status show_step(std::size_t step);

  /// Whether the picture is that of `step()`, and so fine.
  [[nodiscard]] bool is_step_shown() const { return !awaits_step_; }

  /// Begins to read another step of a series. Does nothing if there is no such step.
  void read_ahead(std::size_t step);

  /// Whether `show_step` would wait for what `read_ahead` reads.
  [[nodiscard]] bool is_reading_ahead() const;

  /// Returns the range of the shown attribute's values over all steps.
  [[nodiscard]] format::StepRange range_of_all_steps() const { return steps_->range_of(used_scene_.attribute); }

  /// Returns why the picture shows nothing, or only one colour; empty if it does show something.
  [[nodiscard]] std::string explain() const;

  [[nodiscard]] const format::VolumeInfo& info() const { return streamer_->info(); }
  [[nodiscard]] const format::Attribute& attribute() const;
  [[nodiscard]] const std::array<std::uint64_t, 64>& histogram() const { return histogram_; }
  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] std::uint64_t file_bytes() const { return streamer_->volume().file_bytes(); }
  [[nodiscard]] const Scene& first_scene() const { return first_scene_; }

  /// Returns a box round the material of the coarsest splats.
  [[nodiscard]] const Box& bounds() const { return bounds_; }

  /// Returns the splats of the last draw. Null before the first.
  [[nodiscard]] const FrameSplats* frame() const { return frame_; }
  [[nodiscard]] std::vector<DrawnNode> drawn_nodes() const { return streamer_->drawn_nodes(); }
  [[nodiscard]] const View& view() const { return view_; }

  /// Returns the picture of the last draw for Screen::show. Needs a current context of OpenGL.
  [[nodiscard]] Result<ShownPicture> shown_picture();

  /// Returns the device that draws, in words.
  [[nodiscard]] std::string device_text() const { return renderer_->description(); }

  [[nodiscard]] Result<Image> image() const { return renderer_->read_image(); }

  /// Returns the last picture with its outline, if the scene has one, and with words round it.
  [[nodiscard]] Result<Image> page(const PageText& text, bool transparent = false) const;

  [[nodiscard]] double draw_seconds() const { return draw_seconds_; }

  /// Returns how the picture sharpens. None while something moves.
  [[nodiscard]] const std::optional<Sharpening>& sharpening() const { return sharpening_; }

  [[nodiscard]] StreamerStatistics statistics() const { return streamer_->statistics(); }
  [[nodiscard]] std::uint64_t device_bytes() const { return renderer_->device_bytes(); }
  [[nodiscard]] DrawingUnits units() const { return streamer_->units(); }

  /// Returns the errors of parts that could not be read, the newest last.
  [[nodiscard]] const std::vector<std::string>& troubles() const { return troubles_; }

  Scene scene;  // the scene to draw; width and height are those of the last draw
  ViewSettings settings;

 private:
  Session();
  [[nodiscard]] Status draw_next(int width, int height, double seconds);
  [[nodiscard]] Status open_streamer();
  [[nodiscard]] Status use_step();
  [[nodiscard]] Status change_step(std::size_t step);
  [[nodiscard]] Status find_bounds();
  [[nodiscard]] Status apply(const View& view);
  [[nodiscard]] Result<bool> set_splats(std::uint64_t splats);
  [[nodiscard]] Status fit_camera(int width, int height);
  void begin_rest();
  [[nodiscard]] DetailOptions next_detail(int width, int height, bool moves);
  [[nodiscard]] Status finish_picture();

  std::string path_;
  Scene first_scene_;
  std::optional<format::Steps> steps_;  // none before `open` ends
  std::size_t step_ = 0;
  bool awaits_step_ = false;    // no picture of the step yet
  double awaited_seconds_ = 0;  // since the step was asked for
  class Ahead;
  std::unique_ptr<Ahead> ahead_;  // of a series of files
  bool fits_ = false;             // the first scene is one that fits the data, and its camera the first picture's size
  std::unique_ptr<Streamer> streamer_;
  std::unique_ptr<Rasterizer> renderer_;
  bool can_mix_ = false;    // whether it draws in slabs
  PictureTexture texture_;  // of a picture that the processor drew
  bool texture_is_old_ = true;
  std::array<std::uint64_t, 64> histogram_{};
  Box bounds_;

  // The settings and scene of the last draw.
  ViewSettings used_settings_;
  Scene used_scene_;

  View view_;
  const FrameSplats* frame_ = nullptr;
  std::uint64_t most_splats_ = 0;  // that the device had room for, as far as is known
  bool settled_ = false;
  double still_seconds_ = 0;  // since the scene changed last
  FramePacer pacer_{0.011};   // seconds of a frame while something moves: 60 frames a second with the window's share
  std::optional<Sharpening> sharpening_;  // at rest
  double draw_seconds_ = 0;
  std::vector<std::string> troubles_;
};

}  // namespace splatvol
