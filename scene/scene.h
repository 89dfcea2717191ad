// Scenes: camera, image, attribute and transfer function; read from a scene file.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "scene/transfer_function.h"

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

struct Scene {
  Camera camera;
  int width = 512;
  int height = 512;
  dvec3 background{0};  // linear
  std::string attribute;
  TransferFunction transfer_function;
  std::optional<Lighting> lighting;
  std::optional<Box> clip_box;  // only the inside is drawn
  bool outline = false;         // the edges of the domain's box are drawn over and behind the volume
};

/// Reads a scene from JSON text. The error names the field that is missing or out of range.
[[nodiscard]] Result<Scene> parse_scene(const std::string& json);

/// Reads a scene file. The error begins with the path.
[[nodiscard]] Result<Scene> load_scene(const std::string& path);

/// Returns the text of a scene file that parse_scene reads back as `scene`.
[[nodiscard]] std::string scene_to_json(const Scene& scene);

/// Reads or writes the object `camera` of a scene file. parse_camera fails if make_view would.
[[nodiscard]] Result<Camera> parse_camera(const std::string& json);
[[nodiscard]] std::string camera_to_json(const Camera& camera);

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
  std::optional<Box> clip_box;  // of the scene; make_view(Camera) sets none

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

/// Returns the view of the scene's camera, with the scene's clip box.
[[nodiscard]] Result<View> make_view(const Scene& scene);

}  // namespace splatvol
