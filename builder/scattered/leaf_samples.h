// Samples of a leaf, and the points nearest to them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/math.h"
#include "builder/scattered/point_leaves.h"

namespace splatvol {

/// 64 samples in a box, one at random in each of 4^3 equal parts, and the two nearest points to each. Keeps its memory.
class LeafSamples {
 public:
  static constexpr int side = 4;
  static constexpr std::size_t count = side * side * side;

  /// Forgets what it knows of other points.
  void reset() { block_ = PointLeaves::none; }

  /// Finds the points nearest to the samples of a leaf, among those in and near its block. `seed`: chooses the samples.
  /// Returns false if no point before `own` is near.
  bool find(const PointLeaves& points, const PointLeaves::Leaf& leaf, std::uint32_t own, std::uint32_t seed);

  /// Both are PointLeaves::none where there is no such point. [sample], the first coordinate fastest
  [[nodiscard]] std::uint32_t nearest(std::size_t sample) const { return nearest_[sample]; }
  [[nodiscard]] std::uint32_t second(std::size_t sample) const { return second_[sample]; }

 private:
  // A point that may be nearest to a sample, from the leaf's centre, in units of half its diagonal.
  struct Candidate {
    float x, y, z;
    std::uint32_t point;
  };
  struct Near {
    LaneVectors positions;  // NaN behind the last point
    std::array<std::uint32_t, lanes> points;
  };
  void enter_block(const PointLeaves& points, std::uint32_t block, std::uint32_t own);
  void find_candidates(const Box& leaf);
  void place(const dvec3& extent, std::uint32_t seed);
  void compare();

  double unit_ = 1;
  std::uint32_t block_ = PointLeaves::none;  // whose surroundings are known
  bool has_own_ = false;                     // whether an own point is there
  std::vector<PointLeaves::Entry> entries_;  // there
  std::vector<Near> near_;                   // these, side by side
  std::vector<Candidate> candidates_;
  alignas(64) std::array<float, count> x_, y_, z_;
  alignas(64) std::array<float, count> nearest_square_, second_square_;
  alignas(64) std::array<std::uint32_t, count> nearest_, second_;
};

}  // namespace splatvol
