// Positions or boxes in a tree of boxes.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/math.h"

namespace splatvol {

/// Finds positions, or boxes, that meet a box. Takes about 20 bytes for each.
class BoxTree {
 public:
  /// Fewer than 2^32 - 1. Those that are not finite are left out.
  explicit BoxTree(std::span<const dvec3> positions);
  explicit BoxTree(std::span<const Box> boxes);

  [[nodiscard]] bool empty() const { return nodes_.empty(); }

  [[nodiscard]] std::uint64_t memory_bytes() const {
    return order_.capacity() * sizeof(order_[0]) + nodes_.capacity() * sizeof(Node);
  }

  /// Calls visit(index) for all that meet a box, its faces included, and some near it.
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
  template <class Items>
  void make(const Items& items);
  template <class Items>
  void make_node(const Items& items, std::uint32_t begin, std::uint32_t end);

  std::vector<std::uint32_t> order_;
  std::vector<Node> nodes_;
};

}  // namespace splatvol
