// Files of meshes in memory.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "builder/pipeline/build.h"
#include "builder/series/series_build.h"
#include "tests/builder/support/meshes.h"
#include "tests/builder/support/piece_source.h"
#include "tests/support/require.h"

namespace splatvol::test {

/// Builds the volume of a mesh with the attribute "value". Ends the program if that fails.
inline void build_mesh(const Mesh& mesh, const std::function<double(dvec3)>& field, const std::string& path,
                       const BuildOptions& options = {}) {
  PieceSource source({mesh_piece(mesh, field)});
  require(build_volume(source, path, options, [](const char*, double) {}));
}

/// A step of a time series with the same attribute.
inline SeriesStep mesh_step(std::optional<double> time, const Mesh& mesh, const std::function<double(dvec3)>& field) {
  return {"a step", time, [piece = mesh_piece(mesh, field)]() -> Result<std::unique_ptr<Source>> {
            return std::make_unique<PieceSource>(std::vector{piece});
          }};
}

}  // namespace splatvol::test
