// Delaunay tetrahedra of more points than can be held, block by block.
#pragma once

#include <cstdint>
#include <deque>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/points/point_stream.h"
#include "builder/points/stored_points.h"

namespace splatvol {

/// Gives points back with the material of the tetrahedra at them, the same to the last bit as from delaunay_tetrahedra
/// for all points at once. A block is triangulated with a halo that takes in, round by round, each leaf of the stored
/// points which may hold a point in the circumsphere of a tetrahedron that matters to the block's own points: those at
/// them, and those that say what is usual there. So neighbouring blocks find the same tetrahedra, and nothing is
/// exchanged.
class DelaunaySubdomains {
 public:
  /// Of a block; with its halo it may have four times as many.
  static constexpr std::size_t default_subdomain_points = std::size_t{1} << 16;

  /// Takes all points of `stream`, which must have no material. `memory`: bytes for the blocks in work, of which there
  /// is one at least; what comes out does not depend on it. `folder`: for the points' records.
  [[nodiscard]] static Result<DelaunaySubdomains> create(PointStream& stream, std::uint64_t memory,
                                                         const std::string& folder,
                                                         std::size_t block_points = default_subdomain_points);

  /// As PointStream::next(), a block at a time, with material and planes.
  [[nodiscard]] Result<bool> next(PointBatch& batch);

  /// Points that came from blocks whose halo would have become too large: some of their tetrahedra may be others. So it
  /// is where all points of a block lie on a plane, or hundreds of thousands round a point that is far from all.
  [[nodiscard]] std::uint64_t uncertain() const { return uncertain_; }

 private:
  DelaunaySubdomains(StoredPoints points, const Cube& cube, std::size_t block_points, std::size_t at_once);

  StoredPoints points_;
  Cube cube_;
  std::size_t at_once_;
  std::vector<std::size_t> cuts_;  // leaves at which blocks begin, and the end
  std::size_t next_ = 0;           // block
  std::deque<PointBatch> ready_;
  std::uint64_t uncertain_ = 0;
};

}  // namespace splatvol
