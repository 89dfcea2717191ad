// From a cut to splats: which chunks it touches, their reading and decoding, and each node's part of them.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/error.h"
#include "format/volume.h"
#include "streamer/cache.h"
#include "streamer/cut.h"
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

/// What to copy where: by group, then by resolution; and where each item's splats end.
struct GatherPlan {
  std::vector<CopyJob> jobs;
  std::vector<std::uint64_t> item_ends;  // [item]
  std::uint64_t splats = 0;

  [[nodiscard]] std::uint64_t memory_bytes() const {
    return jobs.size() * sizeof(CopyJob) + item_ends.size() * sizeof(std::uint64_t);
  }
};

/// Reads the splats of cuts. Not thread-safe; decodes on all processors.
class Gatherer {
 public:
  /// Fails with unsupported where the file has no values for the attribute or no octant column.
  [[nodiscard]] static Result<Gatherer> create(PagedVolume& volume, Cache& cache);

  /// Lays the cut's splats out, item after item. Groups in which nothing is visible are left out. Reads directory pages
  /// only.
  [[nodiscard]] Result<GatherPlan> plan(const Cut& cut, const ValueVisibility& visibility);

  /// Reads what the cache does not hold and fills `splats`, positions relative to the centre of their item's cell.
  /// Requires splats.size() == plan.splats. Errors name the file and the chunk.
  [[nodiscard]] Status gather(const Cut& cut, const GatherPlan& plan, std::span<OctantSplat> splats);

  /// Bytes that gather needs at once at the very least, besides the splats: for one group, at all resolutions.
  [[nodiscard]] std::uint64_t working_bytes() const;

 private:
  struct Chunk;
  struct Wave;
  Gatherer(PagedVolume& volume, Cache& cache, int position, int value, int octant);
  [[nodiscard]] Result<std::size_t> fill_wave(const GatherPlan& plan, std::size_t first_job, Wave& wave);
  [[nodiscard]] Status add_group(std::span<const CopyJob> jobs, Wave& wave);
  [[nodiscard]] Status load(Wave& wave);
  [[nodiscard]] Status read_and_decode(std::span<Chunk> run) const;
  [[nodiscard]] Status decode(Chunk& chunk, std::span<const std::byte> packed) const;
  void copy(const CopyJob& job, const CutItem& item, const Wave& wave, std::span<OctantSplat> splats) const;
  [[nodiscard]] CacheKey sizes_key(const CopyJob& job) const;

  PagedVolume* volume_;
  Cache* cache_;
  int position_, value_, octant_;  // columns
};

}  // namespace splatvol
