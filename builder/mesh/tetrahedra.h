// Cells to tetrahedra: one face-based method for every shape, conforming across cells, pieces and blocks.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "base/math.h"
#include "builder/mesh/cell_census.h"

namespace splatvol {

/// Cells that fill a volume and have a fixed number of nodes, in VTK's node order (as have the names of the files).
enum class CellShape {
  tetrahedron,
  voxel,
  hexahedron,
  wedge,
  pyramid,
  pentagonal_prism,
  hexagonal_prism,
  quadratic_tetrahedron,  // the quadratic ones: corners, then a node in the middle of each edge
  quadratic_hexahedron,
  quadratic_wedge,
  quadratic_pyramid,
};

/// Nodes of a cell of this shape: 4 to 20.
[[nodiscard]] std::size_t node_count(CellShape shape);

/// The name in a census: "tetrahedron", "pentagonal prism", ...
[[nodiscard]] std::string_view shape_name(CellShape shape);

/// Six times the signed volume: positive where d lies on the side that a, b, c run around counterclockwise.
[[nodiscard]] inline double signed_volume_6(dvec3 a, dvec3 b, dvec3 c, dvec3 d) {
  return glm::dot(b - a, glm::cross(c - a, d - a));
}

/// Splits cells without new points. Two cells that share a face split it along the same diagonals (Dompierre et al.
/// 1999: every face is a fan from its lowest vertex), and so do cells in different pieces: "lowest" compares positions,
/// x before y before z, and indices only where positions coincide. A face of more than four vertices that is not convex
/// fans out from the lowest vertex that sees all of it.
///
/// The apex that a cell's tetrahedra share is its lowest vertex from which no tetrahedron is inverted; where there is
/// none, the vertex that inverts the least volume, and the cell is counted as not star-shaped. A share under a
/// millionth of the cell's volume counts as rounding. A quadratic cell is cut at its mid-edge nodes into a cap for each
/// corner and a core, so every node takes part.
///
/// Collapsed cells (nodes given twice) give fewer tetrahedra; nodes with a position that is not finite, none. Holds its
/// scratch memory, so that a cell costs no allocation. Not thread-safe.
class TetrahedronSplitter {
 public:
  using Tetrahedron = std::array<std::uint32_t, 4>;

  /// Appends to `tetrahedra` and counts in `census` (all but its `cells` and `hidden`); all three must outlive this.
  TetrahedronSplitter(std::span<const dvec3> points, std::vector<Tetrahedron>& tetrahedra, CellCensus& census)
      : points_(points), tetrahedra_(tetrahedra), census_(census) {}

  /// Requires nodes.size() == node_count(shape) and indices in range. Orientation as VTK's face tables have it; wedges
  /// are found in files in both orders, so that a whole wedge never counts as inverted.
  void split(CellShape shape, std::span<const std::uint32_t> nodes);

  /// `faces`: for each face its vertex count and its vertices, all indices in range, counterclockwise from outside.
  /// Faces that are turned round against their neighbours are put right.
  void split_polyhedron(std::span<const std::uint32_t> faces);

 private:
  using Triangle = std::array<std::uint32_t, 3>;
  struct Volumes {
    double positive = 0;
    double negative = 0;  // absolute value
    [[nodiscard]] double inverted() const { return positive < negative ? positive : negative; }
    [[nodiscard]] double total() const { return positive + negative; }
  };

  void split_faces(bool either_orientation);
  bool split_from_any_vertex(bool either_orientation);
  void collect_vertices();
  void triangulate_faces();
  [[nodiscard]] bool faces_agree() const;
  void orient_faces();
  [[nodiscard]] std::size_t fan_start(std::span<const std::uint32_t> face);
  [[nodiscard]] bool fans_out(std::span<const std::uint32_t> face, std::size_t start, dvec3 normal) const;
  [[nodiscard]] bool lower(std::uint32_t a, std::uint32_t b) const;
  [[nodiscard]] bool finite(std::span<const std::uint32_t> nodes) const;
  [[nodiscard]] double volume_6(std::uint32_t apex, const Triangle& triangle) const;
  [[nodiscard]] Volumes volumes_from(std::uint32_t apex) const;
  void emit(std::uint32_t apex, const Volumes& volumes, bool either_orientation);
  void emit_tetrahedron(const Tetrahedron& tetrahedron, double oriented_volume, double rounding);

  std::span<const dvec3> points_;
  std::vector<Tetrahedron>& tetrahedra_;
  CellCensus& census_;

  // Of the cell at hand.
  std::vector<std::uint32_t> faces_;     // count, vertices, count, vertices, ...
  std::vector<std::uint32_t> vertices_;  // lowest first
  std::vector<Triangle> triangles_;      // its surface
  std::vector<std::uint32_t> polygon_;   // the face at hand
};

}  // namespace splatvol
