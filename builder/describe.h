// What a file says of itself.
#pragma once

#include <string>
#include <vector>

#include "base/math.h"
#include "builder/build.h"
#include "format/volume_info.h"

namespace splatvol {

/// Describes a volume, without what is known only at the end: counts, missing values, provenance.
[[nodiscard]] format::VolumeInfo describe_volume(const BuildOptions& options, const Cube& cube,
                                                 std::vector<format::Attribute> attributes);

/// How the file came about, as JSON.
[[nodiscard]] std::string describe_provenance(const BuildOptions& options, const BuildReport& report);

}  // namespace splatvol
