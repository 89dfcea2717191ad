#include "surfaces/surface.h"

#include <algorithm>
#include <utility>

namespace splatvol {
namespace {

std::shared_ptr<const TriangleMesh> find_mesh(std::span<const Surface> surfaces, const SceneSurface& style) {
  const auto found = std::ranges::find_if(surfaces, [&](const Surface& one) {
    return one.mesh && one.style.file == style.file && one.style.boundary == style.boundary;
  });
  return found == surfaces.end() ? nullptr : found->mesh;
}

Result<TriangleMesh> read(const SceneSurface& style, const SurfaceReaders& readers) {
  if (!style.boundary.empty()) return readers.boundary(style.boundary);
  if (readers.file) return readers.file(style.file);
  return fail(ErrorCode::unsupported,
              "surfaces: {} is read by the programs svrender, svview and svtruth only; set its \"shown\" to false",
              style.file);
}

}  // namespace

Result<std::vector<Surface>> read_surfaces(std::span<const SceneSurface> styles, const SurfaceReaders& readers,
                                           std::span<const Surface> before) {
  std::vector<Surface> surfaces;
  for (const SceneSurface& style : styles) {
    auto mesh = find_mesh(before, style);
    if (!mesh) mesh = find_mesh(surfaces, style);
    if (!mesh && style.shown) {
      SPLATVOL_TRY_ASSIGN(triangles, read(style, readers));
      mesh = std::make_shared<const TriangleMesh>(std::move(triangles));
    }
    surfaces.push_back({style, std::move(mesh)});
  }
  return surfaces;
}

}  // namespace splatvol
