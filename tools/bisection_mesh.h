// A box of tetrahedra that can be refined locally and stays conforming.
#pragma once

#include <array>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include "base/math.h"

namespace splatvol {

/// Six Kuhn tetrahedra of a box, refined by Maubach's bisection (SIAM J. Sci. Comput. 16, 1995). Every tetrahedron
/// knows the edge to cut next. Shapes fall into a few classes at any depth. Cutting on until no edge has a vertex in
/// its middle always ends. Not thread-safe.
class BisectionMesh {
 public:
  BisectionMesh(dvec3 low, dvec3 high);

  [[nodiscard]] const std::vector<dvec3>& points() const { return points_; }
  [[nodiscard]] std::size_t size() const { return elements_.size(); }

  /// Returns the vertices of a tetrahedron, in positive order.
  [[nodiscard]] std::array<std::uint32_t, 4> tetrahedron(std::size_t index) const;

  /// Cuts every tetrahedron with marked[index] != 0 in two, and others as conformity requires. Indices of tetrahedra
  /// change, indices of points stay. Requires marked.size() == size().
  void refine(const std::vector<char>& marked);

 private:
  struct Element {
    std::array<std::uint32_t, 4> vertices;
    std::uint8_t tag;  // the edge vertices[0], vertices[tag] is cut next
  };

  [[nodiscard]] static std::uint64_t edge_key(std::uint32_t a, std::uint32_t b);
  [[nodiscard]] bool has_hanging_vertex(const Element& element) const;
  std::uint32_t middle(std::uint32_t a, std::uint32_t b);
  void bisect(std::size_t index);

  std::vector<dvec3> points_;
  std::vector<Element> elements_;

  // Edges that the present call of `refine` has cut. After the call no tetrahedron has such an edge.
  std::unordered_map<std::uint64_t, std::uint32_t> middles_;  // by edge_key
  std::vector<char> on_cut_edge_;                             // for each point
};

}  // namespace splatvol
