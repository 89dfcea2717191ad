// A user's events in a window; recorded and replayed.
#pragma once

#include <cstdint>
#include <deque>
#include <fstream>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "base/error.h"
#include "base/file.h"

namespace splatvol {

/// Keys by the codes that GLFW gives them: letters and digits are their upper-case ASCII codes.
namespace key {
inline constexpr int space = 32, minus = 45, equal = 61, escape = 256, enter = 257, tab = 258, backspace = 259,
                     del = 261, right = 262, left = 263, down = 264, up = 265, page_up = 266, page_down = 267,
                     home = 268, end = 269, f1 = 290, f12 = 301, left_shift = 340, left_control = 341, left_alt = 342,
                     right_shift = 344, right_control = 345;
inline constexpr int count = 349;
}  // namespace key

// Positions are in window units from the upper left corner.
struct PointerMoved {
  double x, y;
};
struct ButtonChanged {
  int button;  // 0 left, 1 right, 2 middle
  bool down;
};
struct Scrolled {
  double x, y;  // notches of the wheel; up is positive
};
struct KeyChanged {
  int code;
  bool down;
};
struct TextTyped {
  std::uint32_t character;  // Unicode
};
/// Also the first event of all.
struct WindowResized {
  int width, height;              // window units
  int pixel_width, pixel_height;  // of the framebuffer; 0 while minimised
  double content_scale;           // scale of text, 1 for a plain screen
};
struct FilesDropped {
  std::vector<std::string> paths;
};
using Event = std::variant<PointerMoved, ButtonChanged, Scrolled, KeyChanged, TextTyped, WindowResized, FilesDropped>;

/// All events before a frame, and the time since the frame before.
struct FrameInput {
  double seconds = 0;
  std::vector<Event> events;
};

/// Returns the key that types a letter on the user's layout. `name`: what the key of this code types there; empty if
/// not known. A key that types no letter from A to Z keeps its code, which is its place on a keyboard of the United
/// States.
[[nodiscard]] int key_by_name(int code, std::string_view name);

/// Events that wait for their frame. Dear ImGui sees only the state of buttons, keys and pointer at a frame: of a press
/// and its release, or of a motion behind a press, it must see one at a time.
class EventQueue {
 public:
  void add(const std::vector<Event>& events) { events_.insert(events_.end(), events.begin(), events.end()); }

  /// Takes the events of the next frame, in their order: none of a frame hides another one from Dear ImGui. A press or
  /// a scroll comes a frame after a motion, when the control under the pointer is known.
  [[nodiscard]] std::vector<Event> take_frame();

  [[nodiscard]] bool is_empty() const { return events_.empty(); }

 private:
  std::deque<Event> events_;
};

/// Returns a line of JSON, with its end.
[[nodiscard]] std::string to_line(const FrameInput& input);

/// A recording that is written frame by frame: it is there up to the last frame, however the program ends.
class RecordingFile {
 public:
  /// Makes the file, or empties it. Errors name the file.
  [[nodiscard]] static Result<RecordingFile> create(const std::string& path);

  /// Adds a frame. Fails if the file cannot be written to.
  [[nodiscard]] Status add(const FrameInput& input);

 private:
  explicit RecordingFile(std::string path) : path_(std::move(path)), file_(path_, std::ios::binary) {}

  std::string path_;
  std::ofstream file_;
};

/// Reads a recording: a line for each frame. Leaves out a last line that was cut off, unless it is the only one. Errors
/// name the file and the line.
[[nodiscard]] Result<std::vector<FrameInput>> load_recording(const std::string& path);

}  // namespace splatvol
