// Delaunay tetrahedra of more points than memory holds, subdomain by subdomain.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/mesh/ranked_tetrahedron.h"
#include "builder/points/point_stream.h"
#include "builder/points/shared_tetrahedra.h"
#include "builder/points/stored_points.h"

namespace splatvol {

/// Returns points with the material of the tetrahedra at them, to the last bit the same as delaunay_tetrahedra gives
/// for all points at once. A subdomain is triangulated with a halo. A tetrahedron matters if it lies at the subdomain's
/// own points, or decides on the usual circumradius there. Round by round, the halo gets each bucket of the stored
/// points that may hold a point in the circumsphere of such a tetrahedron. Neighbouring subdomains then find the same
/// tetrahedra without any exchange.
class DelaunaySubdomains {
 public:
  /// Most points in a subdomain, and with its halo.
  static constexpr std::size_t default_subdomain_points = std::size_t{1} << 16;
  static constexpr std::size_t default_most_points = std::size_t{1} << 18;

  /// Stores all points of `stream`, which must have no material, in `folder`. `memory`: bytes for the subdomains that
  /// are triangulated at the same time, at least one. The points that next() returns do not depend on `memory`. `take`:
  /// gets the tetrahedra, each once, whose corners are numbers of points in the stream; may be empty.
  [[nodiscard]] static Result<DelaunaySubdomains> create(PointStream& stream, std::uint64_t memory,
                                                         const std::string& folder,
                                                         std::size_t subdomain_points = default_subdomain_points,
                                                         std::size_t most_points = default_most_points,
                                                         TakeTetrahedra take = {});

  /// As PointStream::next(), one subdomain at a time, with material and planes.
  [[nodiscard]] Result<bool> next(PointBatch& batch);

  /// The number of points from subdomains whose halo would have become too large, so that some of their tetrahedra may
  /// be others. This happens if all points of a subdomain lie on a plane, or if hundreds of thousands of points lie
  /// round one that is far from all of them.
  [[nodiscard]] std::uint64_t uncertain() const { return uncertain_; }

  /// The number of tetrahedra that `take` gets or lacks though subdomains disagree on them (SharedTetrahedra). There
  /// are none if no point is uncertain, unless all that a subdomain knows is flat. Known once next() has returned
  /// false.
  [[nodiscard]] std::uint64_t disputed() const { return shared_ ? shared_->disputed() : 0; }

 private:
  DelaunaySubdomains(StoredPoints points, const Cube& cube, std::size_t subdomain_points, std::size_t most_points,
                     std::size_t at_once);
  [[nodiscard]] Status triangulate(std::size_t count);

  StoredPoints points_;
  Cube cube_;
  std::size_t most_points_;
  std::size_t at_once_;
  std::vector<std::size_t> cuts_;  // buckets at which subdomains begin, and the end
  std::size_t next_ = 0;           // subdomain
  std::deque<PointBatch> ready_;
  std::size_t returned_ = 0;  // points of the first of these
  std::uint64_t uncertain_ = 0;
  std::unique_ptr<SharedTetrahedra> shared_;  // null: no one takes tetrahedra
  bool ended_ = false;
};

}  // namespace splatvol
