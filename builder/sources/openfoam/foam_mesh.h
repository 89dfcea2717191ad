// The mesh in a folder polyMesh.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "base/math.h"
#include "builder/sources/openfoam/foam_lists.h"
#include "builder/sources/openfoam/foam_reader.h"

namespace splatvol {

/// A patch of the boundary: faces of a mesh, one after the other.
struct FoamPatch {
  std::string name;
  std::string type;
  std::uint64_t first_face = 0, face_count = 0;
  std::optional<std::uint64_t> neighbour_processor = {};  // on its other side

  /// Whether it lies within the mesh, between processors.
  [[nodiscard]] bool is_between_processors() const { return type.starts_with("processor"); }
};

/// A mesh of polyhedra. Face f has the points faces.values[faces.starts[f]...], in an order that turns right round the
/// direction from its owner to its neighbour. All numbers are in range: read_foam_mesh() checks them.
struct FoamMesh {
  std::vector<dvec3> points;
  LabelLists faces;
  std::vector<std::uint32_t> owner;      // [face]: a cell
  std::vector<std::uint32_t> neighbour;  // [face]: the cell on the other side. Shorter: other faces are of the boundary
  std::uint32_t cell_count = 0;
};

/// The place of a file of a mesh by its name: "points", "faces", "owner", "neighbour", "boundary".
using FindMeshFile = std::function<FoamPlace(const char* name)>;

/// Reads the patches of a mesh. Throws if the file is damaged.
[[nodiscard]] std::vector<FoamPatch> read_foam_patches(const FoamPlace& boundary);

/// Reads a mesh. Throws if a file is missing, damaged or cut off, or if numbers in it are out of range.
[[nodiscard]] FoamMesh read_foam_mesh(const FindMeshFile& find);

/// Reads the points and faces of a mesh, without its cells. Throws as read_foam_mesh().
[[nodiscard]] FoamMesh read_foam_faces(const FindMeshFile& find);

/// Throws if a patch has faces that the mesh does not have, or that are not on its boundary.
void check_foam_patches(const FoamMesh& mesh, const std::vector<FoamPatch>& patches, const std::string& name);

/// The faces of each cell of a mesh. Throws if a cell has fewer than four.
[[nodiscard]] LabelLists faces_of_cells(const FoamMesh& mesh);

}  // namespace splatvol
