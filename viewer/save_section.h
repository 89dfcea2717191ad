// The panel's part "save": scenes, pictures and commands.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <string>

#include "pictures/page.h"
#include "viewer/state.h"

namespace splatvol {

/// A line of text that is edited.
class TextField {
 public:
  /// Sets the text, cut off where there is no room.
  void set(const std::string& text) { text_[text.copy(text_.data(), text_.size() - 1)] = 0; }
  [[nodiscard]] const char* text() const { return text_.data(); }
  void draw(const char* name);

 private:
  std::array<char, 512> text_{};
};

/// Writes files of the session's scene and picture, and asks before it replaces one.
class SaveSection {
 public:
  explicit SaveSection(ViewerState& viewer) : viewer_(viewer) {}

  /// Draws the controls. Returns the path of a scene or of colours that is to be opened.
  [[nodiscard]] std::optional<std::string> draw();

  /// Draws the question whether a file is to be replaced, if there is one.
  void draw_question();

  /// Keeps the file that the question is about.
  [[nodiscard]] bool is_asking() const { return question_.has_value(); }
  void keep_file() { question_->is_kept = true; }

  /// Copies a command that shows the same.
  void copy_command();

  /// Calls `write` unless the file is there and the user keeps it.
  void save(const std::string& path, std::function<void()> write);
  void save_json(const std::string& path, const std::string& text);

  /// The words of a file, and the size that they leave to its picture.
  struct Layout {
    Page page;
    PageText text;
    bool is_transparent;
  };

  /// Returns the layout of pictures and movies. None if it is impossible, which a message tells.
  [[nodiscard]] std::optional<Layout> layout(const std::string& path);

  /// Writes the session's picture, with its words.
  [[nodiscard]] Status write_picture(const std::string& path, const Layout& layout) const;

  /// A picture that is drawn to be saved.
  struct Saving {
    std::string path;
    Layout layout;
    bool is_copied = false;  // to the clipboard, and then removed
  };
  [[nodiscard]] const std::optional<Saving>& saving() const { return saving_; }

  /// Writes it once it is as fine as it gets.
  void save_drawn_picture();

  /// Sets the names of the files, without their endings. Forgets what is to be saved.
  void begin(const std::string& stem);
  void end() { question_.reset(), saving_.reset(); }

 private:
  // A file that is there, while the user is asked.
  struct Question {
    std::string path;
    std::function<void()> write;
    bool is_kept = false;  // by Esc
  };
  void draw_picture_controls();
  void draw_scalar_bar_controls();
  void save_picture();
  void copy_picture();
  [[nodiscard]] Result<Layout> lay_out(const std::string& path) const;

  ViewerState& viewer_;
  TextField scene_name_, picture_name_, title_;
  bool saves_bar_ = false, saves_time_ = false, saves_transparent_ = false, saves_as_shown_ = true;
  std::array<int, 2> saved_size_ = {1920, 1080};
  std::optional<Question> question_;
  std::optional<Saving> saving_;
};

}  // namespace splatvol
