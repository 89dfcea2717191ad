// Names of attributes, columns and arrays: the checks and the messages that several layers share.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"

namespace splatvol {

/// Returns the failure for a name that `file` lacks, with invalid_argument. The message lists the available names:
/// `a.vtu: no attribute "x"; there are: p, q`.
[[nodiscard]] tl::unexpected<Error> fail_no_attribute(const std::string& file, const std::string& name,
                                                      std::span<const std::string> available);

/// Returns a name that appears at least twice, or nothing. If several do, returns the lowest of them, byte by byte.
[[nodiscard]] std::optional<std::string> find_duplicate(std::vector<std::string> names);

}  // namespace splatvol
