// A file with a vector.
#pragma once

#include <string>

#include "builder/pipeline/build.h"
#include "tests/builder/support/meshes.h"
#include "tests/builder/support/piece_source.h"
#include "tests/support/require.h"

namespace splatvol::test {

/// Writes a cube in which all moves along an axis, with the attributes U[0], U[1], U[2] and speed.
inline void write_moving(const std::string& path, int along = 0) {
  const Mesh mesh = lattice(8);
  const auto speed = [](dvec3 p) { return 1 + p.x; };
  Piece piece = mesh_piece(mesh, speed);
  const auto moving = piece.values[0], resting = mesh_piece(mesh, [](dvec3) { return 0.0; }).values[0];
  piece.values.assign(3, resting);
  piece.values[static_cast<std::size_t>(along)] = moving;
  piece.values.push_back(moving);
  PieceSource source({piece}, {.attributes = {"U[0]", "U[1]", "U[2]", "speed"}});
  require(build_volume(source, path, {.keep_cells = true}, [](const char*, double) {}));
}

}  // namespace splatvol::test
