#include "builder/connect.h"

#include <tbb/parallel_for.h>

#include <utility>
#include <vector>

#include "builder/mesh/boundary.h"
#include "builder/mesh/moments.h"
#include "builder/points/held_points.h"
#include "builder/scattered/scattered.h"

namespace splatvol {
namespace {

// Bytes for each scattered point that is held.
constexpr std::uint64_t held_point_bytes = 700;

// Most vertices of a mesh that are held. Of so few vertices, merging may leave too few to reduce.
constexpr std::uint64_t most_held_vertices = std::uint64_t{1} << 16;

// Gives each point of a triangulation its part of the tetrahedra.
void add_mesh_material(const std::vector<Tetrahedron>& tetrahedra, PointBatch& points) {
  const VertexMaterial mesh(points.positions, tetrahedra);
  points.moments.resize(points.size());
  for (std::size_t a = 0; a < points.values.size(); ++a) {
    points.value_moments[a].resize(points.size());
    points.gradients[a].resize(points.size());
  }
  tbb::parallel_for(std::size_t{0}, points.size(), [&](std::size_t i) {
    points.moments[i] = mesh.moments(i);
    for (std::size_t a = 0; a < points.values.size(); ++a) {
      points.value_moments[a][i] = mesh.value_moments(i, points.values[a]);
      points.gradients[a][i] = mesh.gradient(i, points.values[a]);
    }
  });
  points.planes = boundary_planes(points.positions, find_outer_faces(points.positions, tetrahedra));
}

Status add_voronoi_material(PointBatch& points) {
  SPLATVOL_TRY_ASSIGN(material, ScatteredEstimate::create(points.positions));
  points.moments = material.spatial();
  for (std::size_t a = 0; a < points.values.size(); ++a) {
    points.value_moments[a] = material.values(points.values[a]);
    points.gradients[a] = material.gradients(points.values[a]);
  }
  return {};
}

// Adds the material of points without cells. Returns the connectivity that was used.
Result<Connectivity> add_scattered_material(Connectivity wanted, PointBatch& points) {
  if (wanted != Connectivity::none) {
    SPLATVOL_TRY_ASSIGN(tetrahedra, delaunay_tetrahedra(points.positions));
    if (!tetrahedra.empty() || wanted != Connectivity::automatic) {
      add_mesh_material(tetrahedra, points);
      return Connectivity::delaunay;
    }
  }
  SPLATVOL_TRY(add_voronoi_material(points));
  return Connectivity::none;
}

NextPoints next_of(PointStream& points) {
  return [&points](PointBatch& batch) { return points.next(batch); };
}

Result<PointBatch> hold_all(PointStream& points) {
  return hold_all(next_of(points), points.summary().attributes.size());
}

Connection held_connection(Connectivity used, PointBatch points) {
  const std::uint64_t count = points.size();
  return {used, stream_of(std::move(points)), count};
}

// Holds a small mesh: the number of vertices that merging leaves decides whether they are reduced at all.
Result<Connection> connect_mesh(PointStream& points) {
  if (points.count() > most_held_vertices) return Connection{Connectivity::mesh, next_of(points), points.count()};
  SPLATVOL_TRY_ASSIGN(all, hold_all(points));
  return held_connection(Connectivity::mesh, std::move(all));
}

Result<Connection> connect_many(const BuildOptions& options, PointStream& points, const std::string& folder) {
  if (options.connectivity != Connectivity::delaunay)
    return Connection{
        .used = Connectivity::none, .next = next_of(points), .points = points.count(), .needs_estimate = true};
  SPLATVOL_TRY_ASSIGN(created, DelaunaySubdomains::create(points, options.memory / 2, folder));
  const auto subdomains = std::make_shared<DelaunaySubdomains>(std::move(created));
  return Connection{.used = Connectivity::delaunay,
                    .next = [subdomains](PointBatch& batch) { return subdomains->next(batch); },
                    .points = points.count(),
                    .subdomains = subdomains};
}

Result<Connection> connect_held(const BuildOptions& options, PointStream& points) {
  const std::uint64_t needed = points.count() * held_point_bytes;
  if (needed > options.memory && points.count() > most_held_vertices)
    return fail(ErrorCode::out_of_budget,
                "to join {} scattered points takes about {} bytes of memory, and {} may be held: grant more",
                points.count(), needed, options.memory);
  SPLATVOL_TRY_ASSIGN(all, hold_all(points));
  SPLATVOL_TRY_ASSIGN(used, add_scattered_material(options.connectivity, all));
  return held_connection(used, std::move(all));
}

}  // namespace

Result<Connection> connect(const BuildOptions& options, PointStream& points, const std::string& folder) {
  if (points.summary().has_material) return connect_mesh(points);
  if (options.connectivity == Connectivity::mesh)
    return fail(ErrorCode::invalid_data, "no cells that fill a volume: the connectivity 'mesh' needs some");
  const std::string no_volume = describe_no_volume(points.summary().cells);
  if (options.connectivity == Connectivity::automatic && !no_volume.empty())
    return fail(ErrorCode::invalid_data, "{}; splatvol draws volumes; --connectivity delaunay joins the points anyway",
                no_volume);
  if (points.count() > options.held_points) return connect_many(options, points, folder);
  return connect_held(options, points);
}

}  // namespace splatvol
