// All points of an input in Morton order, however many.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/points/point_batch.h"
#include "builder/points/point_records.h"
#include "builder/sorting/external_sort.h"
#include "builder/sources/source.h"
#include "format/volume_info.h"

namespace splatvol {

/// What became of the input's points, counted.
struct PointCensus {
  std::uint64_t read = 0;
  std::uint64_t not_finite = 0;  // dropped: a coordinate is NaN or infinite
  std::uint64_t merged = 0;      // vertices of cells whose position and values repeat an earlier one's: the same sample
  std::uint64_t coincident = 0;  // kept, though an earlier point has the same position
  std::uint64_t in_no_cell = 0;  // kept, though the input has cells and none uses them
};

/// What is known of an input once all of it has been read.
struct InputSummary {
  Box box;                                    // round the points
  Cube cube;                                  // round the box
  std::vector<format::Attribute> attributes;  // name, offset, range
  CellCensus cells;
  PointCensus census;  // merged and coincident are counted while the points are given back
  bool has_material = false;
};

/// Reads every piece, adds up what each point owns of its cells, sorts, and gives the points back.
class PointStream {
 public:
  /// `memory`: bytes to hold in all; pieces come on top. `folder`: for what does not fit. Fails where there is no point
  /// with finite coordinates, or their extent overflows. The points do not depend on memory and threads. `progress`
  /// gets the share of pieces read.
  [[nodiscard]] static Result<PointStream> create(Source& source, bool use_cells, std::size_t memory,
                                                  const std::string& folder,
                                                  const std::function<void(double)>& progress);

  /// Appends the next points to `batch`, some thousand, equal samples of cells merged; first, cells and neighbours of
  /// the batch are left alone. False at the end.
  [[nodiscard]] Result<bool> next(PointBatch& batch);

  [[nodiscard]] const InputSummary& summary() const { return summary_; }

  /// Of its points' records.
  [[nodiscard]] const PointRecords& layout() const { return layout_; }

  /// Points that were sorted; merging leaves fewer.
  [[nodiscard]] std::uint64_t count() const { return points_.count(); }

 private:
  PointStream(PointRecords layout, InputSummary summary, ExternalSorter points, std::optional<ExternalSorter> corners);

  [[nodiscard]] Status take_run(std::size_t begin, std::size_t end, PointBatch& batch);
  void append(std::size_t i, PointBatch& batch) const;
  void merge_into(PointBatch& batch, std::size_t place, std::size_t i) const;
  [[nodiscard]] Status append_planes(PointBatch& batch, std::size_t begin);
  [[nodiscard]] Result<bool> peek_corner();
  [[nodiscard]] const std::byte* record(std::size_t i) const { return raw_.data() + i * layout_.bytes(); }

  PointRecords layout_;
  InputSummary summary_;
  ExternalSorter points_;
  std::optional<ExternalSorter> corners_;  // of the boundary's faces
  SortedRecords corner_block_;
  std::size_t next_corner_ = 0;  // of that block

  // Records whose runs of equal keys are not all here yet.
  std::vector<std::byte> raw_;
  std::vector<MortonKey> keys_;
  bool ended_ = false;

  // Of the last point of the last run, or of a part of one that was too long.
  std::optional<MortonKey> last_key_;
  dvec3 last_position_{0};
};

}  // namespace splatvol
