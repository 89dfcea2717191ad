// Reads the splats of one resolution, several groups at a time.
#pragma once

#include <functional>

#include "format/splat_reader.h"

namespace splatvol {

/// Reads all groups, several at a time, and calls visit(group) with each, in order. Stops at the first failure. Calls
/// `progress` with the share done, in [0, 1].
[[nodiscard]] Status for_each_group(const format::SplatReader& reader, format::SplatReader::Parts parts,
                                    const std::function<Status(const format::SplatGroup&)>& visit,
                                    const std::function<void(double)>& progress);

}  // namespace splatvol
