// Meshes and point sets in the caller's memory.
#pragma once

#include <memory>
#include <string>

#include "builder/sources/source.h"
#include "splatvol/build.h"

namespace splatvol {

/// Opens arrays as a source; they must outlive it. A mesh is one piece. Points without cells come in pieces of
/// max_piece_points. Values stay where they are (Source::lend_values). `name` begins the messages. Fails if the arrays
/// do not fit each other, two attributes have the same name, or one has none. Safe on untrusted arrays.
[[nodiscard]] Result<std::unique_ptr<Source>> open_arrays(const std::string& name, const MeshArrays& mesh,
                                                          const SourceOptions& options);

}  // namespace splatvol
