// Cells to tetrahedra: one face-based method for every shape, conforming across cells, pieces and blocks.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "base/math.h"
#include "builder/mesh/cell_census.h"
#include "builder/mesh/whole_cell.h"

namespace splatvol {

/// Volume cells with a fixed number of nodes. Nodes are in VTK's order, and the names follow VTK's.
enum class CellShape {
  tetrahedron,
  voxel,
  hexahedron,
  wedge,
  pyramid,
  pentagonal_prism,
  hexagonal_prism,
  quadratic_tetrahedron,  // quadratic cells: corners, then a node in the middle of each edge
  quadratic_hexahedron,
  quadratic_wedge,
  quadratic_pyramid,
  biquadratic_hexahedron,  // as a quadratic one, then nodes in the middles of the sides -x, +x, -y, +y
  triquadratic_pyramid,    // as a quadratic one, then nodes in the middles of its base, of its sides, and of the cell
};

/// The number of nodes in a cell of this shape: 4 to 24.
[[nodiscard]] std::size_t node_count(CellShape shape);

/// Whether a cell of this shape has corners only.
[[nodiscard]] constexpr bool is_linear(CellShape shape) { return shape < CellShape::quadratic_tetrahedron; }

/// The name in a census: "tetrahedron", "pentagonal prism", ...
[[nodiscard]] std::string_view shape_name(CellShape shape);

/// Six times the signed volume: positive where d lies on the side that a, b, c run around counterclockwise.
[[nodiscard]] inline double signed_volume_6(dvec3 a, dvec3 b, dvec3 c, dvec3 d) {
  return glm::dot(b - a, glm::cross(c - a, d - a));
}

/// Splits cells into tetrahedra without new points. Every face becomes a fan from its lowest vertex (Dompierre et al.
/// 1999), so two cells split their common face along the same diagonals, even in different pieces. "Lowest" compares
/// positions, x before y before z, and indices only if positions coincide. A face with more than four vertices that is
/// not convex fans out from the lowest vertex that sees all of it.
///
/// A cell's tetrahedra share an apex: the lowest vertex from which no tetrahedron is inverted. If there is none, the
/// apex is the vertex that inverts the least volume, and the cell counts as not star-shaped. Inverted volume below a
/// millionth of the cell's volume counts as rounding. A quadratic cell is cut at its mid-edge nodes into a cap for each
/// corner and a core, so that every node takes part. With nodes in the middles of faces it is cut at these, too.
///
/// A collapsed cell (a node given twice) gives fewer tetrahedra, a cell with a position that is not finite gives none.
/// Keeps its scratch memory, so that a cell costs no allocation. Not thread-safe.
class TetrahedronSplitter {
 public:
  using Tetrahedron = std::array<std::uint32_t, 4>;

  /// Appends to `tetrahedra` and counts in `census` (all but its `cells` and `hidden`); all three must outlive this.
  TetrahedronSplitter(std::span<const dvec3> points, std::vector<Tetrahedron>& tetrahedra, CellCensus& census)
      : points_(points), tetrahedra_(tetrahedra), census_(census) {}

  /// Appends linear cells to `whole_cells`, which must outlive this, besides tetrahedra: those whose nodes differ, and
  /// polyhedra.
  void list_whole_cells(std::vector<WholeCell>& whole_cells) { whole_cells_ = &whole_cells; }

  /// Requires nodes.size() == node_count(shape) and indices in range. Expects the orientation of VTK's face tables, but
  /// files have wedges in both orientations: a whole wedge never counts as inverted.
  void split(CellShape shape, std::span<const std::uint32_t> nodes);

  /// `faces`: for each face its number of vertices, then its vertices, counterclockwise from outside. Requires indices
  /// in range. Turns faces round that run against their neighbours.
  void split_polyhedron(std::span<const std::uint32_t> faces);

  /// Returns the triangles into which a face with these vertices is split, in whichever cell. Valid until the next
  /// call. Requires indices in range, and finite positions.
  using Triangle = std::array<std::uint32_t, 3>;
  [[nodiscard]] std::span<const Triangle> split_face(std::span<const std::uint32_t> face);

 private:
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
  void list_whole_cell(CellShape shape, std::span<const std::uint32_t> nodes, std::size_t first);
  void list_polyhedron(std::size_t first);
  void emit_tetrahedron(const Tetrahedron& tetrahedron, double oriented_volume, double rounding);

  std::span<const dvec3> points_;
  std::vector<Tetrahedron>& tetrahedra_;
  CellCensus& census_;
  std::vector<WholeCell>* whole_cells_ = nullptr;

  // The current cell.
  std::vector<std::uint32_t> faces_;     // count, vertices, count, vertices, ...
  std::vector<std::uint32_t> vertices_;  // lowest first
  std::vector<Triangle> triangles_;      // its surface
  std::vector<std::uint32_t> polygon_;   // the current face
};

}  // namespace splatvol
