// The patches of a mesh's boundary, for tests of sources.
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "base/names.h"
#include "builder/boundary/boundary_faces.h"
#include "builder/boundary/simplify.h"
#include "tests/builder/sources/read_input.h"

namespace splatvol::test {

/// The triangles of each patch of an input's boundary; "outer": of all others together. `folder`: for temporary files.
inline std::map<std::string, std::size_t> patches_of(const std::vector<std::string>& paths, const std::string& folder,
                                                     SourceOptions options = {}) {
  options.patches = true;
  std::map<std::string, std::size_t> triangles;
  const auto input = read_input(paths, options);
  EXPECT_TRUE(input) << input.error().message;
  if (!input) return triangles;
  auto faces = BoundaryFaces::create(BoundaryFaces::least_memory(), folder);
  for (const Piece& piece : input->pieces) EXPECT_TRUE(faces->add(piece));
  const auto boundary = whole_boundary(*faces);
  EXPECT_TRUE(boundary) << boundary.error().message;
  for (const Patch& patch : boundary->patches)
    triangles[is_patch_of_rest(patch.name) ? "outer" : patch.name] += patch.mesh.triangles.size();
  return triangles;
}

}  // namespace splatvol::test
