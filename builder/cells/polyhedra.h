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

/// Records of a sort: a polyhedron has one or more. Their words are: the rank of its lowest corner, or of its point if
/// the field is constant; a hash of it, above the record's number in the lowest byte; its bytes.
inline constexpr std::size_t polyhedron_record_words = 8;

/// Appends the records of a polyhedron whose corners are ranks, or numbers of vertices. Returns its hash, which depends
/// neither on its sign nor on the order of its triangles. Requires a surface that a file can keep.
std::uint64_t append_records(const Polyhedron& polyhedron, format::CellField field,
                             std::vector<std::uint64_t>& records);

/// The number of records of a polyhedron, which its first one tells.
[[nodiscard]] std::size_t record_count(std::span<const std::uint64_t> record);

/// Undoes append_records(), as get_polyhedron().
void read_records(std::span<const std::uint64_t> records, Polyhedron& polyhedron);

}  // namespace splatvol
