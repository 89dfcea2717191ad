#include "builder/pipeline/connect.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "builder/mesh/boundary.h"
#include "builder/mesh/moments.h"
#include "builder/points/cell_subdomains.h"
#include "builder/points/held_points.h"
#include "builder/reduction/cascade.h"
#include "builder/scattered/scattered.h"

namespace splatvol {
namespace {

// More scattered points have boxes by default: Voronoi cells of a billion points take hours.
constexpr std::uint64_t most_cells = std::uint64_t{1} << 26;

// Points up to this number are joined whatever the memory.
constexpr std::uint64_t always_joined = std::uint64_t{1} << 16;

// Points whose material one task finds.
constexpr std::size_t task_points = 64;

NextPoints next_of(PointStream& points) {
  return [&points](PointBatch& batch) { return points.next(batch); };
}

Result<PointBatch> hold_all(PointStream& points) {
  return hold_all(next_of(points), points.summary().attributes.size());
}

// Makes room for the material of the points that were added to a batch last. Returns the first of them.
std::size_t grow_material(PointBatch& batch, bool gradients) {
  const std::size_t first = batch.moments.size();
  batch.moments.resize(batch.size());
  for (std::size_t a = 0; a < batch.values.size(); ++a) {
    batch.value_moments[a].resize(batch.size());
    if (gradients) batch.gradients[a].resize(batch.size());
  }
  return first;
}

// Points that are joined by tetrahedra.
struct JoinedMesh {
  std::vector<Tetrahedron> tetrahedra;
  std::vector<BoundaryPlane> planes;
  std::optional<VertexMaterial> material;  // once the points lie where they stay
  bool gradients;
  tbb::enumerable_thread_specific<VertexBlock> blocks = {};

