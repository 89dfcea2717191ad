#include "builder/pipeline/store_boundary.h"

#include <algorithm>
#include <utility>

#include "builder/boundary/simplify.h"

namespace splatvol {

Result<std::unique_ptr<BoundaryFaces>> start_boundary(const Source& source, const BuildOptions& options,
                                                      const std::string& folder) {
  if (options.boundary_triangles == 0) return nullptr;
  const bool may_have_faces = source.may_have_cells() && !source.brings_material();
  if (!may_have_faces && options.boundary_if_any) return nullptr;
  if (!may_have_faces)
    return fail(ErrorCode::invalid_argument, "the input has no cells, and so no boundary: leave the boundary out");
  const std::size_t memory = std::max<std::size_t>(options.memory / 16, BoundaryFaces::least_memory());
  SPLATVOL_TRY_ASSIGN(faces, BoundaryFaces::create(memory, folder));
  return std::make_unique<BoundaryFaces>(std::move(faces));
}

Status check_boundary(std::unique_ptr<BoundaryFaces>& faces, const BuildOptions& options) {
  if (!faces) return {};
  Status found = faces->check_any();
  if (found || !options.boundary_if_any) return found;
  faces.reset();
  return {};
}

Result<StoredBoundary> finish_boundary(BoundaryFaces& faces, const BuildOptions& options,
                                       const BuildProgress& progress) {
  progress("simplifying the boundary", 0);
  SPLATVOL_TRY_ASSIGN(boundary, simplified_boundary(faces, options.boundary_triangles));
  StoredBoundary stored;
  stored.held_bytes = boundary.held_bytes;
  SPLATVOL_TRY_SET(stored.packed, format::pack_boundary(boundary.patches, boundary.error));
  stored.report = {.patches = {},
                   .kept = boundary.kept,
                   .triangles = boundary.triangles,
                   .error = stored.packed.info.error,
                   .bytes = stored.packed.section.size()};
  for (const format::PatchInfo& patch : stored.packed.info.patches)
    stored.report.patches.emplace_back(patch.name, patch.triangles);
  return stored;
}

}  // namespace splatvol
