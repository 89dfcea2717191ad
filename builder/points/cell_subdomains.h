// Voronoi cells of more points than memory holds, subdomain by subdomain.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/points/point_stream.h"
#include "builder/points/stored_points.h"

namespace splatvol {

/// Returns points with the material of their Voronoi cells, as SampledCells estimates them. Subdomains see the points
/// of others where they need them, so cells do not end at their borders.
class CellSubdomains {
 public:
  /// Most points in a subdomain.
  static constexpr std::size_t default_subdomain_points = std::size_t{1} << 15;

  /// Stores all points of `stream`, which must have no material, in `folder`. `memory`: bytes for the subdomains whose
  /// cells are held at the same time, at least one. The points that next() returns do not depend on `memory`.
  [[nodiscard]] static Result<CellSubdomains> create(PointStream& stream, std::uint64_t memory,
                                                     const std::string& folder,
                                                     std::size_t subdomain_points = default_subdomain_points);

  CellSubdomains(CellSubdomains&&) noexcept;
  CellSubdomains& operator=(CellSubdomains&&) noexcept;
  ~CellSubdomains();

  /// As PointStream::next(), some thousand points at a time, with material. Uses all threads.
  [[nodiscard]] Result<bool> next(PointBatch& batch);

  /// About the bytes that this holds at most, and with one subdomain at a time.
  [[nodiscard]] std::uint64_t memory() const;
  [[nodiscard]] std::uint64_t least_memory() const;

 private:
  class Subdomain;
  CellSubdomains(std::unique_ptr<StoredPoints> points, const Cube& cube, std::size_t subdomain_points,
                 std::size_t at_once);
  [[nodiscard]] Status find_cells();

  std::unique_ptr<StoredPoints> points_;  // subdomains refer to them
  Cube cube_;
  std::size_t at_once_;
  std::vector<std::size_t> cuts_;  // buckets at which subdomains begin, and the end
  std::size_t next_ = 0;           // subdomain
  std::vector<std::unique_ptr<Subdomain>> idle_;
  std::deque<std::unique_ptr<Subdomain>> ready_;  // with their cells
  std::size_t returned_ = 0;                      // points of the first of these
};

}  // namespace splatvol
