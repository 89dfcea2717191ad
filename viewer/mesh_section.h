// The panel's part "mesh": the file that a mesh became.
#pragma once

#include <string>

#include "player/session_host.h"
#include "viewer/save_section.h"
#include "viewer/state.h"

namespace splatvol {

class MeshSection {
 public:
  MeshSection(ViewerState& viewer, SaveSection& save) : viewer_(viewer), save_(save) {}

  /// Draws the controls of a session that shows a mesh. Returns whether all of its steps are to be opened.
  [[nodiscard]] bool draw();

  /// Tells of a copy that is being written, and of its end.
  void draw_progress();

  /// Whether a copy is being written.
  [[nodiscard]] bool is_saving() const { return copied_.is_begun(); }

  /// Sets the name of the copy, without its ending.
  void begin(const std::string& stem) { name_.set(stem + ".svol"); }

 private:
  void save_copy(const std::string& path);
  void forget();

  ViewerState& viewer_;
  SaveSection& save_;
  TextField name_;
  std::string copy_;  // the path of the one that is being written
  Task<Status> copied_;
};

}  // namespace splatvol
