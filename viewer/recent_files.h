// The files that were opened last, in this program and before.
#pragma once

#include <string>
#include <vector>

namespace splatvol {

/// Returns where a user's list is kept: in $XDG_STATE_HOME, or ~/.local/state. Empty if neither is known.
[[nodiscard]] std::string usual_recent_files_path();

/// A list of paths and addresses in a JSON file, the newest first. A list that cannot be read is empty; one that cannot
/// be written is kept in memory: no picture depends on it.
class RecentFiles {
 public:
  /// Reads the list; `path` empty: it is kept in memory only.
  explicit RecentFiles(std::string path);

  /// Puts a file first, and writes the list. Paths become absolute. Addresses with a user's name, a password or a query
  /// are left out: they may hold secrets.
  void add(const std::string& file);

  [[nodiscard]] const std::vector<std::string>& paths() const { return paths_; }

 private:
  std::string path_;
  std::vector<std::string> paths_;
};

}  // namespace splatvol
