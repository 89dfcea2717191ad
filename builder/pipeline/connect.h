// Joining of points to a volume.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "base/error.h"
#include "builder/cells/mesh_cells.h"
#include "builder/pipeline/build.h"
#include "builder/points/delaunay_subdomains.h"
#include "builder/points/point_batch.h"
#include "builder/points/point_stream.h"

namespace splatvol {

/// Bytes for each scattered point that tetrahedra join with all others at once, and for each of its values.
inline constexpr std::uint64_t joined_point_bytes = 900, joined_value_bytes = 16;

/// Whether the input's cells join its points.
[[nodiscard]] bool is_joined_by_cells(const InputSummary& input);

/// Returns how so many scattered points are joined. Points that no tetrahedron joins then have boxes, unless `options`
/// ask for tetrahedra.
[[nodiscard]] Connectivity connectivity_of_points(const BuildOptions& options, std::uint64_t count);

/// The points of an input, joined.
struct Connection {
  Connectivity used;
  NextPoints next;                                                 // the points
  std::uint64_t points;                                            // how many; some of these may be merged yet
  bool needs_estimate = false;                                     // the points come without material
  std::uint64_t least_memory = 0;                                  // BuildReport::least_memory, to join them
  std::uint64_t memory = 0;                                        // bytes held beside those of a reduction's plan
  std::shared_ptr<const DelaunaySubdomains> subdomains = nullptr;  // null unless the points come from there
};

/// Joins the points as `options` ask for. The way depends on the number of points and not on memory, because the result
/// must not. `points` must outlive the result. `folder`: for points that do not fit into memory. Fails if cells are
/// asked for and there are none, or if memory is too little to join scattered points. `cells`: gets the tetrahedra that
/// join scattered points, until the points end; null if no one asks for them. Fails if it would get none. `progress`
/// gets the share that is done, in [0, 1].
[[nodiscard]] Result<Connection> connect(const BuildOptions& options, PointStream& points, const std::string& folder,
                                         MeshCells* cells, const std::function<void(double)>& progress);

}  // namespace splatvol
