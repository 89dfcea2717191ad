// The surface of a polyhedron to and from few bytes.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace splatvol::format {

/// A triangle of a surface: numbers of corners, counterclockwise from outside.
using SurfaceTriangle = std::array<std::uint8_t, 3>;

inline constexpr std::size_t least_polyhedron_corners = 4, max_polyhedron_corners = 255;

/// The triangles of a surface without holes that has so many corners, and the bytes of its code.
[[nodiscard]] constexpr std::size_t surface_triangles(std::size_t corners) { return 2 * corners - 4; }
[[nodiscard]] constexpr std::size_t surface_code_bytes(std::size_t corners) { return surface_triangles(corners) + 1; }

enum class SurfaceCoding : std::uint8_t { failed, as_given, mirrored };

/// Appends the code of a surface whose corners have the numbers 0 to corners - 1. The code depends neither on the order
/// of the triangles, nor on whether all of them are turned round: `mirrored` tells that they come back so. Fails, and
/// appends nothing, unless the surface is closed and oriented, in one part, uses all corners, and has
/// surface_triangles(corners) triangles: then it is that of a ball. Requires 4 to 255 corners, and numbers below.
[[nodiscard]] SurfaceCoding encode_surface(std::span<const SurfaceTriangle> triangles, std::size_t corners,
                                           std::vector<std::byte>& code);

/// Undoes encode_surface. The triangles come in another order. Returns whether they are a surface as there. Requires
/// 4 to 255 corners, surface_code_bytes(corners) bytes and surface_triangles(corners) triangles. Safe on untrusted
/// `code`.
[[nodiscard]] bool decode_surface(std::span<const std::byte> code, std::size_t corners,
                                  std::span<SurfaceTriangle> triangles);

/// Calls visit(tetrahedron) for the tetrahedra of a polyhedron: the apex with each triangle that does not have it.
template <class Visit>
void for_each_tetrahedron(std::span<const SurfaceTriangle> triangles, std::size_t apex, const Visit& visit) {
  for (const auto& [a, b, c] : triangles)
    if (a != apex && b != apex && c != apex) visit(std::array{a, c, b, static_cast<std::uint8_t>(apex)});
}

}  // namespace splatvol::format
