// Rays from a point to the planes round its Voronoi cell.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/mesh/moments.h"

namespace splatvol {

/// Measures a convex cell round a point by rays. A plane is given by its dual point m: the cell lies where m . x <= 1.
/// A ray in direction d then ends at x = d / max(m . d). There are few rays while planes are searched for, and many for
/// the moments. Directions are those of a sphere, mapped by a matrix, the *shape*: in its coordinates the cell should
/// be about as long as wide. Keeps its memory.
class CellRays {
 public:
  /// Labels from here on are for planes that belong to no point. They count as different planes.
  static constexpr std::uint32_t first_border = 0x7fffff00U;

  /// The shape that fits a cell with these moments.
  [[nodiscard]] static dmat3 shape_of(const SpatialMoments& moments);

  /// Begins a cell that nothing bounds. `shape` must be regular.
  void reset(const dmat3& shape);

  /// Adds a plane. Few rays end there at once.
  void add(const dvec3& dual, std::uint32_t label);

  /// Moves the ends of the few rays after planes were added.
  void update();

  /// Whether a point in this box, which is relative to the cell's point, may be nearer to the end of a ray than the
  /// cell's point.
  [[nodiscard]] bool may_shorten(const dvec3& low, const dvec3& high) const;

  /// The square of twice the longest ray.
  [[nodiscard]] float reach() const { return reach_; }

  /// Casts many rays at the planes. All functions below are about these rays.
  void cast();

  /// Volume, centroid and covariance.
  [[nodiscard]] SpatialMoments moments();

  /// Whether the cell is about as long as wide in the coordinates of the shape, after moments().
  [[nodiscard]] bool fits() const { return fits_; }

  /// A shape that fits the cell, after moments().
  [[nodiscard]] const dmat3& better_shape() const { return better_shape_; }

  /// A vertex of the cell, about: the farthest end of three rays side by side that end at different planes.
  struct Vertex {
    float square;                         // of the distance from the point
    std::uint32_t ray;                    // the farthest one
    std::array<std::uint32_t, 3> labels;  // of the planes
  };

  /// Finds the vertices and the labels of the planes at which rays end.
  void find_vertices(std::vector<Vertex>& vertices, std::vector<std::uint32_t>& labels);

  /// The end of the vertex' ray, after find_vertices().
  [[nodiscard]] dvec3 end(const Vertex& vertex) const;

 private:
  using Floats [[gnu::vector_size(32)]] = float;
  using Integers [[gnu::vector_size(32)]] = std::int32_t;
  // Pairs of opposite rays, in vectors.
  static constexpr std::size_t lanes = 8, few = 2, many = 11, pair_count = 81, triangle_count = 320;
  template <std::size_t n>
  struct Directions {
    std::array<Floats, n> x, y, z;
  };
  struct Sphere;
  struct Plane {
    float x, y, z;  // the dual point in the coordinates of the shape
    std::uint32_t label;
  };
  static const Directions<few>& few_directions();
  static const Sphere& sphere();

  // Moments about the point, in the coordinates of the shape.
  struct Sums {
    double volume = 0;
    dvec3 first{0};
    SymmetricMatrix second;
  };
  [[nodiscard]] Sums sum_sectors() const;
  [[nodiscard]] Sums sum_tetrahedra() const;

  dmat3 shape_{1};
  std::vector<Plane> planes_;
  Directions<few> few_;                                 // in space
  std::array<std::array<Floats, few>, 2> few_inverse_;  // [side]: 1 / length, in the coordinates of the shape
  std::array<Floats, 2 * few> end_x_, end_y_, end_z_, end_square_;  // of few rays
  std::array<std::array<Floats, many>, 2> inverse_;                 // of many rays
  std::array<std::array<Integers, many>, 2> labels_;                // numbers of planes
  std::vector<std::uint8_t> used_;                                  // [plane]
  float reach_ = 0;
  bool fits_ = false;
  dmat3 better_shape_{1};
};

}  // namespace splatvol
