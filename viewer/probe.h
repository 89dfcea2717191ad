// The values along a ray through the splats of a frame.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "base/math.h"
#include "scene/scene.h"
#include "splat/record.h"

namespace splatvol {

struct Ray {
  dvec3 origin, direction;  // world units; of length 1

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

/// What a ray meets.
struct Probe {
  double value;    // at `position`: the mean of the splats there, weighted by their densities
  dvec3 position;  // the ray has lost half of the light there that it loses in all
  double opacity;  // of the whole ray, [0, 1]

  /// Equally far from each other, from the first splat to the last.
  struct Sample {
    double distance;  // from the ray's origin, world units
    double value;     // NaN: no material
    double opacity;   // of the ray up to here
  };
  std::vector<Sample> samples;
};

/// Splats of a frame that rays can be followed through. Holds the frame's rows: they stay in memory.
class ProbedFrame {
 public:
  /// Looks at all splats once, for balls round some hundred neighbours each. `units`: of the splats.
  ProbedFrame(DrawList list, const DrawingUnits& units);

  /// Follows a ray. Splats, boundary planes, weights and the spread of values count as in the picture, besides what the
  /// rasterizers round; a splat of the kernel octant is a round Gaussian. Where octants are flat, the `opacity` of the
  /// picture tells how much all optical depths are to be scaled. None if the ray meets nothing visible.
  [[nodiscard]] std::optional<Probe> probe(const Transfer& transfer, const Looking& looking,
                                           std::optional<double> opacity = {}) const;

 private:
  // Consecutive splats of a range, and a ball that holds their material.
  struct Chunk {
    dvec3 center;
    double radius;  // world units
    std::uint32_t range, begin, count;
  };
  template <class Shape, class Reach>
  void add_chunks(std::uint32_t number, const std::vector<Shape>& shapes, const Reach& reach);

  DrawList list_;
  DrawingUnits units_;
  std::vector<Chunk> chunks_;
};

/// Returns the value where a ray meets the nearest slice of the view that has one there, without samples; none without
/// such a slice. `sliced`: FrameSplats::sliced.
[[nodiscard]] std::optional<Probe> probe_slices(const DrawList& sliced, const DrawingUnits& units, const View& view,
                                                const Ray& ray);

}  // namespace splatvol
