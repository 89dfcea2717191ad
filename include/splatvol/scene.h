// Scenes: camera, image, attribute and transfer function; read from a scene file (docs/scene.md).
#pragma once

#include <cmath>
#include <glm/geometric.hpp>
#include <optional>
#include <string>
#include <vector>

#include "splatvol/error.h"
#include "splatvol/export.h"
#include "splatvol/geometry.h"
#include "splatvol/streamlines.h"
#include "splatvol/transfer_function.h"

namespace splatvol {

struct Camera {
  enum class Projection { perspective, orthographic };

  Projection projection = Projection::perspective;
  double vertical_fov_degrees = 30;  // perspective: full angle, (0, 180)
  double parallel_height = 1;        // orthographic: world units from the image's lower to its upper edge, > 0
  dvec3 position{0};
  dvec3 focal_point{0};
  dvec3 up{0, 1, 0};

  [[nodiscard]] bool operator==(const Camera&) const = default;
};

/// A light at the eye. It multiplies colours by ambient + diffuse |cos a|, where a is the angle between the ray and the
/// value's gradient, and by ambient + diffuse where there is no gradient.
struct Lighting {
  double ambient = 0.3;
  double diffuse = 0.7;

  /// Returns the factor, for vectors of length 1 along the ray and the gradient (0: none).
  [[nodiscard]] double factor(dvec3 ray, dvec3 gradient) const {
    return ambient + diffuse * (gradient == dvec3(0) ? 1 : std::abs(glm::dot(ray, gradient)));
  }

  [[nodiscard]] bool operator==(const Lighting&) const = default;
};

/// How a scalar bar is labelled.
struct ScalarBar {
  int ticks = 5;     // at most about so many, 2 to 20
  std::string unit;  // in place of the attribute's; empty: the attribute's

  [[nodiscard]] bool operator==(const ScalarBar&) const = default;
};

/// A plane that shows the values on it, by the colours of the transfer function.
struct SceneSlice {
  dvec3 point{0};         // of the plane
  dvec3 normal{1, 0, 0};  // any length but 0
  double opacity = 1;     // [0, 1]; 1 hides what lies behind
  bool shown = true;

  [[nodiscard]] bool operator==(const SceneSlice&) const = default;
};

/// A plane that cuts off all behind it. The side to which the normal points stays.
struct SceneClipPlane {
  dvec3 point{0};         // of the plane
  dvec3 normal{1, 0, 0};  // any length but 0
  bool active = true;     // else it cuts nothing off

  [[nodiscard]] bool operator==(const SceneClipPlane&) const = default;
};

/// A factor on the extinction by the values of another attribute: colour by one, opacity by the other. Points without a
/// value of it are not drawn.
struct SceneOpacity {
  std::string attribute;
  TransferFunction function;  // its `densities` are the factors, 0 to 1, without unit; its colours are not used

  [[nodiscard]] bool operator==(const SceneOpacity&) const = default;
};

/// Colours by the values of an attribute.
struct SceneColoring {
  std::string attribute;
  TransferFunction function;  // its densities are not used

  [[nodiscard]] bool operator==(const SceneColoring&) const = default;
};

/// How triangles of a patch on the near side are drawn. Their outside, where no cell is, faces the eye.
enum class NearSide {
  shown,        // as all others
  translucent,  // with a quarter of the surface's opacity
  hidden,
};

/// A surface of triangles: from a file, or a part of the boundary that the .svol file holds.
struct SceneSurface {
  std::string file = {};  // .stl, .obj, .ply, .gltf, .glb, .vtp or .vtk; positions in the data's world units
  dvec3 color{0.8};       // linear
  double opacity = 1;     // [0, 1]; 1 hides what lies behind
  bool shown = true;      // else the triangles are not read
  bool edges = false;     // the triangles' edges are drawn

  /// Instead of `file`: a patch of the boundary, by its name. `*` stands for any characters, so that one surface may
  /// be several patches.
  std::string boundary = {};

  /// Instead of `color`: the values of the file's cells at the triangles' corners, linear in between. Where cells have
  /// one value each, a triangle has that in its middle. `color` is shown where no cell has one. The file must keep
  /// cells.
  std::optional<SceneColoring> color_by = {};

  /// Of patches: files of surfaces do not tell where cells are, and are always shown. So are triangles with cells on
  /// both sides.
  NearSide near_side = NearSide::shown;

  [[nodiscard]] bool operator==(const SceneSurface&) const = default;
};

/// Surfaces on which the scene's attribute has one value, in the mesh's own cells. They are lit.
struct SceneContour {
  std::vector<double> values;                  // of one surface each
  std::optional<dvec3> color = {};             // linear; none: that of the transfer function
  std::optional<SceneColoring> color_by = {};  // instead of `color`; the same in all contours of a scene
  double opacity = 1;                          // [0, 1]; 1 hides what lies behind
  bool shown = true;

  [[nodiscard]] bool operator==(const SceneContour&) const = default;
};

/// Tubes round streamlines (StreamlineRequest), in the mesh's own cells. They are opaque, and lit as surfaces are.
struct SceneStreamlines {
  std::string vector;
  Seeds seeds = SeedLine{};
  StreamlineDirection direction = StreamlineDirection::both;
  std::optional<double> max_length = {};
  std::size_t max_steps = 10'000;
  double radius = 1;                           // of the tubes, in world units, > 0
  dvec3 color{0.8};                            // linear
  std::optional<SceneColoring> color_by = {};  // instead of `color`: the values of the cells on the lines
  bool shown = true;

  [[nodiscard]] bool operator==(const SceneStreamlines&) const = default;
};

struct Scene {
  [[nodiscard]] bool operator==(const Scene&) const = default;

  Camera camera;
  int width = 512;
  int height = 512;
  dvec3 background{0};  // linear
  std::string attribute;
  TransferFunction transfer_function;
  std::optional<Lighting> lighting;
  std::optional<Box> clip_box;  // only the inside is drawn
  bool outline = false;         // the edges of the domain's box are drawn over and behind the volume
  std::vector<SceneSurface> surfaces = {};
  ScalarBar scalar_bar = {};
  std::vector<SceneSlice> slices = {};
  std::vector<SceneClipPlane> clip_planes = {};
  std::optional<SceneOpacity> opacity = {};
  std::vector<SceneContour> contours = {};
  std::vector<SceneStreamlines> streamlines = {};
};

/// Reads a scene from JSON text. The error names the field that is missing or out of range.
[[nodiscard]] SPLATVOL_EXPORT Result<Scene> parse_scene(const std::string& json);

/// Reads a scene file. The error begins with the path. Files of surfaces get absolute paths: relative ones begin at the
/// scene file's folder.
[[nodiscard]] SPLATVOL_EXPORT Result<Scene> load_scene(const std::string& path);

/// Returns the text of a scene file that parse_scene reads back as `scene`.
[[nodiscard]] SPLATVOL_EXPORT std::string scene_to_json(const Scene& scene);

}  // namespace splatvol
