// The pieces of a mesh that is in several Exodus files, by their names.
#pragma once

#include <span>
#include <string>

#include "base/error.h"

namespace splatvol {

/// Fails if some pieces of a mesh are not among the files. Its pieces are NAME.N.0 to NAME.N.(N-1), where zeros may
/// stand before the last number. `paths`: of Exodus files; other names say nothing.
[[nodiscard]] Status check_exodus_pieces(std::span<const std::string> paths);

}  // namespace splatvol
