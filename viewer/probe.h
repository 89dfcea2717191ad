// The values along a ray through the splats of a frame.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/math.h"
#include "format/steps.h"
#include "renderer/surfaces/surface.h"
#include "sampler/cell_tetrahedra.h"
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
  double
      value;  // at `position`: the mean of the splats there, weighted by their densities; or the mesh's own; NaN: none
  dvec3 position;  // the ray has lost half of the light there that the volume takes; or that of a surface
  double opacity;  // of the whole ray, [0, 1]

  /// Equally far from each other, from the first splat to the last.
  struct Sample {
    double distance;  // from the ray's origin, world units
    double value;     // NaN: no material
    double opacity;   // of the ray up to here
  };
  std::vector<Sample> samples;

  std::string surface = {};  // the name of the one at `position`; empty: the volume or a slice
};

/// Splats of a frame that rays can be followed through. Holds the frame's rows: they stay in memory.
class ProbedFrame {
 public:
  /// Looks at all splats once, for balls round some hundred neighbours each. `units`: of the splats.
  ProbedFrame(DrawList list, const DrawingUnits& units);

  /// Follows a ray. Splats, boundary planes and the spread of values count as in the picture, besides what the
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

/// The cells of a step, to read values of an attribute off them.
class ProbedCells {
 public:
  /// Returns null if the file keeps no cells or has some of a shape that this program does not know, and if it is far:
  /// then probes do not wait for a server. Holds up to 16 MiB of the file.
  [[nodiscard]] static Result<std::shared_ptr<const ProbedCells>> open(const format::Steps& steps, std::size_t step,
                                                                       const std::string& attribute);

  /// Replaces the values of a probe by those of the cells, also in the samples. Where no cell is, the value at the
  /// position stays, and a sample has none. On a surface, the nearest cell on either side counts. If the cells cannot
  /// be read, all values stay.
  void take_values(const Ray& ray, Probe& probe) const;

 private:
  ProbedCells(std::shared_ptr<const format::Volume> volume, std::unique_ptr<const CellTetrahedra> cells)
      : volume_(std::move(volume)), cells_(std::move(cells)) {}

  std::shared_ptr<const format::Volume> volume_;
  std::unique_ptr<const CellTetrahedra> cells_;
};

/// Returns a probe of the surface that has the largest share of the light along a ray, if one has more than the volume:
/// without a value. Else returns `volume`: the probe of the volume; none: the ray meets nothing of it.
[[nodiscard]] std::optional<Probe> with_surfaces(std::optional<Probe> volume, std::span<const Surface> surfaces,
                                                 const View& view, const Ray& ray);

/// Returns the value where a ray meets the nearest slice of the view that has one there, without samples; none without
/// such a slice. `sliced`: FrameSplats::sliced.
[[nodiscard]] std::optional<Probe> probe_slices(const DrawList& sliced, const DrawingUnits& units, const View& view,
                                                const Ray& ray);

}  // namespace splatvol
