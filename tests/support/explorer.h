// Reads a volume as a reader of untrusted files may.
#pragma once

#include <string>

#include "format/volume.h"

namespace splatvol::test {

/// The result of reading a volume part by part.
struct Exploration {
  bool all_read = true;  // no part was refused
  std::string broken;    // a promise of the reader that does not hold; empty: none
};

/// Reads the index, the histograms, the chunks of the first 500 rows, and the first 500 chunks of cells, each by
/// itself. Of a series, does so at each of the first 4 steps. Safe on untrusted files.
[[nodiscard]] Exploration explore_volume(const format::Volume& volume);

}  // namespace splatvol::test
