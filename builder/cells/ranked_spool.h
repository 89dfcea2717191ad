// Tetrahedra that know the ranks of their corners, until they are sorted.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/mesh/ranked_tetrahedron.h"
#include "builder/output/block_spool.h"

namespace splatvol {

/// A queue of tetrahedra in a temporary file, which is made when the first MiB is full. In Morton order, a tetrahedron
/// takes about 8 bytes.
class RankedSpool {
 public:
  explicit RankedSpool(std::string folder) : spool_(std::move(folder)) {}

  /// Adds tetrahedra. Works on all of TBB's threads.
  [[nodiscard]] Status add(std::span<const RankedTetrahedron> tetrahedra);

  /// Calls visit(blocks) for all tetrahedra, some blocks at a time, and gives their disk space back. Called once.
  [[nodiscard]] Status read(const std::function<Status(std::span<const std::span<const std::byte>> blocks)>& visit);

  /// Replaces `tetrahedra` by those of a block. Thread-safe.
  static void unpack(std::span<const std::byte> block, std::vector<RankedTetrahedron>& tetrahedra);

  /// The number of tetrahedra that were added.
  [[nodiscard]] std::uint64_t count() const { return count_; }

 private:
  BlockSpool spool_;
  std::uint64_t count_ = 0;
};

}  // namespace splatvol
