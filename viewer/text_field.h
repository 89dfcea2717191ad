// A line of text that Dear ImGui edits.
#pragma once

#include <array>
#include <string>

namespace splatvol {

class TextField {
 public:
  /// Sets the text, cut off where there is no room.
  void set(const std::string& text) { text_[text.copy(text_.data(), text_.size() - 1)] = 0; }
  [[nodiscard]] const char* text() const { return text_.data(); }

  void draw(const char* name);

 private:
  std::array<char, 512> text_{};
};

}  // namespace splatvol
