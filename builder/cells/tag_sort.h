// Numbers of a piece's points, by the points' tags.
#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/sorting/external_sort.h"
#include "builder/sources/source.h"

namespace splatvol {

/// Sorts numbers of points that come in any order, and returns them piece by piece.
class TagSort {
 public:
  /// Of a point that no number was added for.
  static constexpr std::uint64_t none = std::numeric_limits<std::uint64_t>::max();

  [[nodiscard]] static Result<TagSort> create(std::uint64_t memory, const std::string& folder);

  [[nodiscard]] Status add(PointTag tag, std::uint64_t number);

  /// Ends the adding. Call it once.
  [[nodiscard]] Status finish() { return sorter_.finish(); }

  /// Replaces `numbers` by those of a piece of so many points. Requires ascending pieces.
  [[nodiscard]] Status load(std::uint32_t piece, std::uint32_t points, std::vector<std::uint64_t>& numbers);

 private:
  explicit TagSort(ExternalSorter sorter) : sorter_(std::move(sorter)) {}

  ExternalSorter sorter_;
  SortedRecords read_;
  std::size_t next_ = 0;  // of read_
  bool ended_ = false;
};

}  // namespace splatvol
