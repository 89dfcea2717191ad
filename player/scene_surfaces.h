// The surfaces of a scene, as far as memory has room for them.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/triangle_mesh.h"
#include "format/volume.h"
#include "renderer/surfaces/surface.h"
#include "scene/scene.h"

namespace splatvol {

/// Returns the surfaces of a scene, and reads those that are shown (read_surfaces, add_values): files by `read_file`,
/// patches of the boundary and values from `volume`. The patches may take `room` bytes, by the counts in the metadata.
/// Those that would take more are not read, the largest first (Surface::left_out).
[[nodiscard]] Result<std::vector<Surface>> read_scene_surfaces(std::span<const SceneSurface> styles,
                                                               const format::Volume& volume,
                                                               const ReadSurface& read_file, std::uint64_t room,
                                                               std::span<const Surface> before);

/// Gives surfaces that are shown the values that colour them: of the cells of `volume` at the triangles' corners, or in
/// their middles if cells have one value each. Those of the same triangles, attribute and step are taken over from
/// `before`. Fails if the file keeps no cells, or cannot be read.
[[nodiscard]] Status add_values(std::span<Surface> surfaces, const format::Volume& volume,
                                std::span<const Surface> before);

/// Returns the bytes of triangles while they are drawn, with values of them or of their points.
[[nodiscard]] std::uint64_t drawn_bytes(std::uint64_t points, std::uint64_t triangles);

/// Returns the bytes that all patches of a file's boundary take.
[[nodiscard]] std::uint64_t bytes_of_patches(const format::Volume& volume);

/// Returns an error with ErrorCode::out_of_budget that names the patches that shown surfaces lack; none if they lack
/// none. `file` begins the message.
[[nodiscard]] std::optional<Error> left_out_error(std::span<const Surface> surfaces, const std::string& file);

}  // namespace splatvol
