// Leaves of the index on their way from the pass over the points, which counts levels from the finest resolution, to
// the index, which counts resolutions and must know how many there are.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <vector>

#include "base/temp_file.h"
#include "builder/output/index_stream.h"
#include "format/codec.h"

namespace splatvol {

/// A leaf of the index while it is filled: counts and splats by levels from the finest resolution on, as far as there
/// are any.
struct OpenIndexLeaf {
  MortonKey key;  // of any point in it
  int depth = 0;
  std::vector<std::uint64_t> counts;            // [level]: points that no coarser resolution has
  std::vector<SplatBounds> splats;              // [level]
  std::vector<format::ValueSummary> summaries;  // [attribute]

  [[nodiscard]] SplatBounds& splats_at(std::size_t level);
  void count(std::size_t level, std::uint64_t points = 1);
  void include(const OpenIndexLeaf& other);       // another part of it
  void include_late(const OpenIndexLeaf& other);  // counts and splats only
};

/// A queue of leaves in a temporary file.
class IndexLeafSpool {
 public:
  explicit IndexLeafSpool(TempFile file) : file_(std::move(file)) {}

  [[nodiscard]] Status append(const OpenIndexLeaf& leaf);

  /// Calls visit(leaf) for each, in order, with what came late for it, by its number; their disk space is given back.
  /// `resolutions`: how many there are.
  [[nodiscard]] Status read(std::size_t resolutions, const std::map<std::uint64_t, OpenIndexLeaf>& late,
                            const std::function<Status(IndexLeaf)>& visit);

 private:
  [[nodiscard]] Status flush();

  TempFile file_;
  format::Bytes buffer_;
  std::uint64_t count_ = 0;
};

}  // namespace splatvol
