// The panel's list of surfaces.
#pragma once

#include <cstddef>
#include <optional>

#include "viewer/state.h"

namespace splatvol {

/// Shows the scene's surfaces and the patches of the file's boundary, and what the selected surface looks like; without
/// a selected one, what all surfaces that are shown look like.
class SurfaceSection {
 public:
  void draw(Session& session);

 private:
  struct Row;
  void draw_row(Session& session, const Row& row);
  void draw_style(Session& session);

  std::optional<std::size_t> selected_;  // of the scene's surfaces
};

}  // namespace splatvol
