// Leaves of the index on their way from the pass over the points, which counts steps from the finest resolution, to the
// index, which counts resolutions and must know how many there are.
#pragma once

#include <cstdint>
#include <functional>
#include <map>

#include "base/temp_file.h"
#include "builder/cell_reduction.h"
#include "builder/index_stream.h"
#include "format/codec.h"

namespace splatvol {

/// A queue of leaves in a temporary file.
class LeafSpool {
 public:
  explicit LeafSpool(TempFile file) : file_(std::move(file)) {}

  [[nodiscard]] Status append(const OpenLeaf& leaf);

  /// Calls visit(leaf) for each, in order, with what came late for it, by its number; their disk space is given back.
  /// `resolutions`: how many there are.
  [[nodiscard]] Status read(std::size_t resolutions, const std::map<std::uint64_t, OpenLeaf>& late,
                            const std::function<Status(IndexLeaf)>& visit);

 private:
  [[nodiscard]] Status flush();

  TempFile file_;
  format::Bytes buffer_;
  std::uint64_t count_ = 0;
};

}  // namespace splatvol
