#include "builder/pipeline/store_cells.h"

#include "builder/pipeline/reduce_source.h"
#include "builder/pipeline/store_boundary.h"

namespace splatvol {

Result<std::unique_ptr<MeshCells>> start_cells(const Source& source, const BuildOptions& options,
                                               const std::string& folder) {
  if (!options.keep_cells) return nullptr;
  if (!source.may_have_cells() || source.brings_material() || !uses_cells(options))
    return fail(ErrorCode::invalid_argument, "the input has no cells that a file can keep: leave --keep-cells out");
  return MeshCells::create(options.memory / 2, folder, options.exact.positions);
}

WatchPoints watch_points(BoundaryFaces* faces, MeshCells* cells) {
  if (!cells) return {faces_of(faces)};
  return {[cells, add_faces = faces_of(faces)](Piece& piece) -> Status {
            SPLATVOL_TRY(cells->add(piece));
            return add_faces ? add_faces(piece) : Status{};
          },
          [cells](PointTag tag, std::uint64_t rank) { return cells->add_rank(tag, rank); }};
}

}  // namespace splatvol
