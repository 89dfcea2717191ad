// Files that name other files: time series (.pvd, .series) and trees of blocks (.vtm).
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/error.h"

namespace splatvol {

/// A time step of a collection, and the files that are its parts.
struct CollectionStep {
  double time = 0;
  std::vector<std::string> files;
};

/// Lists the time steps of a .pvd or .series in the order of their times. The files of a step stand in the order of
/// their parts; a .series has one for each step. Paths are relative to the file's own folder. Fails if the file is
/// damaged or names none, and if a .series names two for one time.
[[nodiscard]] Result<std::vector<CollectionStep>> collection_steps(const std::string& path);

/// A file that a .vtm, .vtpd or .vtpc names, and the number of its block there (builder/sources/block_numbers.h).
struct BlockFile {
  std::string path;
  std::uint64_t block = 0;
};

/// Lists the files of the blocks that a .vtm, .vtpd or .vtpc names, at any depth, in its order. Pieces of a multi-piece
/// or partitioned data set are one block, and each other data set is one by itself.
[[nodiscard]] Result<std::vector<BlockFile>> block_files(const std::string& path);

}  // namespace splatvol
