// What the window tells: toasts over the picture, and a list of all messages so far. Drawn with Dear ImGui.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/error.h"
#include "viewer/overlay.h"

namespace splatvol {

/// A note has a toast for some seconds, an error until it is closed. Equal messages are one, with a count. A question
/// is a note with buttons; the next one takes its place. Time is that of frames.
class Messages {
 public:
  static constexpr double note_seconds = 6;

  struct Message {
    std::string text;
    bool is_error = false;
    int times = 0;                          // that it was told
    std::uint64_t number = 0;               // take_number() of the last time
    double seconds_left = 0;                // of the toast of a note
    std::vector<std::string> buttons = {};  // of a question
  };

  void note(const std::string& text) { add(text, false); }
  void error(const std::string& text) { add(text, true); }
  void ask(const std::string& text, std::vector<std::string> buttons);
  void end_question();

  /// Tells the error of what was tried, or else a note that it is done.
  void tell(const Status& tried, const std::string& done);

  /// Work in progress, or a question. Its toast is there in each frame that draws it.
  struct Work {
    std::string name;  // unlike that of other work
    std::string text;
    std::vector<std::string> buttons = {};
    std::optional<double> share = {};         // that is done, from 0 to 1; none: not known
    std::optional<double> seconds_left = {};  // none: not known
  };

  /// Begins the toasts of a frame, at the lower left. They leave the axes free, if there are any, what is above `top`,
  /// and most of the picture. One toast is shown in any case.
  void begin(const PictureArea& area, bool has_axes, float top);

  /// Draws the toast of work. Returns the number of the button that is pressed.
  [[nodiscard]] std::optional<std::size_t> draw(const Work& work);

  /// Draws the toasts of messages above that, and the list if it is open. Returns the number of the button of the
  /// question that is pressed.
  [[nodiscard]] std::optional<std::size_t> draw();

  /// Opens the list, in place of the toasts, or closes it.
  void toggle_list();
  [[nodiscard]] bool is_list_open() const { return is_list_open_; }

  /// Lets time pass for the toasts of notes.
  void advance(double seconds);

  /// Lets no time pass from now on.
  void hold() { is_held_ = true; }

  /// Returns the seconds until the next toast ends by itself. None: there is no note.
  [[nodiscard]] std::optional<double> seconds_to_change() const;

  /// Returns whether a toast has come or gone since the last call.
  [[nodiscard]] bool take_change() { return std::exchange(has_changed_, false); }

  /// Returns a number that is larger than those before: the order in which things begin.
  [[nodiscard]] std::uint64_t take_number() { return ++last_number_; }

  /// Returns the number of the newest error that has a toast; 0: there is none.
  [[nodiscard]] std::uint64_t newest_error() const;

  /// Closes the toast of a message.
  void close(std::uint64_t number);

  /// Return the messages with a toast, and all messages; the newest last.
  [[nodiscard]] std::vector<Message> toasts() const { return copies_of(toasts_); }
  [[nodiscard]] std::vector<Message> all() const { return copies_of(all_); }

 private:
  using ByNumber = std::map<std::uint64_t, Message*>;
  struct Layout;

  Message& add(const std::string& text, bool is_error);
  [[nodiscard]] Layout lay_out(const Work& work) const;
  std::optional<std::size_t> draw(const Work& work, unsigned color);
  void draw_list();
  [[nodiscard]] static std::vector<Message> copies_of(const ByNumber& messages);

  std::map<std::string, Message> messages_;  // by their text
  ByNumber all_, toasts_;
  std::uint64_t last_number_ = 0;
  bool is_list_open_ = false, is_held_ = false, has_changed_ = false;

  // Of the frame that is drawn.
  PictureArea area_;
  float bottom_ = 0, top_ = 0;  // of the room that is left
  bool has_toast_ = false;
};

}  // namespace splatvol
