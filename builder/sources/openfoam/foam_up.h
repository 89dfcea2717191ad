// The direction upwards in OpenFOAM's cases.
#pragma once

#include <string>
#include <vector>

namespace splatvol {

/// Returns the axis that points upwards, 0 to 2, for the first case among inputs: that of its gravity (constant/g),
/// else y if it has patches of the type `empty`, else z. Files that are damaged say nothing. -1: no input is a case.
/// Safe on untrusted files.
[[nodiscard]] int usual_up(const std::vector<std::string>& inputs);

}  // namespace splatvol
