// The patches that the rest of a boundary becomes, the faces that no patch of the input has: those on the sides of the
// domain's box, and the connected parts of the others.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/math.h"

namespace splatvol {

/// Most patches that the rest becomes: 31 parts by their size, and all smaller ones together. Loose cells may be
/// thousands of parts.
inline constexpr std::size_t most_rest_parts = 32;

/// The sides of the domain's box: x-, x+, y-, y+, z-, z+.
inline constexpr std::size_t box_sides = 6;

/// Returns the names of the patches on the sides: "side x-", "side x+", ..., "side z+".
[[nodiscard]] std::vector<std::string> names_of_sides();

/// Returns the side of a box that a triangle lies on, up to a millionth of the box; none if it lies on none.
[[nodiscard]] std::optional<std::size_t> side_of(const Box& box, const std::array<dvec3, 3>& corners);

/// Splits the rest, the triangles of patch 0, into connected parts: triangles that share a point are of one part.
/// Sharing an edge would not do: at hanging nodes a long edge meets two short ones. Triangles on the sides, of the
/// patches `sides` to `sides` + 5, count for parts, but stay in their patches. The k-th part becomes patch
/// `first` + k of `patches` ([triangle]), the part with the longest diagonal of its box first. Parts of one size are in
/// the order of their boxes' low corners, by x, then y, then z. Sizes and corners count as equal within about a
/// millionth of the box round all parts, so that rounding does not change the order. If there are more than `most`
/// parts, the last one holds all smaller ones.
/// Returns the names of the parts: "outer 1", "outer 2", ..., and "outer rest" for the smaller ones; an empty name for
/// one that is on the sides only. Returns none and changes nothing if there is one part, and nothing of it on a side;
/// or if `most` is below 2. Requires indices in range, at least one triangle with points at different positions in each
/// part, and most <= most_rest_parts.
[[nodiscard]] std::vector<std::string> split_rest(std::span<const dvec3> points,
                                                  std::span<const std::array<std::uint32_t, 3>> triangles,
                                                  std::size_t most, std::uint32_t sides, std::uint32_t first,
                                                  std::vector<std::uint32_t>& patches);

/// Whether a part or a side may have this name.
[[nodiscard]] bool is_rest_part(std::string_view name);

}  // namespace splatvol
