#include "builder/pipeline/store_cells.h"

#include "builder/pipeline/reduce_source.h"
#include "builder/pipeline/store_boundary.h"

namespace splatvol {

Result<std::unique_ptr<MeshCells>> start_cells(const Source& source, const BuildOptions& options,
                                               const std::string& folder) {
  if (!options.keep_cells) return nullptr;
  if (options.connectivity == Connectivity::none || options.connectivity == Connectivity::boxes)
    return fail(ErrorCode::invalid_argument,
                "the connectivity '{}' joins points without tetrahedra: take --connectivity delaunay, or leave "
                "--keep-cells out",
                connectivity_name(options.connectivity));
  const bool no_mesh = options.connectivity == Connectivity::mesh && !source.may_have_cells();
  if (no_mesh || (uses_cells(options) && source.brings_material()))
    return fail(ErrorCode::invalid_argument, "the input has no cells that a file can keep: leave --keep-cells out");
  return MeshCells::create(options.memory / 2, folder, options.exact.positions);
}

// Points that are joined by tetrahedra have their ranks by then.
bool keeps_cells_of_pieces(const Source& source, const BuildOptions& options) {
  return options.keep_cells && uses_cells(options) && source.may_have_cells();
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
