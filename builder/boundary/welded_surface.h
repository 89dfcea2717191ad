// Triangles that share their corners, in bounded memory.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <unordered_map>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "builder/boundary/boundary_faces.h"

namespace splatvol {

/// Holds triangles: corners at one position are one point. If there are too many, the points in each cell of a grid
/// become one, at their mean, and triangles that lose a corner go. Triangles of a patch that become one have a side if
/// all of them have the same. The cells are as small as the limit allows. Both do not depend on the order of the
/// triangles, but for rounding. Not thread-safe.
class WeldedSurface {
 public:
  using Triangle = std::array<std::uint32_t, 3>;

  /// `box`: round all triangles to come. `most`: triangles to hold, at least 1.
  WeldedSurface(const Box& box, std::uint64_t most) : box_(box), most_(most) {}

  /// Fails if there are more than 2^32 - 1 points.
  [[nodiscard]] Status add(const BoundaryTriangle& triangle);

  [[nodiscard]] std::vector<dvec3> points() const;
  [[nodiscard]] const std::vector<Triangle>& triangles() const { return triangles_; }
  [[nodiscard]] const std::vector<std::uint32_t>& patches() const { return patches_; }  // [triangle]
  [[nodiscard]] const std::vector<bool>& sides() const { return sides_; }               // [triangle]: has_side

  /// No corner was moved by more: the diagonal of a cell, or 0.
  [[nodiscard]] double moved() const;

  /// Bytes that a triangle takes here, about.
  static constexpr std::uint64_t triangle_bytes = 110;

 private:
  // A position, bit by bit, or a cell of the grid.
  using Key = std::array<std::uint64_t, 3>;
  using Named = std::array<std::uint32_t, 4>;  // a triangle's points, ascending, and its patch
  struct Hash {
    template <class T>
    std::size_t operator()(const T& key) const;
  };

  [[nodiscard]] Key key_of(const dvec3& position) const;
  [[nodiscard]] double cell_edge() const;
  [[nodiscard]] Result<std::uint32_t> point_at(const dvec3& position);
  void add_points(const Triangle& points, std::uint32_t patch, bool has_side);
  [[nodiscard]] Status coarsen();

  Box box_;
  std::uint64_t most_;
  std::optional<int> depth_;  // of the grid; none: positions are exact
  std::unordered_map<Key, std::uint32_t, Hash> numbers_;
  std::vector<dvec3> sums_;            // [point]: of corners, relative to the box
  std::vector<std::uint64_t> counts_;  // [point]: of corners
  std::vector<Triangle> triangles_;
  std::vector<std::uint32_t> patches_;
  std::vector<bool> sides_;
  std::unordered_map<Named, std::size_t, Hash> named_;  // with a grid: the numbers of triangles
};

}  // namespace splatvol
