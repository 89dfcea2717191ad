// A file's description of itself.
#pragma once

#include <string>
#include <vector>

#include "base/math.h"
#include "builder/pipeline/build.h"
#include "format/volume_info.h"

namespace splatvol {

/// Describes a volume, without what is known only at the end: counts, missing values, provenance.
[[nodiscard]] format::VolumeInfo describe_volume(const BuildOptions& options, const Cube& cube,
                                                 std::vector<format::Attribute> attributes);

/// Describes the file's origin, as JSON.
[[nodiscard]] std::string describe_provenance(const BuildOptions& options, const BuildReport& report);

/// Describes the origin of a step of a series, as JSON.
[[nodiscard]] std::string describe_step_provenance(const std::string& builder, const std::string& input);

}  // namespace splatvol
