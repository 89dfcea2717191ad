// The boundary of a mesh that comes in pieces, corner by corner, and the planes of its points.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "base/error.h"
#include "base/math.h"
#include "builder/points/point_batch.h"
#include "builder/points/point_records.h"
#include "builder/sorting/external_sort.h"

namespace splatvol {

/// A vertex as every piece knows it: by its sample.
struct Corner {
  dvec3 position;  // -0 counts as 0
  std::uint64_t values_hash;
};
[[nodiscard]] bool operator==(const Corner& a, const Corner& b);
[[nodiscard]] bool operator<(const Corner& a, const Corner& b);

/// Hash of what copies of a vertex have in common besides their position (VertexCopies): the values in a point's
/// record; or, if copies are found without regard to values, which of them are missing, and the block if that counts.
[[nodiscard]] std::uint64_t hash_values(const PointRecords& layout, const std::byte* record);

/// An outer face of the whole mesh, as one of its points has it: a third of it at each corner, or all of it at the
/// point that stands for the face's cell.
struct CornerArea {
  Corner corner;  // the point
  BoundaryPlane plane;
  std::uint64_t face;  // key of the face: areas at a point add up in its order
};

/// Finds the boundary planes of points that come in Morton order.
class BoundaryCorners {
 public:
  /// `corners`: of CornerArea, sorted by the Morton keys of their positions; those of one key in any order.
  BoundaryCorners(const PointRecords& layout, ExternalSorter corners);

  /// Appends the planes of the points from `begin` on. `stored`: InputSummary::stored. `blocks`: of these points, if
  /// copies of a vertex are of one block; else not used. Requires all points of each key, and calls in Morton order.
  [[nodiscard]] Status append_planes(PointBatch& batch, std::size_t begin, std::span<const std::size_t> stored,
                                     std::span<const std::uint64_t> blocks);

 private:
  [[nodiscard]] Status read_corners(const MortonKey& key);
  [[nodiscard]] Result<bool> peek();

  PointRecords layout_;
  ExternalSorter sorted_;
  SortedRecords read_;                   // from the sorter
  std::size_t next_ = 0;                 // of the records read
  std::vector<CornerArea> corners_;      // of the present key
  std::vector<std::byte> record_;        // of the present point
  std::vector<BoundaryPlane> incident_;  // planes of the faces at that point
};

}  // namespace splatvol
