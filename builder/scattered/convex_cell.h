// A convex polyhedron that planes cut down, one after the other.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/mesh/moments.h"

namespace splatvol {

/// A convex polyhedron of which every vertex has three edges: where more planes meet, vertices coincide. Keeps its
/// scratch memory, so that a cell costs no allocation. Not thread-safe.
class ConvexCell {
 public:
  static constexpr std::uint32_t no_label = std::numeric_limits<std::uint32_t>::max();
  struct Face {
    dvec3 normal;  // outwards, of any length
    std::uint32_t label;
    std::uint32_t begin, end;  // of its loop
  };

  /// Becomes a box, whose faces have no label.
  void reset(const dvec3& low, const dvec3& high);

  /// Keeps the part where dot(normal, x) <= offset; the new face gets the label. Returns false if nothing is cut off.
  /// Each vertex is put on one side once, so that rounding may choose the wrong side. Where sizes are so many decades
  /// apart that the polyhedron would not close, it becomes empty.
  bool clip(const dvec3& normal, double offset, std::uint32_t label);

  [[nodiscard]] std::span<const dvec3> vertices() const { return std::span(vertices_).first(count_); }

  /// Whether a vertex lies on a face without a label.
  [[nodiscard]] bool is_on_border(std::size_t vertex) const {
    return std::ranges::any_of(edges_[vertex], [&](const Edge& edge) { return planes_[edge.plane].label == no_label; });
  }

  /// The square of the length of the longest normal of a face with a label; 0 if there is none.
  [[nodiscard]] double largest_normal_squared() const;

  /// The faces, until the next cut.
  [[nodiscard]] std::span<const Face> faces() const;

  /// The vertices of one of these faces, in their order round it, seen from outside counterclockwise.
  [[nodiscard]] std::span<const std::uint32_t> loop(const Face& face) const {
    return std::span(loops_).subspan(face.begin, face.end - face.begin);
  }

  /// The moments of the volume; the centroid is relative to the origin.
  [[nodiscard]] SpatialMoments moments() const;

 private:
  // One of a vertex' three edges, which go round the vertex counterclockwise, seen from outside.
  struct Edge {
    std::uint32_t to;      // the vertex at its other end
    std::uint32_t number;  // of this edge there
    std::uint32_t plane;   // of the face to the left
  };
  using Edges = std::array<Edge, 3>;
  struct Plane {
    dvec3 normal;
    std::uint32_t label;
  };
  // An edge from outside to inside, which the plane of the current cut crosses.
  struct Crossing {
    std::uint32_t vertex, edge;  // outside
    Edge inside;                 // the same edge, as it goes on inside
    dvec3 position;
    std::uint32_t place;  // of the new vertex
    std::uint32_t back;   // the crossing where the new face's edge from here ends
  };
  void make_room(std::size_t count);
  std::span<Crossing> find_crossings(std::span<const std::uint32_t> outside);
  [[nodiscard]] bool join(std::span<Crossing> crossings);
  void replace(std::span<const std::uint32_t> outside, std::span<const Crossing> crossings);

  std::uint32_t count_ = 0;      // of vertices; arrays may be longer, so that nothing is made that is not used
  std::vector<dvec3> vertices_;  // [vertex], as the next two
  std::vector<Edges> edges_;
  std::vector<double> heights_;         // over the plane of the current cut
  std::vector<std::uint32_t> outside_;  // of the current cut: vertices, ascending
  std::vector<Crossing> crossings_;
  std::vector<Plane> planes_;

  mutable std::vector<Face> faces_;  // empty: not found yet
  mutable std::vector<std::uint32_t> loops_;
  mutable std::vector<std::uint32_t> seen_;  // no bytes, as their writes might change any other number
  mutable std::vector<double> weights_;      // [vertex]: volume of the tetrahedra at it
};

}  // namespace splatvol
