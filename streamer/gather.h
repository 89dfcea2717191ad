// From a cut to splats: finds the chunks of its nodes, reads and decodes them, and copies each node's part.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <span>
#include <variant>
#include <vector>

#include "base/error.h"
#include "format/volume.h"
#include "streamer/cache.h"
#include "streamer/cut.h"
#include "streamer/loader.h"
#include "streamer/paged_volume.h"
#include "streamer/splat.h"
#include "streamer/visibility.h"

namespace splatvol {

/// Consecutive points of a group that become consecutive splats.
struct CopyJob {
  std::uint64_t group;
  std::uint64_t destination;  // index of the first splat
  std::uint32_t begin;        // within the group
  std::uint32_t count;
  std::uint32_t item;  // of the cut
  std::uint32_t resolution;
};

/// Consecutive points of a group.
struct GroupPart {
  std::uint64_t group;
  std::uint32_t begin;
  std::uint32_t count;
};

/// Splits ranges[segment] at the borders of groups, and calls visit(part) for each part until it returns false. Returns
/// whether it never did.
template <class Visit>
bool visit_groups(const format::Volume& volume, std::span<const PointRange> ranges, const Visit& visit) {
  const format::RowLayout& rows = volume.rows();
  for (std::size_t segment = 0; segment < ranges.size(); ++segment) {
    const std::uint64_t segment_begin = segment == 0 ? 0 : volume.info().resolution_counts[segment - 1];
    for (PointRange left = ranges[segment]; left.count > 0;) {
      const std::uint64_t number = rows.group_at(segment, left.begin - segment_begin);
      const format::Group group = rows.group(number);
      const auto begin = static_cast<std::uint32_t>(left.begin - group.begin);
      const auto count = static_cast<std::uint32_t>(std::min<std::uint64_t>(left.count, group.count - begin));
      left = {left.begin + count, left.count - count};
      if (!visit(GroupPart{number, begin, count})) return false;
    }
  }
  return true;
}

/// Copies that make the splats of a cut; the jobs of one row are next to each other.
struct GatherPlan {
  std::vector<CopyJob> jobs;
  std::vector<std::uint64_t> item_ends;  // [item]: number of its splats and all before
  std::uint64_t splats = 0;

  [[nodiscard]] std::uint64_t memory_bytes() const {
    return jobs.size() * sizeof(CopyJob) + item_ends.size() * sizeof(std::uint64_t);
  }
};

/// Memory for splats of one kind.
class SplatArray {
 public:
  /// Allocates `count` splats, not initialised.
  SplatArray(KernelKind kernel, std::uint64_t count);

  [[nodiscard]] SplatSpan splats() const;

  /// Requires the kernel's kind of splat.
  template <class Splat>
  [[nodiscard]] std::span<Splat> as() {
    return {std::get<std::unique_ptr<Splat[]>>(storage_).get(), count_};
  }

 private:
  std::variant<std::unique_ptr<OctantSplat[]>, std::unique_ptr<MomentsSplat[]>> storage_;
  std::uint64_t count_;
};

/// Reads the splats of cuts. Not thread-safe; reads and decodes on its own threads.
class Gatherer {
 public:
  /// `gradients`: reads gradients too, for the kernel octant. Fails with unsupported if the file lacks a column that is
  /// needed.
  [[nodiscard]] static Result<Gatherer> create(PagedVolume& volume, Cache& cache, KernelKind kernel, bool gradients);

  /// Plans where the splats of the cut go, item after item. Leaves out rows in which nothing is visible. Reads
  /// directory pages only.
  [[nodiscard]] Result<GatherPlan> plan(const Cut& cut, const ValueVisibility& visibility);

  /// Reads the chunks that the cache does not hold, and makes plan.splats splats. They are in DrawingUnits, and
  /// positions are relative to the centre of the item's cube. Errors name the file and the chunk.
  [[nodiscard]] Result<SplatArray> gather(const Cut& cut, const GatherPlan& plan);

  /// Returns the least bytes that `gather` needs at once, besides the splats: those of one row.
  [[nodiscard]] std::uint64_t working_bytes() const;

  /// Returns the bytes of all decoded chunks of a cut and of their directory pages, as if everything were visible.
  [[nodiscard]] std::uint64_t resident_bytes(const Cut& cut) const;

  [[nodiscard]] const format::Column& column(int index) const;

  /// Return the columns that splats are made of, and the column whose values tell whether they are visible.
  [[nodiscard]] const std::vector<int>& columns() const { return columns_; }
  [[nodiscard]] int value_column() const { return kernel_ == KernelKind::moments ? columns_[2] : columns_[1]; }

  /// The chunk with a group's part of a column at a resolution.
  [[nodiscard]] CacheKey chunk_key(std::size_t resolution, std::uint64_t group, int column) const;

 private:
  struct Wave;
  Gatherer(PagedVolume& volume, Cache& cache, KernelKind kernel, std::vector<int> columns);
  [[nodiscard]] Result<std::size_t> fill_wave(const GatherPlan& plan, std::size_t first_job, Wave& wave);
  [[nodiscard]] Status add_row(std::span<const CopyJob> jobs, Wave& wave);
  [[nodiscard]] Status load(Wave& wave);
  void copy(std::span<const CopyJob> jobs, const Cut& cut, const Wave& wave, SplatArray& splats) const;

  PagedVolume* volume_;
  Cache* cache_;
  KernelKind kernel_;
  std::vector<int> columns_;  // position, value, octant, perhaps gradient; or centroid, moments, value_moments
};

}  // namespace splatvol
