// Polyhedra on their way into a file.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "builder/sources/source.h"
#include "format/layout.h"
#include "format/polyhedron.h"

namespace splatvol {

/// A polyhedron whose corners have numbers: of points of a piece, ranks, or numbers of vertices.
struct Polyhedron {
  std::vector<std::uint64_t> corners;              // different ones, ascending
  std::vector<format::SurfaceTriangle> triangles;  // its surface, as indices of its corners
  std::uint64_t point = 0;                         // of a constant field
  std::uint8_t apex = 0;                           // index of the corner that its tetrahedra share
  int sign = 0;                                    // SpooledCell::sign
};

/// Joins tetrahedra that share their last corner. Returns false if they do not, or if a file cannot keep them as one.
/// Then put_polyhedron() may still return false. Sets corners, surface and apex.
[[nodiscard]] bool join_tetrahedra(std::span<const Tetrahedron> tetrahedra, Polyhedron& polyhedron);

/// Gives the corners other numbers, [corner]. Returns false, and changes nothing, if two are the same.
[[nodiscard]] bool renumber(std::span<const std::uint64_t> numbers, Polyhedron& polyhedron);

/// Appends a polyhedron in few bytes: the same ones for any order of its triangles. Returns false if these are no
/// surface that a file can keep.
[[nodiscard]] bool put_polyhedron(const Polyhedron& polyhedron, std::vector<std::byte>& bytes);

/// Takes a polyhedron from the front of `bytes`. Its surface may be turned round, and then it has the other sign.
void get_polyhedron(std::span<const std::byte>& bytes, Polyhedron& polyhedron);

}  // namespace splatvol
