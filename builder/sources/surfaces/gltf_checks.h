// A check of glTF files before VTK reads them.
#pragma once

#include <string>

#include "base/error.h"

namespace splatvol {

/// Checks the nodes of a .gltf or .glb file: each names nodes and meshes that are there, none contains itself, and they
/// show at most 2^20 parts and 2^21 nodes in all. Fails unless the buffers that it names are regular files: VTK's
/// reader crashes without them. Nodes can name each other so that a few bytes stand for more parts
/// than anybody can read. Safe on untrusted files. Errors begin with the path.
[[nodiscard]] Status check_gltf(const std::string& path);

}  // namespace splatvol
