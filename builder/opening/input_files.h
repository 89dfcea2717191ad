// Which files an input consists of.
#pragma once

#include <string>
#include <vector>

#include "base/error.h"

namespace splatvol {

/// Replaces folders by the files in them whose names tell that they can be read. An OpenFOAM case is a folder, but one
/// input.
[[nodiscard]] Result<std::vector<std::string>> expand_folders(const std::vector<std::string>& inputs);

/// Returns the files in folders that hold data, but that expand_folders() leaves out for their names.
[[nodiscard]] std::vector<std::string> files_left_out(const std::vector<std::string>& inputs);

}  // namespace splatvol
