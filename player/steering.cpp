#include "player/steering.h"

#include <algorithm>
#include <cmath>
#include <functional>

namespace splatvol {
namespace {

constexpr double zoom_per_notch = 0.87;  // of the wheel
constexpr double pan_per_notch = 40;     // window units at scale 1
constexpr double least_distance = 1e-7;  // of the data's extent
constexpr double fly_speed = 0.35;       // extents a second
constexpr double turn_speed = 1.2;       // radians a second

// Turns of the wheel, and moves by keys, are one step of the history if they follow each other so soon.
constexpr double burst_seconds = 0.3;

double extent_of(const Session& session) {
  return std::max(glm::length(session.bounds().high - session.bounds().low), 1e-300);
}

}  // namespace

// The scene before a change is remembered when a key or a button begins it.
Steering::Effect Steering::handle(const Event& event, Session* session, const SteeredPicture& picture,
                                  const Taken& taken) {
  Effect effect;
  if (const auto* changed = std::get_if<KeyChanged>(&event)) {
    const bool pressed = changed->down && !is_down(changed->code);
    if (pressed && session && !is_held(*session, taken)) session->remember();
    keys_[static_cast<std::size_t>(changed->code)] = changed->down;
    if (!pressed || taken.event) return effect;
    effect.pressed = changed->code;
    if (session) press_key(changed->code, *session, taken);
  }
  if (const auto* button = std::get_if<ButtonChanged>(&event); button && button->button >= 0 && button->button < 3) {
    if (button->down && session && !is_held(*session, taken)) session->remember();
    buttons_[static_cast<std::size_t>(button->button)] = button->down;
    if (button->down && !drag_ && !taken.event) {
      drag_ = button->button;
      pressed_at_ = pointer_;
    }
    if (!button->down && drag_ == button->button) {
      drag_.reset();
      if (button->button == 0 && glm::length(pointer_ - pressed_at_) < 3 * picture.scale) effect.clicked = pointer_;
    }
  }
  if (const auto* moved = std::get_if<PointerMoved>(&event)) {
    const dvec2 before = std::exchange(pointer_, dvec2(moved->x, moved->y));
    effect.moves_camera = session && drag_ && !taken.event;
    if (effect.moves_camera) drag(*session, picture.viewport, pointer_ - before);
  }
  if (const auto* scrolled = std::get_if<Scrolled>(&event); scrolled && session && !taken.event) {
    scroll(*session, picture, dvec2(scrolled->x, scrolled->y));
    effect.moves_camera = true;
  }
  return effect;
}

// The wheel, or two fingers: up and down zooms, sideways moves, and with shift both move.
void Steering::scroll(Session& session, const SteeredPicture& picture, const dvec2& notches) {
  Camera& camera = session.scene.camera;
  const bool moves = has_shift() && !has_control();
  const dvec2 move(notches.x, moves ? notches.y : 0);
  if (move != dvec2(0)) pan(camera, picture.viewport, pan_per_notch * picture.scale * move);
  if (!moves)
    zoom(camera, picture.viewport, pointer_ - dvec2(picture.left, 0), std::pow(zoom_per_notch, notches.y),
         least_distance * extent_of(session));
  moved_seconds_ = 0;
}

void Steering::drag(Session& session, const Viewport& viewport, const dvec2& moved) const {
  Camera& camera = session.scene.camera;
  if (is_flying && *drag_ == 0) {
    const double unit = 2.0 / std::min(viewport.width, viewport.height);
    fly(camera, dvec3(0), unit * moved.x, -unit * moved.y);
  } else if (*drag_ == 1 || *drag_ == 2 || has_shift()) {
    pan(camera, viewport, moved);
  } else if (has_control()) {
    roll(camera, 4 * moved.x / viewport.width);
  } else {
    orbit(camera, viewport, moved);
  }
}

void Steering::press_key(int code, Session& session, const Taken& taken) {
  using Projection = Camera::Projection;
  if (has_control()) {
    if (code == 'Y' || (code == 'Z' && has_shift()))
      redo(session, taken);
    else if (code == 'Z')
      undo(session, taken);
    return;
  }
  Scene& scene = session.scene;
  switch (code) {
    case 'F':
      is_flying = !is_flying;
      break;
    case key::space:
      session.toggle_playing();
      break;
    case key::right:
    case key::left: {
      const std::size_t step = session.step();
      if (!is_flying && (code == key::right || step > 0)) session.choose_step(code == key::right ? step + 1 : step - 1);
      break;
    }
    case 'B':
      scene.outline = !scene.outline;
      break;
    case 'R':
      session.show_all();
      break;
    case 'P':
      set_projection(scene.camera, scene.camera.projection == Projection::perspective ? Projection::orthographic
                                                                                      : Projection::perspective);
      break;
    case 'L':
      scene.lighting = scene.lighting ? std::nullopt : std::optional(Lighting());
      break;
    case '1':
    case '2':
    case '3': {
      dvec3 direction(0);
      direction[code - '1'] = has_shift() ? -1 : 1;
      look_from(session, direction);
      break;
    }
    case '4': {
      dvec3 corner(has_shift() ? -1 : 1);
      corner[session.up_axis()] = 1;
      look_from(session, glm::normalize(corner));
      break;
    }
    default:
      break;
  }
}

void Steering::look_from(Session& session, const dvec3& direction) {
  static constexpr std::array<dvec3, 3> plan_up = {dvec3(0, 0, 1), dvec3(0, 0, -1), dvec3(0, 1, 0)};
  const int axis = session.up_axis();
  dvec3 up(0);
  up[axis] = 1;
  const double along = direction[axis];
  if (std::abs(along) > 0.999) up = (along > 0 ? 1.0 : -1.0) * plan_up[static_cast<std::size_t>(axis)];
  look_along(session.scene.camera, -direction, up);
}

void Steering::move(double seconds, Session* session, const Taken& taken) {
  if (!session || !is_flying || taken.event) return;
  const auto axis = [&](int positive, int negative) {
    return (is_down(positive) ? 1.0 : 0.0) - (is_down(negative) ? 1.0 : 0.0);
  };
  const double moved = std::min(seconds, 0.1);
  const dvec3 direction(axis('D', 'A'), axis('E', 'Q'), axis('W', 'S'));
  const double yaw = axis(key::right, key::left), pitch = axis(key::up, key::down);
  if (direction == dvec3(0) && yaw == 0 && pitch == 0) return;
  moved_seconds_ = 0;
  const double faster = has_shift() ? 4 : 1;
  fly(session->scene.camera, faster * fly_speed * moved * extent_of(*session) * direction, turn_speed * moved * yaw,
      turn_speed * moved * pitch);
}

bool Steering::is_moving() const { return moved_seconds_ < burst_seconds; }

bool Steering::flies_on() const { return is_flying && std::ranges::any_of(keys_, std::identity()); }

// Whether the scene is in the middle of a change.
bool Steering::is_held(const Session& session, const Taken& taken) const {
  return taken.scene || std::ranges::any_of(buttons_, std::identity()) || session.is_reading();
}

void Steering::remember(Session& session, const Taken& taken) const {
  if (!is_held(session, taken) && !is_moving()) session.remember();
}

void Steering::undo(Session& session, const Taken& taken) {
  if (is_held(session, taken)) return;
  session.undo();
  moved_seconds_ = burst_seconds;
}

void Steering::redo(Session& session, const Taken& taken) {
  if (is_held(session, taken)) return;
  session.redo();
  moved_seconds_ = burst_seconds;
}

}  // namespace splatvol
