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
  [[nodiscard]] std::uint32_t nearest(std::size_t sample) const { return point(nearest_[sample]); }
  [[nodiscard]] std::uint32_t second(std::size_t sample) const { return point(second_[sample]); }

 private:
  // A point that may be nearest to a sample, from the leaf's centre, in units of half its diagonal.
  struct Candidate {
    float x, y, z;
    std::uint32_t point;
  };
  void enter_block(const PointLeaves& points, std::uint32_t block, std::uint32_t own);
  void find_candidates(const Box& leaf);
  void place(const dvec3& extent, std::uint32_t seed);
  void compare();
  [[nodiscard]] Candidate candidate(const PointLeaves::Entry& entry, const dvec3& center) const {
    const vec3 local((entry.position() - center) / unit_);
    return {local.x, local.y, local.z, entry.point()};
  }
  [[nodiscard]] std::uint32_t point(std::int32_t candidate) const {
    return candidate < 0 ? PointLeaves::none : candidates_[static_cast<std::size_t>(candidate)].point;
  }

  double unit_ = 1;
  std::uint32_t block_ = PointLeaves::none;  // whose surroundings are known
  bool has_own_ = false;                     // whether an own point is there
  std::vector<PointLeaves::Entry> near_;     // points there
  std::vector<std::uint32_t> kept_;          // numbers of those that are candidates
  std::vector<Candidate> candidates_;
  alignas(64) std::array<float, count> x_, y_, z_;
  alignas(64) std::array<float, count> nearest_square_, second_square_;
  alignas(64) std::array<std::int32_t, count> nearest_, second_;  // candidates; -1: none
};

}  // namespace splatvol
