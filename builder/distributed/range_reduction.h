// The reduction of points that several ranks have.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "builder/distributed/range_plan.h"
#include "builder/distributed/ranks.h"
#include "builder/output/block_spool.h"
#include "builder/output/index_leaf_spool.h"
#include "builder/output/row_collector.h"
#include "builder/output/row_files.h"
#include "builder/output/row_packer.h"
#include "builder/pipeline/build.h"
#include "builder/pipeline/memory_plan.h"
#include "builder/reduction/reduction_pass.h"
#include "format/volume_info.h"

namespace splatvol {

/// The part of a joint reduction that this rank does: the finest levels of its range; at rank 0 the coarser levels of
/// all ranges too. Rows and index leaves are those of a single process. Collective functions are called by all ranks in
/// the order below, also by those without a range.
class RangeReduction {
 public:
  /// `stays`: learns on each rank what ReductionSettings::stays gets there; may be empty. References must outlive this.
  RangeReduction(Ranks& ranks, const BuildOptions& options, const InputSummary& input, const RangePlan& plan,
                 bool estimates, std::string folder, WatchStays stays = {});

  /// Reduces the points of this rank's range. Not called without one.
  [[nodiscard]] Status reduce(const NextPoints& next, std::uint64_t points, const BuildProgress& progress);

  /// Collective: a row across a border goes to the rank where it ends.
  [[nodiscard]] Status join_shared_rows();

  /// Collective: rank 0 reduces the coarser levels.
  [[nodiscard]] Status reduce_coarse_levels();

  /// Collective: points of each level, from the finest on, in all ranges.
  [[nodiscard]] std::vector<std::uint64_t> counts();

  /// Collective: facts about the packed points of all ranks.
  [[nodiscard]] StoredSummary stored();

  /// Rank after rank, calls visit(leaf) on rank 0 for all index leaves. Collective.
  [[nodiscard]] Status visit_leaves(std::size_t resolutions, const std::function<Status(IndexLeaf)>& visit);

  [[nodiscard]] RowFiles& files() { return files_; }
  [[nodiscard]] format::VolumeInfo& info() { return info_; }
  [[nodiscard]] std::uint64_t least_memory() const { return memory_.least; }

 private:
  // The reduction of a range, or of the coarser levels.
  struct Part {
    ReductionSettings settings;
    RowCollector rows;
    ReductionPass pass;
    Part(ReductionSettings of_part, const format::VolumeInfo& info, const GroupSizes& groups, std::size_t memory,
         const std::string& folder, SharedRows shared, std::function<Status(const OpenIndexLeaf&)> leaves,
         std::uint64_t most_open_leaves);
  };

  [[nodiscard]] bool has_range() const { return ranks_.rank() < plan_.ranges; }
  [[nodiscard]] bool is_last() const { return ranks_.rank() + 1 == plan_.ranges; }
  [[nodiscard]] ReductionSettings settings() const;
  [[nodiscard]] Status finish_rows(Part& part);
  [[nodiscard]] Status join_rows(std::span<const std::byte> received, std::vector<std::byte>& passed_on);
  [[nodiscard]] Status write_joined(PendingRow row);
  [[nodiscard]] Status add_members(std::size_t rank, std::span<const std::byte> bytes);

  Ranks& ranks_;
  const BuildOptions& options_;
  const InputSummary& input_;
  const RangePlan& plan_;
  bool estimates_;
  std::string folder_;
  WatchStays stays_;
  format::VolumeInfo info_;
  MemoryPlan memory_;
  RowPacker packer_;
  RowFiles files_;
  BlockSpool beyond_;  // members of the first level that is not reduced in ranges
  Status kept_;        // whether all of these could be kept
  std::optional<IndexLeafSpool> leaves_;
  std::uint64_t leaf_count_ = 0;
  std::unique_ptr<Part> range_, coarse_;
  std::vector<std::uint64_t> first_leaves_;  // [rank]: number of its first index leaf among all
  std::vector<std::uint64_t> first_points_;  // [rank]: number of its first point among all
};

}  // namespace splatvol
