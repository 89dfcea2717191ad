// A Delaunay triangulation of points that are not all known at once.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/mesh/moments.h"

namespace splatvol {

/// The triangulation is that of delaunay_tetrahedra, before any are left out: of the points alone, not of their order.
/// One thread at a time.
class GrowingDelaunay {
 public:
  /// A tetrahedron; or a face of the hull, counterclockwise from outside, with `none` for its last corner.
  struct Cell {
    static constexpr std::uint32_t none = std::numeric_limits<std::uint32_t>::max();
    Tetrahedron corners;
    double radius;  // of the circumsphere, as far as rounding can tell; infinite for a face
    double mark;
    [[nodiscard]] bool is_finite() const { return corners[3] != none; }
  };

  GrowingDelaunay();
  GrowingDelaunay(GrowingDelaunay&&) noexcept;
  ~GrowingDelaunay();

  /// Adds points, numbered on from those before. Of coincident ones in a call the first takes part; none may coincide
  /// with those of calls before.
  void insert(std::span<const dvec3> positions);

  /// All cells, tetrahedra first; none as long as no four points span a volume.
  [[nodiscard]] std::vector<Cell> cells();

  /// Sets the mark of a cell, by its place in what cells() returned last, until a point falls into its circumsphere. It
  /// is 0 at first. Not after insert().
  void set_mark(std::size_t cell, double mark);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace splatvol
