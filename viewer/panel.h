// The panel: what can be set, in sections.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "viewer/contour_section.h"
#include "viewer/line_section.h"
#include "viewer/measure_section.h"
#include "viewer/mesh_section.h"
#include "viewer/movie_section.h"
#include "viewer/path_section.h"
#include "viewer/save_section.h"
#include "viewer/slice_controls.h"
#include "viewer/state.h"
#include "viewer/streamline_controls.h"
#include "viewer/surface_section.h"
#include "viewer/transfer_editor.h"
#include "viewer/view_section.h"

namespace splatvol {

class Panel {
 public:
  explicit Panel(ViewerState& viewer)
      : save(viewer),
        path(viewer, save),
        movie(viewer, save, path),
        mesh(viewer, save),
        line(viewer, save),
        contours(viewer, save),
        measure(viewer),
        viewer_(viewer) {}

  struct Wishes {
    bool opens_dialog = false;
    std::optional<std::string> file = {};  // to be opened
    bool all_steps = false;                // of the mesh that is open: to be opened
  };

  /// Draws the panel, or the button that shows it.
  [[nodiscard]] Wishes draw();

  void add_presets(std::vector<NamedColorMap> maps) { editor_.add_presets(std::move(maps)); }

  /// Sets what another session begins with.
  void begin();

  /// Ends what plays, and what is to be saved.
  void end();

  /// Whether a control is held, or changes the scene from frame to frame.
  [[nodiscard]] bool holds_scene() const;

  /// Whether pictures are drawn for a file.
  [[nodiscard]] bool is_saving() const { return save.saving() || movie.filming(); }

  /// Whether jobs of sections are at work, of which they tell.
  [[nodiscard]] bool has_jobs() const {
    return mesh.is_saving() || contours.is_exporting() || contours.is_measuring() || measure.is_begun() ||
           line.has_jobs();
  }

  SaveSection save;
  PathSection path;
  MovieSection movie;
  MeshSection mesh;
  LineSection line;
  ContourSection contours;
  MeasureSection measure;
  SliceControls planes;
  StreamlineControls streamlines;

 private:
  void draw_history_buttons();
  [[nodiscard]] std::optional<std::string> draw_sections();
  void draw_transfer_section();
  void draw_opacity_controls();

  ViewerState& viewer_;
  TransferEditor editor_, opacity_editor_;
  DetailControls detail_;
  SurfaceSection surfaces_;
};

}  // namespace splatvol
