// Triangles near a position.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "base/math.h"

namespace splatvol {

/// A tree of boxes round triangles. Holds about 30 bytes for each triangle, besides the spans, which must outlive it.
class TriangleTree {
 public:
  using Triangle = std::array<std::uint32_t, 3>;

  /// Requires indices in range, finite positions, and fewer than 2^31 triangles.
  TriangleTree(std::span<const dvec3> points, std::span<const Triangle> triangles);

  /// Returns the distance from a position to the nearest triangle; infinity if there is none. Thread-safe.
  [[nodiscard]] double distance(const dvec3& position) const;

  /// Returns whether accept(triangle) holds for one of the triangles whose boxes are within `distance` of a position.
  /// Thread-safe if `accept` is.
  [[nodiscard]] bool any_near(const dvec3& position, double distance,
                              const std::function<bool(std::uint32_t triangle)>& accept) const;

 private:
  struct Node {
    Box box;
    std::uint32_t begin, end;  // of order_
    std::uint32_t right = 0;   // the left child is the next node; 0: a leaf
  };
  void build(std::uint32_t begin, std::uint32_t end);
  [[nodiscard]] Box box_of(std::uint32_t triangle) const;

  std::span<const dvec3> points_;
  std::span<const Triangle> triangles_;
  std::vector<std::uint32_t> order_;
  std::vector<Node> nodes_;
};

/// Returns the square of the distance from a position to a triangle, which may be flat (Ericson, Real-Time Collision
/// Detection, 5.1.5).
[[nodiscard]] double squared_distance(const dvec3& position, const dvec3& a, const dvec3& b, const dvec3& c);

}  // namespace splatvol
