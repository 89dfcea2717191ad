// Points in Morton order on the disk, found by their positions.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/temp_file.h"
#include "builder/points/point_records.h"
#include "builder/points/point_stream.h"
#include "builder/sorting/morton.h"

namespace splatvol {

/// The points of a stream without material, in a temporary file, and a tree of boxes round them. The tree's buckets are
/// octree nodes with few points each, in Morton order; above them, each box encloses up to eight boxes. Holds 100 bytes
/// for each bucket, of which there are about a million at most. Thread-safe, except create().
class StoredPoints {
 public:
  struct Node {
    Box box;                         // round the distinct points below; empty if there are none
    std::size_t parent = 0;          // the root is its own parent
    std::size_t begin = 0, end = 0;  // nodes below; of a bucket, points
  };

  /// Stores all points that `stream` still has.
  [[nodiscard]] static Result<StoredPoints> create(PointStream& stream, const std::string& folder);

  /// The nodes of the tree: buckets, then the nodes above them, one layer after the other. The last is the root.
  [[nodiscard]] const std::vector<Node>& nodes() const { return nodes_; }
  [[nodiscard]] std::size_t bucket_count() const { return buckets_; }

  /// About the distance between points in and round a bucket: the diagonal of the space that one of them has.
  [[nodiscard]] double spacing(std::size_t bucket) const;

  /// Cuts the points into subdomains of at most `subdomain_points` points, or one bucket if that has more. Returns the
  /// buckets at which subdomains begin, from 0 on, then bucket_count(). Cuts lie where octree nodes end, the larger the
  /// better.
  [[nodiscard]] std::vector<std::size_t> cut(std::size_t subdomain_points) const;

  [[nodiscard]] const PointRecords& layout() const { return layout_; }

  /// Appends the records of points [begin, end), layout().bytes() each. These are those of whole buckets.
  [[nodiscard]] Status read(std::size_t begin, std::size_t end, std::vector<std::byte>& records) const;

  /// Bytes held.
  [[nodiscard]] std::uint64_t memory() const {
    return nodes_.capacity() * sizeof(Node) + hashes_.capacity() * sizeof(hashes_[0]);
  }

  /// Whether a bucket's first point coincides with the point before it.
  [[nodiscard]] bool continues(std::size_t bucket) const { return continues_[bucket]; }

 private:
  StoredPoints(const PointRecords& layout, TempFile file, const Cube& cube, std::size_t most)
      : layout_(layout), file_(std::move(file)), cube_(cube), most_(most) {}

  // The last point that is in a bucket.
  struct Last {
    std::optional<MortonKey> key;
    std::optional<dvec3> position;
  };
  std::size_t add_bucket(const PointBatch& held, std::size_t begin, Last& last);
  Status append_records(const PointBatch& held, std::size_t count);
  void build_tree();

  PointRecords layout_;
  TempFile file_;
  Cube cube_;
  std::size_t most_;  // points in a bucket
  std::size_t buckets_ = 0;
  std::vector<Node> nodes_;
  std::vector<std::uint64_t> hashes_;  // [bucket]: of its records in the file
  std::vector<std::int8_t> shared_;  // [bucket]: depth of the smallest octree node that also holds the point before it
  std::vector<std::int8_t> depths_;  // [bucket]: of its octree nodes
  std::vector<bool> continues_;      // [bucket]
};

}  // namespace splatvol
