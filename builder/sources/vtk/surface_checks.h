// Checks of surface files before VTK's readers see them: they draw what there is of a file that is cut off.
#pragma once

#include <string>

#include "base/error.h"

namespace splatvol {

/// Fails unless an .stl file has all triangles that it states, or ends its text. Fails also at a word of a text that is
/// no number. Safe on untrusted files.
[[nodiscard]] Status check_stl(const std::string& path);

/// Fails unless a .ply file, text or binary, has all elements that its header states. Fails also at a word of a text
/// that is no number. Returns whether the file ends with a number, which may be cut off. Safe on untrusted files.
[[nodiscard]] Result<bool> check_ply(const std::string& path);

/// Fails at a line of an .obj file that has fewer numbers than its kind needs, or words instead of them, and at a face
/// with a corner that is not there. Returns whether the file ends with a number, which may be cut off. How many lines
/// must follow an .obj file does not tell. Safe on untrusted files.
[[nodiscard]] Result<bool> check_obj(const std::string& path);

/// Fails unless the buffers that a .gltf or .glb file names are regular files: VTK's reader crashes without them. Safe
/// on untrusted files.
[[nodiscard]] Status check_gltf_buffers(const std::string& path);

}  // namespace splatvol
