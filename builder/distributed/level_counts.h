// How many points each level of a reduction will have: known before the reduction, so that each rank can place its
// rows.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "builder/points/point_batch.h"
#include "builder/reduction/cascade.h"
#include "builder/sorting/octree_nodes.h"

namespace splatvol {

/// Reduces positions and keys alone, as ReductionPass does with Reduction::octree: the same points stay.
class LevelCounts {
 public:
  /// `most_of_one_key`: most points in an index leaf; further points of one key do not take part. `marks`: ascending
  /// keys between which members are counted.
  LevelCounts(const Cube& cube, std::uint32_t leaf_points, std::uint64_t most_of_one_key, const KeyBorders& borders,
              std::vector<MortonKey> marks)
      : cube_(cube),
        leaf_points_(leaf_points),
        most_of_one_key_(most_of_one_key),
        borders_(borders),
        marks_(std::move(marks)),
        levels_(max_levels) {}

  /// Adds the points of a batch, in Morton order.
  void add(const PointBatch& batch);

  /// Called after the last batch.
  void finish() { close_leaves(true); }

  /// Members of each level between two marks: [level][interval]. The first interval ends before the first mark.
  [[nodiscard]] std::vector<std::vector<std::uint64_t>> intervals() const;

 private:
  struct Entry {
    MortonKey key;
    dvec3 position;
  };
  struct Level {
    std::deque<Entry> entries;  // of leaves that are not whole yet
    std::optional<MortonKey> before;
    std::size_t mark = 0;  // the first that is behind the last entry
    std::vector<std::uint64_t> counts;
  };

  void push(std::size_t level, const Entry& entry);
  void count(Level& level, const MortonKey& key);
  void close_leaves(bool at_end);
  void close_leaves(std::size_t level, bool at_end);

  Cube cube_;
  std::uint32_t leaf_points_;
  std::uint64_t most_of_one_key_;
  KeyBorders borders_;
  std::vector<MortonKey> marks_;
  std::vector<Level> levels_;
  std::optional<MortonKey> last_;  // key of the last point
  std::uint64_t of_last_key_ = 0;  // points
};

}  // namespace splatvol
