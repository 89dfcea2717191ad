// Index leaves between the pass over the points and the index. The pass counts levels from the finest resolution on,
// the index counts resolutions from the coarsest on.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <vector>

#include "base/temp_file.h"
#include "builder/output/index_stream.h"
#include "format/codec.h"

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

/// A queue of index leaves in a temporary file.
class IndexLeafSpool {
 public:
  explicit IndexLeafSpool(TempFile file) : file_(std::move(file)) {}

  [[nodiscard]] Status append(const OpenIndexLeaf& leaf);

  /// Calls visit(leaf) for each leaf in order, with the counts and splats that came late for it. `late`: these by the
  /// leaf's number. `resolutions`: how many there are. Gives the leaves' disk space back.
  [[nodiscard]] Status read(std::size_t resolutions, const std::map<std::uint64_t, OpenIndexLeaf>& late,
                            const std::function<Status(IndexLeaf)>& visit);

 private:
  class Reader;
  // What was written at once. A bad disk must not decide how much memory a leaf takes.
  struct Block {
    std::uint64_t bytes, hash;
  };

  [[nodiscard]] Status flush();

  TempFile file_;
  std::vector<Block> blocks_;
  format::Bytes buffer_;
  std::uint64_t count_ = 0;
};

}  // namespace splatvol
