// Slices and clip planes: their part of the panel, and handles in the picture that move and turn them.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "base/math.h"
#include "scene/scene.h"
#include "viewer/overlay.h"

namespace splatvol {

/// Holds which plane is selected, and which handle is held. Draws with Dear ImGui.
class SliceControls {
 public:
  /// Draws the planes' part of the panel, and changes the scene. `bounds`: of the data.
  void draw_panel(Scene& scene, const View& view, const Box& bounds);

  /// Adds a slice through the point that the camera turns about, or else through the middle of the data. It lies across
  /// the axis that is nearest to the line of sight.
  void add_slice(Scene& scene, const View& view, const Box& bounds);

  /// Draws the selected plane's outline and handles over the picture. `pointer`: in the window.
  void draw_handles(const Scene& scene, const View& view, const Box& bounds, const PictureArea& area,
                    const dvec2& pointer) const;

  /// Takes the handle under the pointer. Returns false if there is none: then the drag is the camera's.
  [[nodiscard]] bool grab(const Scene& scene, const View& view, const PictureArea& area, const dvec2& pointer);

  /// Moves or turns the plane whose handle is held. `moved`: of the pointer, since the last call.
  void drag(Scene& scene, const View& view, const PictureArea& area, const dvec2& moved);

  void release() { held_.reset(); }
  [[nodiscard]] bool is_held() const { return held_.has_value(); }

  /// Returns the selected plane; none: none is selected.
  [[nodiscard]] std::optional<Plane> plane(const Scene& scene) const;

  /// Selects no plane: for another scene.
  void reset() { selected_.reset(), held_.reset(); }

 private:
  // A slice or a clip plane of the scene, by its number.
  struct Selection {
    bool is_slice;
    std::size_t index;

    [[nodiscard]] bool operator==(const Selection&) const = default;
  };
  enum class Handle { point, tip };  // moves the plane along its normal; turns it

  struct Selected {
    dvec3* point;
    dvec3* normal;
  };
  [[nodiscard]] std::optional<Selected> selected(Scene& scene) const;
  [[nodiscard]] std::optional<Handle> handle_at(const Scene& scene, const View& view, const PictureArea& area,
                                                const dvec2& pointer) const;
  bool draw_row(const Selection& which, bool& shown);
  void draw_selected(Scene& scene, const View& view, const Box& bounds);
  void draw_add_buttons(Scene& scene, const View& view, const Box& bounds);

  std::optional<Selection> selected_;
  std::optional<Handle> held_;
};

}  // namespace splatvol
