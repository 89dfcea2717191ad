// How a finished file is read back: on all threads that a build may use.
#pragma once

#include <oneapi/tbb/global_control.h>

#include "builder/pipeline/build.h"
#include "format/volume_writer.h"

namespace splatvol {

/// `progress` must outlive the result.
[[nodiscard]] inline format::VolumeWriter::Checking checking(const BuildProgress& progress) {
  return {[&progress](double fraction) { progress("checking", fraction); },
          tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism)};
}

}  // namespace splatvol
