// A file that is looked at: streamer, renderer and scene, and how fine a picture of them there is time for.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "format/volume.h"
#include "renderer/renderer.h"
#include "scene/scene.h"
#include "streamer/frame_pacer.h"
#include "streamer/streamer.h"

namespace splatvol {

/// How the file is to be shown, with the names that svrender's options have.
struct ViewSettings {
  std::uint64_t memory = std::uint64_t{512} << 20;
  std::uint64_t gpu_memory = std::uint64_t{1} << 30;
  KernelKind kernel = KernelKind::moments;
  double tolerance = 1;  // percent, at rest
  SortMode sort = SortMode::exact;
};

/// Renders only when something has changed. Needs the context that was current at `open`.
class Session {
 public:
  /// `scene_path` empty: a scene that fits the data. Errors name the file or the scene.
  [[nodiscard]] static Result<std::unique_ptr<Session>> open(const std::string& path, const std::string& scene_path,
                                                             const ViewSettings& settings);

  /// Brings the picture up to date with `scene` and `settings`, as far as a frame has time for it: coarse while they
  /// change, finer from call to call at rest. `seconds`: since the last call.
  [[nodiscard]] Status draw(int width, int height, double seconds);

  /// Whether another call with nothing changed would draw the same.
  [[nodiscard]] bool is_settled() const { return settled_; }

  /// Asks for another attribute: its own transfer function comes with it, the camera stays.
  [[nodiscard]] Status show_attribute(const std::string& name);

  /// Why there is nothing to be seen, or nothing but one colour; empty: there is.
  [[nodiscard]] std::string explain() const;

  [[nodiscard]] const format::VolumeInfo& info() const { return streamer_->info(); }
  [[nodiscard]] const format::Attribute& attribute() const;
  [[nodiscard]] const std::array<std::uint64_t, 64>& histogram() const { return histogram_; }
  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] std::uint64_t file_bytes() const { return streamer_->volume().file_bytes(); }
  [[nodiscard]] const Scene& first_scene() const { return first_scene_; }

  /// Round the material of the coarsest splats.
  [[nodiscard]] const Box& bounds() const { return bounds_; }

  /// Of the last draw. Null before the first.
  [[nodiscard]] const FrameSplats* frame() const { return frame_; }
  [[nodiscard]] std::vector<DrawnNode> drawn_nodes() const { return streamer_->drawn_nodes(); }
  [[nodiscard]] const View& view() const { return view_; }
  [[nodiscard]] unsigned texture() const { return renderer_->texture(); }
  [[nodiscard]] Result<Image> image() const { return renderer_->read_image(); }
  [[nodiscard]] double draw_seconds() const { return draw_seconds_; }
  [[nodiscard]] double tolerance_shown() const { return shown_tolerance_; }
  [[nodiscard]] StreamerStatistics statistics() const { return streamer_->statistics(); }
  [[nodiscard]] std::uint64_t gpu_bytes() const { return renderer_->gpu_bytes(); }
  [[nodiscard]] double value_offset() const { return streamer_->value_offset(); }

  /// Errors of parts that could not be read, the newest last.
  [[nodiscard]] const std::vector<std::string>& troubles() const { return troubles_; }

  Scene scene;  // what is to be seen; width and height are those of the last draw
  ViewSettings settings;

 private:
  Session() = default;
  [[nodiscard]] Status open_streamer();
  [[nodiscard]] Status find_bounds();
  [[nodiscard]] Status apply(const View& view);

  std::string path_;
  Scene first_scene_;
  std::unique_ptr<Streamer> streamer_;
  std::unique_ptr<Renderer> renderer_;
  std::array<std::uint64_t, 64> histogram_{};
  Box bounds_;

  // What the streamer and the renderer were set up for.
  ViewSettings used_settings_;
  Scene used_scene_;

  View view_;
  const FrameSplats* frame_ = nullptr;
  std::uint64_t uploaded_serial_ = 0;
  bool settled_ = false;
  double still_seconds_ = 0;  // since the scene changed last
  FramePacer pacer_{0.030};   // while something moves: 20 frames a second and more, the window's own share left out
  double shown_tolerance_ = 0;
  double draw_seconds_ = 0;
  std::vector<std::string> troubles_;
};

}  // namespace splatvol
