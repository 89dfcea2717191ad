// A file with a vector.
#pragma once

#include <string>

#include "builder/pipeline/build.h"
#include "tests/builder/support/meshes.h"
#include "tests/builder/support/piece_source.h"
#include "tests/support/require.h"

namespace splatvol::test {

/// Writes a cube in which all moves along x, with the attributes U[0], U[1], U[2] and speed.
inline void write_moving(const std::string& path) {
  const Mesh mesh = lattice(8);
  Piece piece = mesh_piece(mesh, [](dvec3 p) { return 1 + p.x; });
  for (int axis = 0; axis < 2; ++axis) piece.values.push_back(mesh_piece(mesh, [](dvec3) { return 0.0; }).values[0]);
  piece.values.push_back(mesh_piece(mesh, [](dvec3 p) { return 1 + p.x; }).values[0]);
  PieceSource source({piece}, {.attributes = {"U[0]", "U[1]", "U[2]", "speed"}});
  require(build_volume(source, path, {.keep_cells = true}, [](const char*, double) {}));
}

}  // namespace splatvol::test
