// What a reader sees of a .svol file, as text.
#pragma once

#include <string>

#include "base/error.h"
#include "format/volume.h"

namespace splatvol::test {

/// Returns all that a reader gets from a file, of all steps, line by line: metadata, histograms, index, columns.
/// Numbers have nine digits, shares six. Of the numbers of a chunk or of an index, a line has a hash of all and the
/// first; with `all`, it has all. The text depends on the file alone, not on how its bytes are packed or where they
/// lie.
[[nodiscard]] Result<std::string> dump_volume(const format::Volume& volume, bool all = false);

}  // namespace splatvol::test
