// Copies of a vertex become one point.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/points/input_summary.h"
#include "builder/points/point_batch.h"
#include "builder/points/point_records.h"
#include "builder/sorting/morton.h"

namespace splatvol {

/// Appends sorted points to batches. Neighbouring pieces of a mesh repeat their common vertices: of the copies of a
/// vertex (PointRecords::copies) the first is kept, with the material of all. Every point of no cell is kept.
class SampleMerger {
 public:
  /// `has_material`: whether any record has material. `stored`: InputSummary::stored.
  SampleMerger(const PointRecords& layout, bool has_material, std::span<const std::size_t> stored);

  /// Appends the points of `count` records that share `key`, and counts in `census`: merged, coincident. Requires calls
  /// in Morton order, and all records of a key at once unless there are too many. Returns for each record the index of
  /// its point in the batch, valid until the next call.
  std::span<const std::size_t> append(const std::byte* records, std::size_t count, const MortonKey& key,
                                      PointBatch& batch, PointCensus& census);

 private:
  void append_point(const std::byte* record, const MortonKey& key, PointBatch& batch) const;
  void merge_into(std::size_t point, const std::byte* record, PointBatch& batch) const;
  void count_if_repeated(const std::byte* first, const std::byte* last, const MortonKey& key, PointCensus& census);
  [[nodiscard]] std::vector<std::size_t> sort_samples(const std::byte* records, std::size_t count) const;
  [[nodiscard]] std::vector<std::size_t> find_kept(const std::byte* records, const std::vector<std::size_t>& order,
                                                   PointCensus& census) const;

  PointRecords layout_;
  bool has_material_;
  std::vector<std::size_t> taken_;   // [attribute of the batch]: which of the record
  std::vector<std::size_t> points_;  // [record]: index in the batch

  // Key and position of the last record that was appended.
  std::optional<MortonKey> last_key_;
  dvec3 last_position_{0};
};

}  // namespace splatvol
