// A splat's distribution of a value as builders hold it.
#pragma once

#include <span>

#include "base/math.h"
#include "format/columns.h"

namespace splatvol::format {

/// Fields as in SplatValue, of stored values, and the range of the material. In single precision: the file keeps less,
/// and these are most of the memory of a build with many attributes.
struct StoredValue {
  float mean, deviation;
  vec3 correlation;
  float coverage;
  float min, max;  // of the material; min > max if it has no value
};

/// Contract as for SplatValue (format/columns.h).
[[nodiscard]] PackedChunk pack_value_moments(std::span<const StoredValue> values, double least_step,
                                             const ValueSummary& summary);

}  // namespace splatvol::format
