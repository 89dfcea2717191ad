// Refines any mesh into more and smaller tetrahedra: the same shape and the same field, at any size.
#pragma once

#include <memory>
#include <string>

#include "builder/sources/source.h"

namespace splatvol {

inline constexpr int most_refinements = 5;

/// Splits each tetrahedron of `source` into eight, `refinements` times (1 to most_refinements), in pieces of at most
/// about 1.5 million. New points are the middles of edges; their values are the means of the edges' ends. If one of the
/// ends has no value, the middle has none, so a cell with a missing corner stays hidden whole. Up to rounding the
/// field, linear in each tetrahedron, does not change: the refined mesh looks exactly like the mesh, and adds no
/// detail. Pieces repeat their common points exactly.
///
/// The octahedron in the middle of a split tetrahedron is cut along the diagonal that Bey (Computing 55, 1995) chooses:
/// shapes fall into at most three classes, at any number of refinements. Orientations stay.
///
/// Points that no tetrahedron uses are left out. next() fails, naming `name`, if a piece of the source has no
/// tetrahedra. Holds one piece of the source and the pieces that it makes of it.
[[nodiscard]] std::unique_ptr<Source> refine(std::unique_ptr<Source> source, int refinements, const std::string& name);

}  // namespace splatvol