  // Finds the material of the points [begin, end), which go to `first` and on.
  void find(const PointBatch& held, std::size_t begin, std::size_t end, std::size_t first, PointBatch& batch) {
    const auto take = [&](std::size_t k, const SpatialMoments& moments, std::span<const VertexValue> values) {
      batch.moments[first + k] = moments;
      for (std::size_t a = 0; a < values.size(); ++a) {
        batch.value_moments[a][first + k] = values[a].moments;
        if (gradients) batch.gradients[a][first + k] = values[a].gradient;
      }
    };
    material->find_values(begin, end, held.values, gradients, blocks.local(), take);
  }
};

// Gives each point of a triangulation its part of the tetrahedra.
NextPoints stream_of_mesh(std::vector<Tetrahedron> tetrahedra, PointBatch points, bool gradients) {
  auto planes = boundary_planes(points.positions, find_outer_faces(points.positions, tetrahedra));
  const auto mesh =
      std::make_shared<JoinedMesh>(JoinedMesh{std::move(tetrahedra), std::move(planes), std::nullopt, gradients});
  return stream_of(
      std::move(points), [mesh](const PointBatch& held, std::size_t begin, std::size_t end, PointBatch& batch) {
        if (!mesh->material) mesh->material.emplace(held.positions, mesh->tetrahedra);
        const std::size_t first = grow_material(batch, mesh->gradients);
        const auto at = [&](std::size_t i) { return mesh->planes.begin() + static_cast<std::ptrdiff_t>(i); };
        batch.planes.insert(batch.planes.end(), at(begin), at(end));
        const std::size_t tasks = (end - begin + task_points - 1) / task_points;
        tbb::parallel_for(std::size_t{0}, tasks, [&](std::size_t task) {
          const std::size_t from = begin + task * task_points;
          mesh->find(held, from, std::min(end, from + task_points), first + task * task_points, batch);
        });
      });
}

// Holds the first vertices of a mesh: so many that merging cannot leave too few to reduce, or all.
Result<Connection> connect_mesh(PointStream& points) {
  SPLATVOL_TRY_ASSIGN(held, hold_all(next_of(points), points.summary().attributes.size(), coarsest_target));
  const std::uint64_t count = held.size() <= coarsest_target ? held.size() : points.count();
  const NextPoints first = stream_of(std::move(held));
  return Connection{Connectivity::mesh,
                    [first, &points](PointBatch& batch) -> Result<bool> {
                      SPLATVOL_TRY_ASSIGN(more, first(batch));
                      return more ? Result<bool>(true) : points.next(batch);
                    },
                    count};
}

Status keep(std::span<const Tetrahedron> tetrahedra, std::span<const dvec3> positions, MeshCells& cells) {
  constexpr std::size_t most = std::size_t{1} << 16;
  std::vector<RankedTetrahedron> ranked;
  for (std::size_t begin = 0; begin < tetrahedra.size(); begin += most) {
    ranked.clear();
    for (const auto& [a, b, c, d] : tetrahedra.subspan(begin, std::min(most, tetrahedra.size() - begin)))
      ranked.push_back({{a, b, c, d}, sign_of_volume(positions[a], positions[b], positions[c], positions[d])});
    SPLATVOL_TRY(cells.add_joined(ranked));
  }
  return {};
}

Connection connect_by_boxes(NextPoints next, std::uint64_t count) {
  return {.used = Connectivity::boxes, .next = std::move(next), .points = count, .needs_estimate = true};
}

Result<Connection> connect_by_cells(const BuildOptions& options, PointStream& points, const std::string& folder) {
  SPLATVOL_TRY_ASSIGN(created, CellSubdomains::create(points, options.memory / 2, folder));
  const auto subdomains = std::make_shared<CellSubdomains>(std::move(created));
  return Connection{.used = Connectivity::none,
                    .next = [subdomains](PointBatch& batch) { return subdomains->next(batch); },
                    .points = points.count(),
                    .least_memory = subdomains->least_memory(),
                    .memory = subdomains->memory()};
}

// Joins points by tetrahedra, subdomain by subdomain.
Result<Connection> connect_many(const BuildOptions& options, PointStream& points, const std::string& folder,
                                MeshCells* cells) {
  TakeTetrahedra take;
  if (cells) take = [cells](std::span<const RankedTetrahedron> tetrahedra) { return cells->add_joined(tetrahedra); };
  SPLATVOL_TRY_ASSIGN(created, DelaunaySubdomains::create(points, options.memory / 2, folder,
                                                          DelaunaySubdomains::default_subdomain_points,
                                                          DelaunaySubdomains::default_most_points, std::move(take)));
  const auto subdomains = std::make_shared<DelaunaySubdomains>(std::move(created));
  return Connection{.used = Connectivity::delaunay,
                    .next = [subdomains](PointBatch& batch) { return subdomains->next(batch); },
                    .points = points.count(),
                    .subdomains = subdomains};
}

// Joins points by tetrahedra, all at once; by boxes if no four points span a volume.
Result<Connection> connect_held(const BuildOptions& options, PointStream& points, MeshCells* cells,
                                const std::function<void(double)>& progress) {
  const std::uint64_t needed =
      points.count() * (joined_point_bytes + joined_value_bytes * points.summary().attributes.size());
  if (needed > options.memory && points.count() > always_joined)
    return fail(ErrorCode::out_of_budget,
                "to join {} scattered points takes about {} bytes of memory, and {} may be held: grant more",
                points.count(), needed, options.memory);
  SPLATVOL_TRY_ASSIGN(all, hold_all(points));
  SPLATVOL_TRY_ASSIGN(tetrahedra, delaunay_tetrahedra(all.positions, progress));
  if (tetrahedra.empty() && options.connectivity == Connectivity::delaunay)
    return fail(ErrorCode::invalid_data,
                "the points lie at one place, on a line or in a plane: no tetrahedron joins them; --connectivity none "
                "draws them");
  const std::uint64_t count = all.size();
  if (tetrahedra.empty()) return connect_by_boxes(stream_of(std::move(all)), count);
  if (cells) SPLATVOL_TRY(keep(tetrahedra, all.positions, *cells));
  return Connection{.used = Connectivity::delaunay,
                    .next = stream_of_mesh(std::move(tetrahedra), std::move(all), options.gradients),
                    .points = count,
                    .least_memory = needed};
}

}  // namespace

// Voxels bring their material without tetrahedra.
bool is_joined_by_cells(const InputSummary& input) {
  return input.has_material && (describe_no_volume(input.cells).empty() || input.cells.tetrahedra == 0);
}

Connectivity connectivity_of_points(const BuildOptions& options, std::uint64_t count) {
  if (options.connectivity != Connectivity::automatic) return options.connectivity;
  if (count <= options.held_points) return Connectivity::delaunay;
  return count > most_cells ? Connectivity::boxes : Connectivity::none;
}

Result<Connection> connect(const BuildOptions& options, PointStream& points, const std::string& folder,
                           MeshCells* cells, const std::function<void(double)>& progress) {
  const std::string no_volume = describe_no_volume(points.summary().cells);
  if (is_joined_by_cells(points.summary())) return connect_mesh(points);
  if (options.connectivity == Connectivity::mesh)
    return fail(ErrorCode::invalid_data, "no cells that fill a volume: the connectivity 'mesh' needs some");
  // The points of surfaces that were left out are not there to be joined.
  if (const auto left_out = points.summary().cells.left_out; left_out > 0 && !no_volume.empty())
    return fail(ErrorCode::invalid_data, "{}, and {} cells of surfaces; splatvol draws volumes", no_volume, left_out);
  if (options.connectivity == Connectivity::automatic && !no_volume.empty())
    return fail(ErrorCode::invalid_data, "{}; splatvol draws volumes; --connectivity delaunay joins the points anyway",
                no_volume);
  switch (connectivity_of_points(options, points.count())) {
    case Connectivity::boxes:
      return connect_by_boxes(next_of(points), points.count());
    case Connectivity::none:
      return connect_by_cells(options, points, folder);
    default:
      return points.count() > options.held_points ? connect_many(options, points, folder, cells)
                                                  : connect_held(options, points, cells, progress);
  }
}

}  // namespace splatvol
