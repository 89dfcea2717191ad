#include "surfaces/surface.h"

#include <algorithm>
#include <utility>

namespace splatvol {
namespace {

std::shared_ptr<const TriangleMesh> find_mesh(std::span<const Surface> surfaces, const std::string& file) {
  const auto found =
      std::ranges::find_if(surfaces, [&](const Surface& one) { return one.mesh && one.style.file == file; });
  return found == surfaces.end() ? nullptr : found->mesh;
}

}  // namespace

Result<std::vector<Surface>> read_surfaces(std::span<const SceneSurface> styles, const ReadSurface& read,
                                           std::span<const Surface> before) {
  std::vector<Surface> surfaces;
  for (const SceneSurface& style : styles) {
    auto mesh = find_mesh(before, style.file);
    if (!mesh) mesh = find_mesh(surfaces, style.file);
    if (!mesh && style.shown) {
      if (!read)
        return fail(
            ErrorCode::unsupported,
            "surfaces: {} is read by the programs svrender, svview and svtruth only; set its \"shown\" to false",
            style.file);
      SPLATVOL_TRY_ASSIGN(triangles, read(style.file));
      mesh = std::make_shared<const TriangleMesh>(std::move(triangles));
    }
    surfaces.push_back({style, std::move(mesh)});
  }
  return surfaces;
}

}  // namespace splatvol
