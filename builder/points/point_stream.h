// All points of an input in Morton order, however many.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/points/boundary_corners.h"
#include "builder/points/input_summary.h"
#include "builder/points/point_batch.h"
#include "builder/points/point_records.h"
#include "builder/points/sample_merger.h"
#include "builder/sorting/external_sort.h"
#include "builder/sources/source.h"

namespace splatvol {

/// Reads all pieces of an input, adds up what each point owns of its cells, sorts the points, and returns them.
class PointStream {
 public:
  /// `memory`: bytes to hold in all, beside a piece. `folder`: for points that do not fit. `progress` gets the share of
  /// the pieces that are read. `gradients`: whether the points are to have them. Points do not depend on memory and
  /// threads. Fails if there is no point with finite coordinates, or if their extent overflows. Of attributes with the
  /// same values, the points have one, unless `joined` keeps them apart. `watch.piece`: as for PieceReader.
  [[nodiscard]] static Result<PointStream> create(Source& source, bool use_cells, std::size_t memory,
                                                  const std::string& folder,
                                                  const std::function<void(double)>& progress, bool gradients = true,
                                                  const JoinedAttributes& joined = {}, WatchPoints watch = {});

  /// Returns the points of a sort that has all records of some range of keys, for callers that read the pieces
  /// themselves. `corners`: of that range.
  PointStream(const PointRecords& layout, InputSummary summary, ExternalSorter points,
              std::optional<BoundaryCorners> corners);

  [[nodiscard]] static PointRecords layout_of(const Source& source, bool use_cells, bool gradients);

  /// Makes an empty sort of records by their keys within `cube`. Contract of memory, folder, `rewinds` as SortOptions.
  [[nodiscard]] static Result<ExternalSorter> sort_of_points(const PointRecords& layout, const Cube& cube,
                                                             std::size_t memory, std::size_t merge_memory,
                                                             const std::string& folder, bool rewinds = false);

  /// Fails before the work if the folder is too small for so many points in such a sort.
  [[nodiscard]] static Status check_room(const std::string& folder, std::uint64_t points, const ExternalSorter& sort);

  /// Starts again with the first point. Requires a sort that rewinds and has no corners; called once, after the last
  /// point.
  [[nodiscard]] Status rewind();

  /// Gives the sort back; then only destruction is allowed.
  [[nodiscard]] ExternalSorter take_sort() { return std::move(points_); }

  /// Appends the next points to `batch` (NextPoints), copies of a vertex as one.
  [[nodiscard]] Result<bool> next(PointBatch& batch);

  [[nodiscard]] const InputSummary& summary() const { return summary_; }

  /// Gives the points their planes from now on. Called before the first point.
  void set_corners(BoundaryCorners corners) { corners_.emplace(std::move(corners)); }

  /// Gives the rank of each point's records to `watch` from now on, counted from `first`. Requires records with tags.
  /// Called before the first point.
  void watch_ranks(std::uint64_t first, std::function<Status(PointTag, std::uint64_t)> watch) {
    first_rank_ = first;
    watch_rank_ = std::move(watch);
  }

  /// A layout for records of the points that this returns.
  [[nodiscard]] const PointRecords& layout() const { return stored_layout_; }

  /// Points that were sorted. Merging leaves fewer.
  [[nodiscard]] std::uint64_t count() const { return points_.count(); }

 private:
  [[nodiscard]] Result<SortedRecords> next_run();
  SortedRecords take(std::size_t count);
  void note_blocks(const std::byte* records, std::span<const std::size_t> points, std::size_t first);

  PointRecords layout_;  // with all attributes of the source
  PointRecords stored_layout_;
  InputSummary summary_;
  ExternalSorter points_;
  std::optional<BoundaryCorners> corners_;
  SampleMerger merger_;
  std::function<Status(PointTag, std::uint64_t)> watch_rank_;  // empty: records have no tags
  std::uint64_t first_rank_ = 0;
  std::uint64_t returned_ = 0;  // points

  SortedRecords sorted_;               // records that the sort returned, as far as their points were not
  std::vector<std::byte> run_;         // records of one key, if the sort returned them in parts
  std::vector<MortonKey> run_keys_;    // of these
  std::vector<std::uint64_t> blocks_;  // of the points that next() returns, if they are needed
};

}  // namespace splatvol
