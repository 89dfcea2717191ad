// Scripts of a hand at the viewer, by the clock.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "player/events.h"

namespace splatvol {

/// An event, or a change that a control of the panel would make.
struct Act {
  double seconds = 0;  // since the script's start
  std::optional<Event> event = {};
  std::optional<double> opacity = {};  // factor on the opacity that the scene had at the start
  std::optional<double> contour = {};  // added to its first contour's value, as a share of the attribute's range
};

/// While a hand moves, in seconds since the script's start.
struct Motion {
  double begin, end;
};

/// Acts in the order of their times, then rest.
struct Script {
  std::string name;
  std::vector<Act> acts;
  std::vector<Motion> motions = {};
  bool is_steady = true;         // there is always something new to draw, so that pictures can be counted by time
  bool begins_at_scene = false;  // the scene is put back to that of the view, and drawn, before
};

/// Where the picture is in the window, in window units.
struct PicturePlace {
  double left, width, height;
};

/// Names of scripts: first, turn, back, in, out, keys, opacity, contour, play; in this order.
[[nodiscard]] const std::vector<std::string>& script_names();

/// Returns the script of a name, which must be one of script_names().
[[nodiscard]] Script script_of(const std::string& name, const PicturePlace& picture);

/// A hand that follows a script by the clock, whatever the viewer does meanwhile.
class Hand {
 public:
  /// Begins now.
  explicit Hand(std::vector<Act> acts);

  /// Returns the acts since the last call. Waits for the first one, at most so many seconds.
  [[nodiscard]] std::vector<Act> take(double wait_seconds);

  [[nodiscard]] bool is_done() const { return next_ == acts_.size(); }
  [[nodiscard]] double seconds() const;  // since the start

 private:
  std::vector<Act> acts_;
  std::size_t next_ = 0;
  double start_;
};

}  // namespace splatvol
