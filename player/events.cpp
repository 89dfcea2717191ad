#include "player/events.h"

#include <cerrno>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>

#include "base/json.h"

namespace splatvol {
namespace {

using nlohmann::json;

json to_json(const PointerMoved& e) { return {"pointer", e.x, e.y}; }
json to_json(const ButtonChanged& e) { return {"button", e.button, e.down}; }
json to_json(const Scrolled& e) { return {"scroll", e.x, e.y}; }
json to_json(const KeyChanged& e) { return {"key", e.code, e.down}; }
json to_json(const TextTyped& e) { return {"text", e.character}; }
json to_json(const WindowResized& e) {
  return {"size", e.width, e.height, e.pixel_width, e.pixel_height, e.content_scale};
}
json to_json(const FilesDropped& e) { return {"drop", e.paths}; }

constexpr int largest_side = 16384;

// Returns a number within the range of its type. Throws an exception if it is none.
template <class Integer>
Integer whole(const json& number) {
  const auto value = number.get<double>();
  constexpr auto least = std::numeric_limits<Integer>::min(), largest = std::numeric_limits<Integer>::max();
  if (!(value >= least && value <= largest)) throw std::out_of_range("a number out of range");
  return static_cast<Integer>(value);
}

// Throws an exception if `e` has another form.
Result<Event> event_of(const json& e) {
  const std::string kind = e.at(0);
  const auto number = [&](std::size_t i) { return e.at(i).get<double>(); };
  if (kind == "pointer") return PointerMoved{number(1), number(2)};
  if (kind == "button") return ButtonChanged{whole<int>(e.at(1)), e.at(2)};
  if (kind == "scroll") return Scrolled{number(1), number(2)};
  if (kind == "key") {
    const KeyChanged event{whole<int>(e.at(1)), e.at(2)};
    if (event.code < 0 || event.code >= key::count) return fail(ErrorCode::invalid_data, "no such key: {}", event.code);
    return event;
  }
  if (kind == "text") return TextTyped{whole<std::uint32_t>(e.at(1))};
  if (kind == "drop") return FilesDropped{e.at(1)};
  if (kind == "size") {
    const WindowResized event{whole<int>(e.at(1)), whole<int>(e.at(2)), whole<int>(e.at(3)), whole<int>(e.at(4)),
                              number(5)};
    for (const int side : {event.width, event.height, event.pixel_width, event.pixel_height})
      if (side < 0 || side > largest_side) return fail(ErrorCode::invalid_data, "impossible size");
    if (!(event.content_scale >= 0.25 && event.content_scale <= 16))
      return fail(ErrorCode::invalid_data, "impossible scale");
    return event;
  }
  return fail(ErrorCode::invalid_data, "no such event: '{}'", kind);
}

Result<FrameInput> parse_line(const std::string& line) {
  try {
    const json document = parse_json(line);
    FrameInput input;
    input.seconds = document.at("seconds");
    if (!(input.seconds >= 0)) return fail(ErrorCode::invalid_data, "negative time");
    for (const json& item : document.at("events")) {
      SPLATVOL_TRY_ASSIGN(event, event_of(item));
      input.events.push_back(std::move(event));
    }
    return input;
  } catch (const std::exception& error) {
    return fail(ErrorCode::invalid_data, "not a frame of a recording ({})", error.what());
  }
}

// What the events of a frame have done so far.
struct FrameChanges {
  bool moved = false, button = false, text = false, command = false;
  std::map<int, bool> keys;

  // GLFW's codes of keys that type a character are below 256.
  static bool is_command(int code) { return code >= 256; }

  [[nodiscard]] bool allow(const Event& event) const {
    if (button) return false;
    if (const auto* changed = std::get_if<KeyChanged>(&event)) {
      const auto before = keys.find(changed->code);
      return (before == keys.end() || before->second == changed->down) && !(text && is_command(changed->code));
    }
    if (std::holds_alternative<TextTyped>(event)) return !command;
    return !moved || !(std::holds_alternative<ButtonChanged>(event) || std::holds_alternative<Scrolled>(event));
  }

  void add(const Event& event) {
    moved |= std::holds_alternative<PointerMoved>(event);
    button |= std::holds_alternative<ButtonChanged>(event);
    text |= std::holds_alternative<TextTyped>(event);
    if (const auto* changed = std::get_if<KeyChanged>(&event)) {
      keys[changed->code] = changed->down;
      command |= is_command(changed->code);
    }
  }
};

}  // namespace

int key_by_name(int code, std::string_view name) {
  const char c = name.size() == 1 ? name[0] : '\0';
  if (c >= 'a' && c <= 'z') return 'A' + (c - 'a');
  return c >= 'A' && c <= 'Z' ? c : code;
}

std::vector<Event> EventQueue::take_frame() {
  std::vector<Event> taken;
  for (FrameChanges changes; !events_.empty() && changes.allow(events_.front()); events_.pop_front()) {
    changes.add(events_.front());
    taken.push_back(std::move(events_.front()));
  }
  return taken;
}

std::string to_line(const FrameInput& input) {
  json events = json::array();
  for (const Event& event : input.events) events.push_back(std::visit([](const auto& e) { return to_json(e); }, event));
  return json_text(json{{"seconds", input.seconds}, {"events", events}}) + "\n";
}

Result<RecordingFile> RecordingFile::create(const std::string& path) {
  RecordingFile recording(path);
  if (!recording.file_) return fail(ErrorCode::io, "{}: cannot be written: {}", path, std::strerror(errno));
  return recording;
}

Status RecordingFile::add(const FrameInput& input) {
  file_ << to_line(input) << std::flush;
  return file_ ? Status{} : fail(ErrorCode::io, "{}: cannot be written: {}", path_, std::strerror(errno));
}

Result<std::vector<FrameInput>> load_recording(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(text, read_text_file(path));
  std::istringstream lines(text);
  std::vector<FrameInput> frames;
  for (std::string line; std::getline(lines, line);) {
    auto frame = parse_line(line);
    const bool is_cut_off = lines.eof();
    if (!frame && is_cut_off && !frames.empty()) break;
    if (!frame) return fail(frame.error().code, "{}:{}: {}", path, frames.size() + 1, frame.error().message);
    frames.push_back(std::move(*frame));
  }
  if (frames.empty()) return fail(ErrorCode::invalid_data, "{}: an empty recording", path);
  return frames;
}

}  // namespace splatvol
