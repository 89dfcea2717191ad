#include "builder/pipeline/store_cells.h"

#include "builder/pipeline/reduce_source.h"
#include "builder/pipeline/store_boundary.h"

namespace splatvol {
namespace {

// Whether there may be cells to keep. Voxels have none. Points that `automatic` joins may be too many for tetrahedra.
bool may_keep_cells(const Source& source, const BuildOptions& options) {
  if (!options.keep_cells || (uses_cells(options) && source.brings_material())) return false;
  if (options.connectivity == Connectivity::mesh) return source.may_have_cells();
  return options.connectivity == Connectivity::automatic || options.connectivity == Connectivity::delaunay;
}

}  // namespace

Result<std::unique_ptr<MeshCells>> start_cells(const Source& source, const BuildOptions& options,
                                               const std::string& folder) {
  if (!may_keep_cells(source, options)) return nullptr;
  return MeshCells::create(options.memory / 2, folder, options.exact.positions);
}

// Points that are joined by tetrahedra have their ranks by then.
bool keeps_cells_of_pieces(const Source& source, const BuildOptions& options) {
  return may_keep_cells(source, options) && uses_cells(options) && source.may_have_cells();
}

WatchPoints watch_points(const Source& source, const BuildOptions& options, BoundaryFaces* faces, MeshCells* cells) {
  if (!keeps_cells_of_pieces(source, options)) return {faces_of(faces)};
  return {[cells, add_faces = faces_of(faces)](Piece& piece) -> Status {
            SPLATVOL_TRY(cells->add(piece));
            return add_faces ? add_faces(piece) : Status{};
          },
          [cells](PointTag tag, std::uint64_t rank) { return cells->add_rank(tag, rank); }};
}

}  // namespace splatvol
