// The viewer without its window: events in, frames out.
#pragma once

#include <chrono>
#include <functional>
#include <future>
#include <memory>
#include <optional>
#include <string>

#include "base/error.h"
#include "player/movie.h"
#include "viewer/camera_control.h"
#include "viewer/camera_path.h"
#include "viewer/events.h"
#include "viewer/file_dialog.h"
#include "viewer/gui.h"
#include "viewer/history.h"
#include "viewer/opening.h"
#include "viewer/overlay.h"
#include "viewer/prober.h"
#include "viewer/recent_files.h"
#include "viewer/screen.h"
#include "viewer/session.h"
#include "viewer/slice_controls.h"
#include "viewer/transfer_editor.h"

namespace splatvol {

struct ViewerOptions {
  std::string volume;  // empty: none yet, or the one that the scene names
  std::string scene;   // path or text; empty: one that fits the data
  ViewSettings settings;
  SceneUse use = {};              // goes before what the scene tells; its file is `volume`
  std::string recent_files = "";  // where the list of recent files is kept; empty: nowhere
  Clipboard clipboard = {};
  WindowResized window = {0, 0, 0, 0, 1};  // of the first frame, if it is known: a file is opened for this size
};

/// Shows a volume and its controls. Needs the OpenGL 4.5 context that was current at `create`.
class Viewer {
 public:
  /// Begins to open the volume of `options`. Fails if it, or the scene, soon turns out to be unreadable. Later errors
  /// appear in the window.
  [[nodiscard]] static Result<std::unique_ptr<Viewer>> create(const ViewerOptions& options);

  /// Draws a frame into the framebuffer that is bound, of the size of the last WindowResized. The first input must have
  /// one. Other events may wait for the next frames.
  [[nodiscard]] Status frame(const FrameInput& input);

  /// Returns whether a frame without events would be the same. If not, the next frame should come soon.
  [[nodiscard]] bool is_settled() const;

  /// Returns whether a frame without events would be the same until a thread has drawn a picture. Frames would only
  /// take the thread's time.
  [[nodiscard]] bool awaits_picture() const;

  /// Returns the error of the last picture, if it could not be drawn.
  [[nodiscard]] const Status& drawn() const { return drawn_; }

  [[nodiscard]] bool wants_to_close() const { return closing_; }
  [[nodiscard]] std::string title() const;

  /// Lets steps that play end at the last one, so that the viewer settles.
  void end_loop() { loops_ = false; }
  [[nodiscard]] const Session* session() const { return session_.get(); }

 private:
  static constexpr double panel_width = 336;  // at scale 1

  explicit Viewer(const ViewerOptions& options);
  void show(std::unique_ptr<Session> session);
  void open(const std::string& path);
  void begin_opening(const SceneUse& use, const std::string& scene_path);
  [[nodiscard]] Status take_opened(std::chrono::milliseconds wait);
  void draw_opening();
  void close();
  void end_session();
  void stop_playing();
  [[nodiscard]] Status open_scene(const std::string& path);
  [[nodiscard]] Status open_color_maps(const std::string& path);
  void handle(const Event& event);
  void handle_key(int code);
  void handle_scene_key(int code);
  [[nodiscard]] bool grab_plane(int button);
  void drag_camera(const dvec2& drag);
  void scroll(const dvec2& notches);
  void move_camera(const FrameInput& input);
  [[nodiscard]] bool is_held() const;
  void remember();
  void undo();
  void redo();
  void restore(const Scene& scene);
  void play(double seconds);
  void play_steps(double seconds);
  void toggle_steps();
  void show_step(std::size_t step);
  [[nodiscard]] Status draw_frame(const FrameInput& input);
  [[nodiscard]] Status draw_picture(double seconds);
  void note_window_seconds(double seconds);

  void draw_panel();
  void draw_panel_button();
  void draw_history_buttons();
  void draw_attribute_menu();
  void draw_opacity_controls();
  void draw_step_controls();
  void draw_view_section();
  void draw_detail_controls();
  void draw_lighting_controls();
  void draw_camera_controls();
  void draw_clip_box_controls();
  void draw_surface_controls();
  void draw_path_section();
  void draw_file_section();
  void copy_command();
  void draw_picture_controls();
  void draw_scalar_bar_controls();
  void save(const std::string& path, std::function<void()> write);
  void save_text(const std::string& path, const std::string& text);
  void save_picture();
  void copy_picture();
  void save_drawn_picture();
  void draw_movie_controls();
  void save_movie();
  void film();
  void end_film();
  [[nodiscard]] std::optional<std::array<int, 2>> saved_size();
  [[nodiscard]] Status write_picture(const std::string& path) const;
  void draw_question();
  void draw_hud();
  void draw_help();
  void draw_overlays();
  void draw_work();
  void draw_probes();
  [[nodiscard]] dvec2 pixel_at(const dvec2& position) const;
  [[nodiscard]] Prober::Question question_about(const Looking& looking) const;
  [[nodiscard]] Prober::CellsOf probed_cells() const;
  void pin(const dvec2& position);
  [[nodiscard]] std::optional<Probe> with_slices(const std::optional<Probe>& volume, const Ray& ray) const;
  void draw_hovered();
  void draw_pinned();
  void report(const std::string& path, const Status& saved);
  [[nodiscard]] Viewport viewport() const { return {picture_area().width, picture_area().height}; }
  [[nodiscard]] dvec2 pointer_in_picture() const { return pointer_ - dvec2(picture_area().left, 0); }
  [[nodiscard]] PictureArea picture_area() const;
  [[nodiscard]] std::array<int, 2> picture_size() const;
  void look_from(const dvec3& direction);
  void set_up_axis(int axis);

