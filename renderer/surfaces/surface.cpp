#include "renderer/surfaces/surface.h"

#include <algorithm>
#include <utility>

namespace splatvol {
namespace {

// Returns a surface with these triangles, or null.
const Surface* find_read(std::span<const Surface> surfaces, const SceneSurface& style) {
  const auto found = std::ranges::find_if(surfaces, [&](const Surface& one) {
    return one.mesh && one.style.file == style.file && one.style.boundary == style.boundary;
  });
  return found == surfaces.end() ? nullptr : &*found;
}

Result<TriangleMesh> read(const SceneSurface& style, const SurfaceReaders& readers) {
  if (!style.boundary.empty()) return readers.boundary(style.boundary);
  if (readers.file) return readers.file(style.file);
  return fail(ErrorCode::unsupported,
              "surfaces: {} is read by the programs svrender, svview and svtruth only; set its \"shown\" to false",
              style.file);
}

}  // namespace

double Surface::opacity(std::size_t triangle, bool from_outside) const {
  if (!has_near_side() || !from_outside || mesh->is_two_sided(triangle)) return style.opacity;
  return style.near_side == NearSide::hidden ? 0 : near_side_share * style.opacity;
}

double Surface::value(std::size_t triangle, const std::array<double, 3>& shares) const {
  if (values->of_triangles) return values->values[triangle];
  double sum = 0;
  for (std::size_t k = 0; k < 3; ++k) sum += shares[k] * values->values[mesh->triangles[triangle][k]];
  return sum;
}

Result<std::vector<Surface>> read_surfaces(std::span<const SceneSurface> styles, const SurfaceReaders& readers,
                                           std::span<const Surface> before) {
  std::vector<Surface> surfaces;
  for (const SceneSurface& style : styles) {
    const Surface* same = find_read(before, style);
    if (!same) same = find_read(surfaces, style);
    Surface surface{style, same ? same->mesh : nullptr, same ? same->left_out : std::vector<std::string>()};
    if (!same && style.shown) {
      SPLATVOL_TRY_ASSIGN(triangles, read(style, readers));
      surface.mesh = std::make_shared<const TriangleMesh>(std::move(triangles));
    }
    surfaces.push_back(std::move(surface));
  }
  return surfaces;
}

}  // namespace splatvol
