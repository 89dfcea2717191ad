// The viewer without its window: events in, frames out.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "base/error.h"
#include "player/events.h"
#include "player/session.h"
#include "viewer/file_dialog.h"
#include "viewer/opening.h"
#include "viewer/panel.h"
#include "viewer/pins.h"
#include "viewer/recent_files.h"
#include "viewer/state.h"
#include "viewer/window/gui.h"
#include "viewer/window/presenter.h"

namespace splatvol {

class FrameComposer;

struct ViewerOptions {
  std::string volume = {};  // empty: none yet, or the one that the scene names
  std::string scene = {};   // path or text; empty: one that fits the data
  ViewSettings settings = {};
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

  Viewer(const Viewer&) = delete;
  Viewer& operator=(const Viewer&) = delete;
  ~Viewer();

  /// Takes the events of a frame, and draws it into the framebuffer that is bound, of the size of the last
  /// WindowResized. The first input must have one. Other events may wait for the next frames. Draws nothing if the
  /// framebuffer would look the same: see has_drawn().
  [[nodiscard]] Status frame(const FrameInput& input);

  /// Returns whether the last frame was drawn. If not, the framebuffer is untouched: what the window shows is right,
  /// and must not be swapped with another one. What is drawn is a whole frame.
  [[nodiscard]] bool has_drawn() const { return has_drawn_; }

  /// Lets the next frame be drawn in any case: the framebuffer's contents are lost. WindowResized does the same.
  void redraw() { is_frame_lost_ = true; }

  /// Returns the seconds that the last frame took besides Session::draw.
  [[nodiscard]] double window_seconds() const { return window_seconds_; }

  /// Returns whether a frame without events, `seconds` after the last one, would be the same. If not, the next frame
  /// should come soon.
  [[nodiscard]] bool is_settled(double seconds = 0) const;

  /// Returns whether a frame without events, `seconds` after the last one, would be the same until a thread has drawn a
  /// picture. Frames would only take the thread's time.
  [[nodiscard]] bool awaits_picture(double seconds = 0) const;

  /// Returns how long to wait for events before the next frame, in seconds, if the last one was `seconds` ago.
  [[nodiscard]] double patience(double seconds = 0) const;

  /// Returns the error of the last picture, if it could not be drawn.
  [[nodiscard]] const Status& drawn() const { return state_.drawn; }

  [[nodiscard]] bool wants_to_close() const { return closing_; }
  [[nodiscard]] std::string title() const;

  /// Lets steps that play end at the last one, and notes stay, so that the viewer settles on what a recording leads to.
  void end_recording();
  [[nodiscard]] const Messages& messages() const { return state_.messages; }
  [[nodiscard]] const Session* session() const { return state_.session.get(); }
  [[nodiscard]] Session* session() { return state_.session.get(); }

 private:
  explicit Viewer(const ViewerOptions& options);
  void open(const std::string& path);
  void drop(const std::vector<std::string>& paths);
  void add_surface(const std::string& path);
  void begin_opening(const SceneUse& use, const std::string& scene_path, bool all_steps = false);
  void open_all_steps();
  [[nodiscard]] Status take_opened(double wait_seconds);
  [[nodiscard]] Status take_preview();
  void take_over_preview(Session& whole) const;
  void show(std::unique_ptr<Session> session);
  void end_opening();
  void draw_toasts();
  void ask_up();
  void draw_opening();
  void close();
  void end_session();
  void stop_playing();
  [[nodiscard]] Status open_scene(const std::string& path);
  [[nodiscard]] Status open_color_maps(const std::string& path);
  void take_events(const FrameInput& given);
  void handle(const Event& event);
  void click(const dvec2& position);
  void press_key(int code);
  void press_escape();
  void note_beginnings();
  void end(std::size_t thing);
  [[nodiscard]] Steering::Taken taken(bool event) const { return {event, panel_.holds_scene()}; }
  void play(double seconds);
  [[nodiscard]] Status draw_frame(const FrameInput& input);
  void draw_controls();
  [[nodiscard]] Status draw_picture(double seconds);
  void look_along_plane(Session& session);
  void draw_overlays();
  void note_picture(double seconds);
  void tell_troubles();
  [[nodiscard]] std::optional<double> windows_wait_seconds() const;
  [[nodiscard]] Status present(double seconds);
  [[nodiscard]] bool is_busy() const { return idle_seconds_ < pause_seconds; }
  [[nodiscard]] bool is_note_over(double seconds) const;
  [[nodiscard]] bool rests(double seconds) const;     // but for a file that is being opened
  [[nodiscard]] bool is_still(double seconds) const;  // and for the panel's jobs

  // What Esc ends, besides dialogs and errors.
  struct Ending {
    enum : std::size_t { help, list, opening, reading, pin, line, steps, movie, count };
  };

  ViewerState state_;
  ViewSettings settings_;
  std::unique_ptr<Gui> gui_;
  Presenter presenter_;
  std::unique_ptr<FrameComposer> composer_;
  std::unique_ptr<Opening> opening_;  // of the file that is to replace the session's
  std::unique_ptr<Opening> preview_;  // of some of its points
  std::optional<Scene> previewed_;    // the session shows these: its first scene
  double opening_seconds_ = 0;
  double reading_seconds_ = 0;  // since a change was asked for that is being read
  FileDialog dialog_;
  RecentFiles recent_files_;
  Panel panel_;
  Pins pins_;

  std::array<std::uint64_t, Ending::count> began_{};  // Messages::take_number() when it began; 0: it is not there
  std::size_t told_troubles_ = 0;                     // of the session's
  EventQueue events_;
  double idle_seconds_ = 0;       // since the last event
  double unchanged_seconds_ = 0;  // since the last new picture
  double frame_seconds_ = 0;      // from one new picture to the next
  float hud_bottom_ = 0;          // of the numbers of this frame; 0: there are none
  double window_seconds_ = 0;     // of the last frame, besides its picture
  double picture_seconds_ = 0;    // of the picture of this frame
  ShownPicture picture_;          // of this frame
  bool has_drawn_ = false;        // this frame
  bool is_frame_lost_ = true;     // the framebuffer does not show the frame before
  bool closing_ = false;
};

}  // namespace splatvol
