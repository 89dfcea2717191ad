#include "bench/moving/hand.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <thread>

#include "base/math.h"
#include "tools/tool.h"

namespace splatvol {
namespace {

constexpr double pointer_rate = 60;  // events of a mouse in a second
constexpr double drag_seconds = 2, zoom_seconds = 1.5, key_seconds = 0.7, play_seconds = 3;
constexpr int notches = 20;

dvec2 center_of(const PicturePlace& picture) { return {picture.left + picture.width / 2, picture.height / 2}; }

// The share of a way that is done after a share of its time: a hand gathers speed, and slows down.
double eased(double share) { return share - std::sin(2 * std::numbers::pi * share) / (2 * std::numbers::pi); }

// A drag with the left button, relative to the picture's middle. `from` and `to` are its ends.
Script drag(const std::string& name, const PicturePlace& picture, const dvec2& from, const dvec2& to) {
  const dvec2 begin = center_of(picture) + from;
  Script script{name, {{0, PointerMoved{begin.x, begin.y}}, {0, ButtonChanged{0, true}}}, {{0, drag_seconds}}};
  const int steps = static_cast<int>(drag_seconds * pointer_rate);
  for (int i = 1; i <= steps; ++i) {
    const double share = static_cast<double>(i) / steps;
    const dvec2 at = begin + eased(share) * (to - from);
    script.acts.push_back({drag_seconds * share, PointerMoved{at.x, at.y}});
  }
  script.acts.push_back({drag_seconds, ButtonChanged{0, false}});
  return script;
}

// Two fingers beside the picture's middle: a wheel's notches in small parts. `direction`: 1 to a detail, -1 back.
Script zoom(const std::string& name, const PicturePlace& picture, int direction) {
  const dvec2 at = center_of(picture) + 0.05 * picture.height * dvec2(1, -1);
  Script script{name, {{0, PointerMoved{at.x, at.y}}}, {{0, zoom_seconds}}};
  const int steps = static_cast<int>(zoom_seconds * pointer_rate);
  for (int i = 1; i <= steps; ++i)
    script.acts.push_back({zoom_seconds * i / steps, Scrolled{0, static_cast<double>(direction * notches) / steps}});
  return script;
}

Script press(const std::string& name, const std::vector<int>& codes) {
  Script script{name, {}};
  script.is_steady = false;
  for (const int code : codes) {
    const double at = key_seconds * static_cast<double>(script.motions.size());
    script.acts.push_back({at, KeyChanged{code, true}});
    script.acts.push_back({at + 0.05, KeyChanged{code, false}});
    script.motions.push_back({at, at});
  }
  return script;
}

// A pointer that drags in the panel, to the right, to the left, and back. act(wave): what it does, from -1 to 1.
template <class DoAct>
Script slide(const std::string& name, const DoAct& act) {
  Script script{name, {}, {{0, drag_seconds}}};
  const int steps = static_cast<int>(drag_seconds * pointer_rate);
  for (int i = 1; i <= steps; ++i) {
    const double share = static_cast<double>(i) / steps;
    const double wave = std::sin(2 * std::numbers::pi * share);
    Act& done = script.acts.emplace_back(Act{drag_seconds * share, PointerMoved{100 + 60 * wave, 300}});
    act(wave, done);
  }
  return script;
}

// From 1 to .3, to 3, and back to 1.
void change_opacity(double wave, Act& act) { act.opacity = std::pow(wave < 0 ? 3 : 1 / 0.3, -wave); }
void change_contour(double wave, Act& act) { act.contour = 0.1 * wave; }

// Space begins to play, and ends it.
Script play(const std::string& name) {
  Script script = press(name, {key::space});
  script.acts.push_back({play_seconds, KeyChanged{key::space, true}});
  script.acts.push_back({play_seconds + 0.05, KeyChanged{key::space, false}});
  script.motions = {{0, play_seconds}};
  return script;
}

}  // namespace

const std::vector<std::string>& script_names() {
  static const std::vector<std::string> names = {"first", "turn",    "back",    "in",  "out",
                                                 "keys",  "opacity", "contour", "play"};
  return names;
}

Script script_of(const std::string& name, const PicturePlace& picture) {
  // A drag over the picture's shorter side is half a turn: a third of it turns by 60 degrees.
  const double third = std::min(picture.width, picture.height) / 3;
  Script script = name == "first"  ? drag(name, picture, {third / 2, 0}, {-third / 2, 0})
                  : name == "turn" ? drag(name, picture, {-third / 2, 0}, {third / 2, 0})
                  : name == "back" ? drag(name, picture, {third / 2, third / 3}, {-third / 2, -third / 3})
                  : name == "in"   ? zoom(name, picture, 1)
                  : name == "out"  ? zoom(name, picture, -1)
                  : name == "keys" ? press(name, {'1', '2', '3', 'R'})
                  : name == "play" ? play(name)
                                   : slide(name, name == "contour" ? change_contour : change_opacity);
  script.begins_at_scene = name != "first" && name != "back" && name != "out" && name != "play";
  return script;
}

Hand::Hand(std::vector<Act> acts) : acts_(std::move(acts)), start_(seconds_now()) {}

double Hand::seconds() const { return seconds_now() - start_; }

std::vector<Act> Hand::take(double wait_seconds) {
  const double now = seconds();
  const double next = is_done() ? now + wait_seconds : std::min(now + wait_seconds, acts_[next_].seconds);
  if (next > now) std::this_thread::sleep_for(std::chrono::duration<double>(next - now));
  std::vector<Act> taken;
  for (const double end = seconds(); !is_done() && acts_[next_].seconds <= end; ++next_) taken.push_back(acts_[next_]);
  return taken;
}

}  // namespace splatvol