  // Beside a panel, the picture would be too narrow: the panel covers it, and is hidden at first.
  [[nodiscard]] bool is_narrow() const { return window_.width < 1.75 * panel_width * window_.content_scale; }
  [[nodiscard]] bool& panel() { return is_narrow() ? covering_panel_ : panel_; }
  [[nodiscard]] bool has_shift() const { return keys_[key::left_shift] || keys_[key::right_shift]; }
  [[nodiscard]] bool has_control() const { return keys_[key::left_control] || keys_[key::right_control]; }
  [[nodiscard]] bool is_busy() const { return idle_seconds_ < pause_seconds; }
  [[nodiscard]] bool is_minimised() const { return window_.pixel_width <= 0 || window_.pixel_height <= 0; }

  std::unique_ptr<Gui> gui_;
  Screen screen_;
  ViewSettings settings_;
  std::unique_ptr<Session> session_;
  std::unique_ptr<Opening> opening_;  // of the file that is to replace the session's
  double opening_seconds_ = 0;
  double reading_seconds_ = 0;  // since a change was asked for that is being read
  FileDialog dialog_;
  RecentFiles recent_files_;
  TransferEditor editor_;
  TransferEditor opacity_editor_;
  SliceControls planes_;
  std::optional<History<Scene>> history_;      // of the session's scene, without its size; none before a picture
  std::optional<std::uint64_t> memory_shown_;  // MiB, while the slider is held
  double max_error_ = default_max_error;       // the last one, while the detail is by tolerance

  // Input.
  EventQueue events_;
  double idle_seconds_ = 0;   // since the last event
  double moved_seconds_ = 1;  // since the wheel or a key moved the camera
  WindowResized window_{0, 0, 0, 0, 1};
  dvec2 pointer_{-1, -1};
  std::array<bool, 3> buttons_{};
  std::array<bool, key::count> keys_{};
  std::optional<int> drag_;  // button of a drag that began over the picture
  dvec2 pressed_at_{0};      // where it began

  // Shown besides the picture.
  bool panel_ = true, help_ = false, hud_ = true, axes_ = true, scalar_bar_ = true, cut_ = false, probe_ = true;
  bool covering_panel_ = false;
  bool light_ = false;        // the interface's theme
  bool panel_right_ = false;  // the panel's side
  int up_ = 1;                // the axis that views along an axis have upwards
  bool flying_ = false;
  bool closing_ = false;
  int pending_frames_ = 0;      // the interface settles a frame after a change
  double frame_seconds_ = 0;    // from one frame to the next
  double window_seconds_ = 0;   // of a frame, besides its picture
  int window_frames_ = 0;       // of these, up to the first ones
  double picture_seconds_ = 0;  // of the picture of this frame
  Status drawn_;                // of the last picture
  std::string message_;         // the last error, or the last file saved

  CameraPath path_;
  std::optional<double> playing_;  // seconds since its beginning

  // Steps of a time series.
  std::optional<double> step_seconds_;      // while they play: since the last change
  std::optional<std::size_t> played_step_;  // a file that is read
  double steps_per_second_ = 5;
  bool loops_ = false;

  std::array<char, 512> scene_name_{}, picture_name_{}, path_name_{}, title_{};
  bool saves_bar_ = false, saves_transparent_ = false, saves_as_shown_ = true;
  std::array<int, 2> saved_size_ = {1920, 1080};

  // A line of sight that was clicked on.
  struct Pin {
    Looking looking;
    std::optional<Prober::Question> asked = {};  // the question that `probe` answers
    std::optional<Probe> probe = {};
  };
  Prober prober_;
  std::optional<Pin> pin_;

  // A file that is there, while the user is asked.
  struct Question {
    std::string path;
    std::function<void()> write;
  };
  std::optional<Question> question_;

  // A picture that is drawn to be saved.
  struct Saving {
    std::string path;
    int width, height;
    bool is_copied = false;  // to the clipboard, and then removed
  };
  std::optional<Saving> saving_;

  // A movie whose frames are drawn, and then joined on a thread.
  struct Filming {
    Movie movie;
    std::string path;
    int width, height;
    int frames, drawn;
    bool turns;
    Camera first;
    std::future<Status> joined = {};
  };
  std::optional<Filming> filming_;
  std::array<char, 512> movie_name_{};
  bool films_path_ = false;
  double frames_per_second_ = 30;
};

}  // namespace splatvol
