// A file of an input that is named as for svbuild.
#pragma once

#include <string>

#include "builder/opening/open_source.h"
#include "builder/pipeline/build.h"
#include "tests/support/require.h"

namespace splatvol::test {

/// Builds a volume. Ends the program if that fails.
inline void build_input(const std::string& input, const std::string& path, const BuildOptions& options = {},
                        const SourceOptions& source_options = {}) {
  const auto source = open_source({input}, source_options);
  require(source);
  require(build_volume(**source, path, options, [](const char*, double) {}));
}

}  // namespace splatvol::test
