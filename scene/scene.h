// Cameras of scenes (splatvol/scene.h), and their axes.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "scene/drawing.h"
#include "scene/transfer_function.h"
#include "splatvol/scene.h"

namespace splatvol {

class JsonField;

/// Reads or writes the object `camera` of a scene file. Also reads cameras that make_view refuses.
[[nodiscard]] Result<Camera> read_camera(const JsonField& json);
[[nodiscard]] std::string camera_to_json(const Camera& camera);

/// How a scene is used. Its file may tell it: the volume, and how the volume is drawn.
struct SceneUse {
  std::string file = {};                 // path or address of the volume, or of its mesh; empty: not told
  std::vector<std::string> pieces = {};  // paths of the mesh's other files
  std::optional<std::size_t> step = {};  // of a time series
  Quality quality = {};                  // without milliseconds: a scene shows the same on every machine
  Drawing drawing = {};

  [[nodiscard]] bool operator==(const SceneUse&) const = default;
};

struct UsedScene {
  Scene scene;
  SceneUse use;
};

/// As parse_scene, load_scene and scene_to_json. A path is absolute after loading, as those of surfaces are.
/// load_used_scene also takes the text of a scene file in place of its path. `indent` -1: the text is one line.
[[nodiscard]] Result<UsedScene> parse_used_scene(const std::string& json);
[[nodiscard]] Result<UsedScene> load_used_scene(const std::string& path_or_json);
[[nodiscard]] std::string to_json(const UsedScene& used, int indent = 1);

/// Returns the functions of a scene. They belong to the scene.
[[nodiscard]] inline Transfer transfer_of(const Scene& scene) {
  return {scene.transfer_function, scene.opacity ? &scene.opacity->function : nullptr};
}

/// Returns the name of a scene's opacity attribute; empty: it has none.
[[nodiscard]] inline std::string opacity_attribute_of(const Scene& scene) {
  return scene.opacity ? scene.opacity->attribute : "";
}

/// A surface on which the scene's attribute has one value.
struct Contour {
  double value;
  dvec3 color;              // linear
  double opacity;           // (0, 1]
  bool is_colored = false;  // by Contours::colors, instead of `color`

  [[nodiscard]] bool operator==(const Contour&) const = default;
};

/// The contours of a scene that are shown, by their values, of which no two are equal.
struct Contours {
  std::vector<Contour> surfaces;
  std::string attribute = {};    // whose values colour some of them; empty: none
  TransferFunction colors = {};  // of these values
  Lighting lighting = {};        // the scene's, or the default: a contour is always lit

  [[nodiscard]] bool operator==(const Contours&) const = default;
};

/// The most values of a scene's contours: each costs time in every cell.
inline constexpr std::size_t most_contour_values = 256;

/// Whether one of the contours has a value.
[[nodiscard]] bool have_value(std::span<const SceneContour> contours, double value);

/// Fails if contours have too many values, equal ones, one that is not finite, or differ in what colours them.
[[nodiscard]] Status check_contours(const std::vector<SceneContour>& contours);

/// Returns the contours of a scene that are shown and not wholly transparent. Requires check_contours.
[[nodiscard]] Contours contours_of(const Scene& scene);

/// What a scalar bar tells: an attribute by whose values something is coloured, and the function without densities.
struct BarColors {
  std::string attribute;
  TransferFunction function;
};

/// Returns what colours the picture of a scene, each once: first the volume, with slices and contours that have its
/// colours, then other contours, surfaces and streamlines. That of the volume if nothing is coloured by values.
[[nodiscard]] std::vector<BarColors> bar_colors_of(const Scene& scene);

/// A plane in world units.
struct Plane {
  dvec3 point;
  dvec3 normal;  // of length 1

  /// Returns the distance of a position from the plane, positive on the side of the normal.
  [[nodiscard]] double distance(const dvec3& position) const { return glm::dot(normal, position - point); }

  [[nodiscard]] bool operator==(const Plane&) const = default;
};

/// Returns the plane through a point. Requires finite numbers and a normal that is not 0.
[[nodiscard]] Plane make_plane(const dvec3& point, const dvec3& normal);

/// The part of space that is drawn: the inside of a box, and the sides of planes to which their normals point.
struct ClipRegion {
  std::optional<Box> box;
  std::vector<Plane> planes;

  [[nodiscard]] bool is_all() const { return !box && planes.empty(); }

  /// Whether a position is inside, or at most `margin` outside.
  [[nodiscard]] bool contains(const dvec3& position, double margin = 0) const;

  /// Whether all of a box is outside; never wrongly true.
  [[nodiscard]] bool excludes(const Box& other) const;

  [[nodiscard]] bool operator==(const ClipRegion&) const = default;
};

/// Most slices of a view.
inline constexpr std::size_t most_slices = 64;

/// A slice of the scene.
struct Slice {
  Plane plane;
  double opacity;  // (0, 1]

  [[nodiscard]] bool operator==(const Slice&) const = default;
};

/// The camera as axes. View coordinates are x to the right, y up, z forwards, in world units, the eye at the origin.
///
/// A view point (x, y, z) appears at pixels (f x / z + W / 2, f y / z + H / 2) in perspective and (f x + W / 2,
/// f y + H / 2) in orthographic projection, counted from the lower left corner; pixel centres lie at halves.
struct View {
  dvec3 eye;
  dvec3 right, up, forward;  // orthonormal
  double focal = 1;          // f: pixels (perspective), or pixels per world unit (orthographic)
  bool orthographic = false;
  int width = 0;
  int height = 0;
  ClipRegion clip;            // of the scene, and
  std::vector<Slice> slices;  // those that are shown; make_view(Camera) sets none

  [[nodiscard]] dvec3 to_view(dvec3 world) const {
    const dvec3 d = world - eye;
    return {glm::dot(d, right), glm::dot(d, up), glm::dot(d, forward)};
  }

  [[nodiscard]] bool operator==(const View&) const = default;
};

/// Returns the octant (x + 2 y + 4 z) of a node that is in front. Descending in i, the octants i ^ nearest_octant are
/// back to front: an octant that differs from the nearest on more axes is farther away.
[[nodiscard]] unsigned nearest_octant(const View& view, const Cube& node);

/// Fails if the camera's axes are degenerate: the position equals the focal point, or up lies along the line of sight.
[[nodiscard]] Result<View> make_view(const Camera& camera, int width, int height);

/// Returns the view of the scene's camera, with its clip box, active clip planes, and slices that are shown. Fails if
/// check_contours does, and if more than 64 slices are shown.
[[nodiscard]] Result<View> make_view(const Scene& scene);

}  // namespace splatvol
