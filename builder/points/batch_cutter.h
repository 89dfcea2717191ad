// Batches of whole index leaves from a stream of points.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "base/error.h"
#include "builder/points/point_batch.h"
#include "builder/sorting/octree_nodes.h"

namespace splatvol {

/// How large batches are. Rows and index leaves do not depend on it.
struct BatchShape {
  std::size_t points = 4096;       // a batch ends with the estimate node that makes it so large
  std::size_t node_points = 4096;  // most points in an estimate node; at least so many as in an index leaf are allowed
};

/// The most points in an estimate node if material is estimated. The estimate is worse at borders of nodes, and larger
/// nodes have fewer borders.
inline constexpr std::size_t estimate_node_points = 4096;

/// The surroundings of points that are a range of all points in Morton order.
struct PointBorders {
  KeyBorders keys;
  std::optional<dvec3> before, behind;  // positions of the neighbours in Morton order
};

/// Cuts a stream of points into index leaves, and returns them in batches of whole estimate nodes.
class BatchCutter {
 public:
  /// `next`: the points, in Morton order. `index_leaf_points`: most points in an index leaf, at least 255, because
  /// octree leaves count up to 255 points. Points of one key that are more than a leaf holds come in several parts.
  /// `borders`: if the points are a part of all; nodes across these have more points than any leaf or estimate node.
  BatchCutter(NextPoints next, std::size_t attributes, std::uint64_t index_leaf_points, BatchShape shape = {},
              PointBorders borders = {});

  /// Replaces `batch` by the next points, and uses its memory again. Returns false after the last point.
  [[nodiscard]] Result<bool> next(PointBatch& batch);

 private:
  [[nodiscard]] Status hold(std::size_t points);
  [[nodiscard]] NodePart part_at(std::size_t begin, std::size_t most) const;
  [[nodiscard]] std::size_t cut_estimate_nodes(std::size_t most, std::vector<NodePart>& parts) const;
  void cut_index_leaves(std::span<const NodePart> nodes, std::vector<NodePart>& parts);
  void extract_points(std::size_t end, PointBatch& batch);

  NextPoints next_;
  std::size_t index_leaf_points_;
  BatchShape shape_;
  PointBorders borders_;
  PointBatch held_;                // points that have not been returned
  std::optional<MortonKey> last_;  // key of the point that was returned last
  std::optional<dvec3> before_;    // its position, or that of the neighbour before all
  bool ended_ = false;             // the stream has no more points
  std::uint64_t returned_ = 0;     // points
  std::uint64_t leaves_ = 0;       // index leaves that have begun
};

}  // namespace splatvol
