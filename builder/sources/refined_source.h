// Any mesh in more and smaller tetrahedra: the same shape and the same field, at any size.
#pragma once

#include <memory>
#include <string>

#include "builder/sources/source.h"

namespace splatvol {

inline constexpr int most_refinements = 5;

/// The tetrahedra of `source`, each split into eight `levels` times (1 to most_refinements), in pieces of at most about
/// 1.5 million. New points are the middles of edges, with the means of their ends' values; a value is missing where one
/// of them is, so that a cell with a missing corner stays hidden whole. So the field, linear in each tetrahedron, stays
/// what it was, to rounding: the refined mesh looks exactly as the mesh does, and tells nothing more of what it shows.
/// Pieces repeat their common points exactly.
///
/// An octahedron that is left in a tetrahedron's middle is cut along the diagonal that Bey (Computing 55, 1995)
/// chooses, so that shapes fall into at most three classes, however deep it goes. Orientations stay.
///
/// Points that no tetrahedron uses are left out. next() fails, naming `name`, where a piece of the source has no
/// tetrahedra. Holds one piece of the source beside those that it makes.
[[nodiscard]] std::unique_ptr<Source> refine(std::unique_ptr<Source> source, int levels, const std::string& name);

}  // namespace splatvol
