// A hand at the picture: pointer and keys steer a session.
#pragma once

#include <array>
#include <optional>

#include "player/camera_control.h"
#include "player/events.h"
#include "player/session.h"

namespace splatvol {

/// The picture's place in the window, in the units of the pointer's coordinates.
struct SteeredPicture {
  double left = 0;
  Viewport viewport = {};
  double scale = 1;  // of text: how far a hand moves
};

/// Holds the state of buttons and keys. A session may come, go and change between two calls.
class Steering {
 public:
  struct Taken {
    bool event = false;  // by a control of the program: it does not steer
    bool scene = false;  // a control changes it: nothing is remembered
  };
  struct Effect {
    bool moves_camera = false;
    std::optional<dvec2> clicked = std::nullopt;  // where the left button was pressed and let go
    std::optional<int> pressed = std::nullopt;    // a key that was not down before
  };

  /// Takes an event over the picture, and changes the session's scene or step. Null: there is no session.
  Effect handle(const Event& event, Session* session, const SteeredPicture& picture, const Taken& taken);

  /// Begins a frame, so many seconds after the one before.
  void begin_frame(double seconds) { moved_seconds_ += seconds; }

  /// Flies with the keys that are held. `taken.event`: keys are text.
  void move(double seconds, Session* session, const Taken& taken);

  /// Adds the scene to the session's history, unless it is in the middle of a change. Called once a frame.
  void remember(Session& session, const Taken& taken) const;
  void undo(Session& session, const Taken& taken);
  void redo(Session& session, const Taken& taken);

  /// Looks at the focal point from a side, a vector of length 1. From the axis that is up, the picture is a plan: x or
  /// y goes right.
  static void look_from(Session& session, const dvec3& direction);

  [[nodiscard]] dvec2 pointer() const { return pointer_; }
  [[nodiscard]] bool is_dragging() const { return drag_.has_value(); }
  [[nodiscard]] bool is_down(int code) const { return keys_[static_cast<std::size_t>(code)]; }
  [[nodiscard]] bool has_control() const { return is_down(key::left_control) || is_down(key::right_control); }

  [[nodiscard]] bool has_shift() const { return is_down(key::left_shift) || is_down(key::right_shift); }

  /// Whether turns of the wheel, or moves by keys, may go on and be one change.
  [[nodiscard]] bool is_moving() const;

  /// Whether keys that are held go on to move the camera.
  [[nodiscard]] bool flies_on() const;

  bool is_flying = false;  // letters and arrows move the eye

 private:
  [[nodiscard]] bool is_held(const Session& session, const Taken& taken) const;
  void press_key(int code, Session& session, const Taken& taken);
  void drag(Session& session, const Viewport& viewport, const dvec2& moved) const;
  void scroll(Session& session, const SteeredPicture& picture, const dvec2& notches);

  double moved_seconds_ = 1;  // since the wheel or a key moved the camera
  dvec2 pointer_{-1, -1};
  std::array<bool, 3> buttons_{};
  std::array<bool, key::count> keys_{};
  std::optional<int> drag_;  // button of a drag that began over the picture
  dvec2 pressed_at_{0};      // where it began
};

}  // namespace splatvol
