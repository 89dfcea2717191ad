// A dialog that asks for a file, within the window: it is recorded and replayed like all else.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "player/events.h"

namespace splatvol {

class FileDialog {
 public:
  /// Shows the dialog from the next `draw` on, with the folder of a file; `file` empty: the folder of the last time, or
  /// the working folder.
  void open(const std::string& file);

  [[nodiscard]] bool is_open() const { return is_open_; }

  /// Closes it when it is drawn next.
  void close() { is_closing_ = true; }

  /// Draws the dialog, if it is open. Returns the path, also that of a folder that is a mesh, or the address that the
  /// user has chosen in this frame.
  [[nodiscard]] std::optional<std::string> draw(const WindowResized& window, std::span<const std::string> recent);

 private:
  struct Entry {
    std::string name;
    bool is_folder;
    std::uint64_t bytes;
  };
  void enter(const std::string& folder);
  [[nodiscard]] std::optional<std::string> choose(const std::string& path);
  [[nodiscard]] std::optional<std::string> draw_entries();
  [[nodiscard]] std::optional<std::string> draw_recent(std::span<const std::string> recent);

  bool is_open_ = false;
  bool is_new_ = false;  // since the last frame
  bool is_closing_ = false;
  std::string folder_;
  bool is_mesh_ = false;  // the folder
  std::vector<Entry> entries_;
  std::string trouble_;  // why the folder cannot be listed
  std::array<char, 4096> typed_{};
};

}  // namespace splatvol
