// Positions in a k-d tree.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/math.h"

namespace splatvol {

/// Finds positions in boxes. Takes about 12 bytes for each.
class PositionTree {
 public:
  /// `positions` must outlive this; fewer than 2^32 - 1. Those that are not finite are left out.
  explicit PositionTree(std::span<const dvec3> positions);

  [[nodiscard]] bool empty() const { return nodes_.empty(); }

  /// Calls visit(index) for all positions in a box, its faces included, and some near it.
  template <class Visit>
  void visit_near(const Box& box, const Visit& visit) const {
    for (std::uint32_t n = 0; n < nodes_.size();) {
      const Node& node = nodes_[n];
      const bool is_near = squared_distance(node.box, box) == 0, is_leaf = node.next == n + 1;
      for (std::uint32_t i = node.begin; is_near && is_leaf && i < node.end; ++i) visit(order_[i]);
      n = is_near ? n + 1 : node.next;
    }
  }

 private:
  // Depth first: a node's children follow it, up to `next`.
  struct Node {
    Box box;
    std::uint32_t begin, end;  // of `order_`
    std::uint32_t next;        // the node that follows all below this one
  };
  void make_node(std::uint32_t begin, std::uint32_t end);

  std::span<const dvec3> positions_;
  std::vector<std::uint32_t> order_;
  std::vector<Node> nodes_;
};

}  // namespace splatvol
