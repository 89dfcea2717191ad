// What a line of sight shows: the one thing with the largest share of its light.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/math.h"
#include "renderer/surfaces/surface.h"
#include "scene/clipped_depths.h"
#include "scene/scene.h"

namespace splatvol {

struct Ray {
  dvec3 origin, direction;  // world units; of length 1

  [[nodiscard]] dvec3 at(double distance) const { return origin + distance * direction; }
  [[nodiscard]] bool operator==(const Ray&) const = default;
};

/// A ray, and how wide a pixel is along it.
struct Looking {
  Ray ray;
  double pixel = 0;  // width at distance 1, or everywhere if the view is `orthographic`; world units
  bool orthographic = false;

  [[nodiscard]] bool operator==(const Looking&) const = default;
};

/// Returns the line of sight through (x, y), pixels from the upper left corner.
[[nodiscard]] Looking looking_through(const View& view, double x, double y);

/// Returns a view along a ray: its depths are distances from the ray's origin. It has the clip region, and else nothing
/// that matters.
[[nodiscard]] View view_along(const Ray& ray, const ClipRegion& clip);

/// A value of an attribute. NaN: none.
struct PickedValue {
  std::string attribute;
  double value;
};

/// What a ray meets. All positions are in the clip region.
struct Pick {
  enum class Kind { volume, contour, slice, surface };

  Kind kind = Kind::volume;
  std::string name = {};                 // of what is hit; empty: the volume
  std::vector<PickedValue> values = {};  // at `position`; of a contour also that of what colours it
  dvec3 position{0};                     // of the volume: half of the light that it takes is lost up to there
  double opacity = 0;                    // of the ray, with all that is on it: [0, 1]

  /// The volume along the ray. Between two rows, values are linear; at a jump, two rows have one distance.
  struct Row {
    double distance;  // from the ray's origin, world units
    double value;     // NaN: no material
    double opacity;   // of the volume up to here
  };
  std::vector<Row> rows = {};
};

/// Something thin on a ray.
struct PickLayer {
  Pick::Kind kind;
  std::string name;
  double distance;  // from the ray's origin
  double opacity;
  std::vector<PickedValue> values;
};

/// The volume along a ray.
class VolumeOnRay {
 public:
  virtual ~VolumeOnRay() = default;

  /// Returns rows by their distances; none: the ray meets no volume.
  [[nodiscard]] virtual std::vector<Pick::Row> rows() const = 0;

  /// Returns the opacity up to a distance: [0, 1], not falling.
  [[nodiscard]] virtual double opacity_up_to(double distance) const = 0;

  /// Returns the value at a distance; NaN: none.
  [[nodiscard]] virtual PickedValue value_at(double distance) const = 0;

  /// The same where a slice shows it.
  [[nodiscard]] virtual PickedValue value_on(const Plane& /*slice*/, double distance) const {
    return value_at(distance);
  }
};

/// Returns what has the largest share of the light along a ray: one of `layers`, a slice or a surface of the scene, or
/// the volume if that has more. Each layer takes its opacity of the light that is left there. None if all together have
/// less than a thousandth. `surfaces`: those of the scene, with their triangles. A surface has the value that colours
/// it, linear in a triangle; else that of the volume, a little beside it if there is none at the place itself.
[[nodiscard]] std::optional<Pick> pick(const Ray& ray, const VolumeOnRay& volume, std::vector<PickLayer> layers,
                                       const Scene& scene, std::span<const Surface> surfaces, const ClipRegion& clip);

/// Returns how much of the light of a place reaches the ray's origin: what is in front of it takes the rest, as in
/// pick(). What is at the place does not hide it.
[[nodiscard]] double light_from(const Ray& ray, const VolumeOnRay& volume, std::vector<PickLayer> layers,
                                const Scene& scene, std::span<const Surface> surfaces, const ClipRegion& clip,
                                double distance);

}  // namespace splatvol
