// A Delaunay triangulation of points that are not all known at once.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "builder/mesh/moments.h"

namespace splatvol {

/// The triangulation is the one of delaunay_tetrahedra before it leaves tetrahedra out. It depends on the points alone,
/// not on their order. One thread at a time.
class GrowingDelaunay {
 public:
  /// A tetrahedron; or a face of the hull, counterclockwise from outside, with `none` for its last corner.
  struct Cell {
    static constexpr std::uint32_t none = std::numeric_limits<std::uint32_t>::max();
    Tetrahedron corners;
    double radius;  // of the circumsphere, up to rounding; infinite for a face
    double mark;
    [[nodiscard]] bool is_finite() const { return corners[3] != none; }
  };

  GrowingDelaunay();
  ~GrowingDelaunay();

  /// Adds points; their numbers follow those of earlier calls. The first of coincident points in a call takes part.
  /// None may coincide with points of earlier calls. Fails if this thread's stop is requested, and is of no use then.
  [[nodiscard]] Status insert(std::span<const dvec3> positions);

  /// Returns all cells, tetrahedra first; none as long as no four points span a volume.
  [[nodiscard]] std::vector<Cell> cells();

  /// Sets the mark of a cell, by its index in the last result of cells(). A mark is 0 at first; a cell keeps it until a
  /// point falls into its circumsphere. Requires that insert() has not been called since cells().
  void set_mark(std::size_t cell, double mark);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace splatvol
