// Points in Morton order on the disk, found by where they are.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/temp_file.h"
#include "builder/points/point_records.h"
#include "builder/points/point_stream.h"

namespace splatvol {

/// The points of a stream without material in a temporary file, and a tree of boxes round them: its leaves, in Morton
/// order, are cells of the octree with few points each, and every eight boxes have one above them. Holds 100 bytes a
/// leaf, of which there are at most some million. Thread-safe but for create().
class StoredPoints {
 public:
  struct Node {
    Box box;                         // round the distinct points in it; empty where there are none
    std::size_t parent = 0;          // that of the root is itself
    std::size_t begin = 0, end = 0;  // nodes below; of a leaf, points
  };

  /// Takes all points of `stream`.
  [[nodiscard]] static Result<StoredPoints> create(PointStream& stream, const std::string& folder);

  /// Leaves, then what is above them, level by level; the last is the root.
  [[nodiscard]] const std::vector<Node>& nodes() const { return nodes_; }
  [[nodiscard]] std::size_t leaf_count() const { return leaves_; }

  /// Leaves, from 0 to leaf_count(), at which blocks of at most so many points begin and end, as long as a leaf does
  /// not have more: where cells as large as can be do.
  [[nodiscard]] std::vector<std::size_t> cut(std::size_t block_points) const;

  [[nodiscard]] const PointRecords& layout() const { return layout_; }

  /// Appends the records of points [begin, end), layout().bytes() each.
  [[nodiscard]] Status read(std::size_t begin, std::size_t end, std::vector<std::byte>& records) const;

  /// Whether a leaf's first point lies where the point before it does.
  [[nodiscard]] bool continues(std::size_t leaf) const { return continues_[leaf]; }

 private:
  StoredPoints(const PointRecords& layout, TempFile file) : layout_(layout), file_(std::move(file)) {}
  void build_tree();

  PointRecords layout_;
  TempFile file_;
  std::size_t leaves_ = 0;
  std::vector<Node> nodes_;
  std::vector<std::int8_t> shared_;  // [leaf]: depth of the smallest cell that holds the point before it too
  std::vector<bool> continues_;      // [leaf]
};

}  // namespace splatvol
