// Index leaves between the pass over the points and the index. The pass counts levels from the finest resolution on,
// the index counts resolutions from the coarsest on.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "builder/output/block_spool.h"
#include "builder/output/byte_streams.h"
#include "builder/output/index_stream.h"

namespace splatvol {

/// An index leaf while it is filled. Its counts and splats end with the last level that has some.
struct OpenIndexLeaf {
  MortonKey key;  // of any point in the leaf
  int depth = 0;
  std::vector<std::uint64_t> counts;            // [level]: points that no coarser resolution has
  std::vector<SplatBounds> splats;              // [level]
  std::vector<format::ValueSummary> summaries;  // [attribute]

  [[nodiscard]] SplatBounds& splats_at(std::size_t level);
  void count(std::size_t level, std::uint64_t points = 1);
  void include(const OpenIndexLeaf& other);       // adds another part of the leaf
  void include_late(const OpenIndexLeaf& other);  // adds counts and splats only
};

/// A queue of index leaves in a temporary file, which is made when the first MiB is full.
class IndexLeafSpool {
 public:
  explicit IndexLeafSpool(std::string folder) : spool_(std::move(folder)) {}

  [[nodiscard]] Status append(const OpenIndexLeaf& leaf);

  /// Calls visit(leaf) for each leaf in order, with the counts and splats that came late for it. `late`: these by the
  /// leaf's number. `resolutions`: how many there are. Gives the leaves' disk space back.
  [[nodiscard]] Status read(std::size_t resolutions, const std::map<std::uint64_t, OpenIndexLeaf>& late,
                            const std::function<Status(IndexLeaf)>& visit);

 private:
  BlockSpool spool_;
  ByteWriter leaf_;  // the one that is appended
};

}  // namespace splatvol
