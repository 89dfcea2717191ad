// From a .svol file and a view to the splats that the view asks for, within a budget of memory.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/file.h"
#include "format/volume.h"
#include "scene/scene.h"
#include "streamer/budget.h"
#include "streamer/cache.h"
#include "streamer/cut.h"
#include "streamer/gather.h"
#include "streamer/paged_volume.h"
#include "streamer/splat.h"

namespace splatvol {

struct StreamerOptions {
  std::uint64_t memory_bytes = std::uint64_t{512} << 20;
  std::string attribute;
  KernelKind kernel = KernelKind::moments;
  bool gradients = false;  // octant: with them, for lighting; moments have theirs in any case
};

/// What a view asks for.
struct DetailOptions {
  double tolerance_percent = 1;                                          // see CutOptions
  std::optional<std::size_t> resolution;                                 // fixed; the finest where the file has fewer
  std::uint64_t max_splats = std::numeric_limits<std::uint64_t>::max();  // what the renderer can hold
};

/// Splats for a view, back to front; owned by the streamer.
struct FrameSplats {
  SplatSpan data;                   // all of them, one batch after another
  std::vector<SplatBatch> batches;  // one for each node that has splats
  std::uint64_t serial = 0;         // another one whenever the splats are others

  // What was chosen. A coarser detail than the one asked for is what the budget allows.
  std::uint64_t nodes = 0;
  std::uint64_t splats = 0;
  std::vector<std::uint64_t> nodes_by_resolution;   // [resolution]
  std::vector<std::uint64_t> splats_by_resolution;  // [resolution]
  DetailOptions detail;
};

struct StreamerStatistics {
  std::uint64_t bytes_read = 0;           // from the file, since it was opened
  std::uint64_t bytes_resident = 0;       // of the budget in use now
  std::uint64_t bytes_resident_peak = 0;  // and at most
  double cut_seconds = 0;                 // of the last request
  double fetch_seconds = 0;
};

/// An open file, seen through one attribute. Everything that it holds in memory counts against the budget: preamble,
/// pages, chunks and splats. Not thread-safe; uses all processors.
class Streamer {
 public:
  /// Reads the preamble. Fails where the file is damaged, where it has no such attribute (the message lists those that
  /// it has) or lacks what the kernel needs, and where the preamble alone passes the budget.
  [[nodiscard]] static Result<std::unique_ptr<Streamer>> open(std::unique_ptr<ByteSource> source,
                                                              const StreamerOptions& options);
  Streamer(const Streamer&) = delete;
  Streamer& operator=(const Streamer&) = delete;
  ~Streamer();

  /// The splats for a view: chosen, read and gathered before it returns; none of this is repeated for a view whose cut
  /// is that of the request before. Where they would pass the budget or max_splats, detail is lost and never coverage:
  /// the tolerance is raised, or the fixed resolution lowered, until they fit. Fails with out_of_budget where not even
  /// the coarsest fits, with the number of bytes that would do, and with the reader's error where the file fails or is
  /// damaged.
  ///
  /// The result stays valid until the next request, also one that fails.
  [[nodiscard]] Result<const FrameSplats*> request(const View& view, const TransferFunction& function,
                                                   const DetailOptions& detail);

  /// What the splats' values have to be added to.
  [[nodiscard]] double value_offset() const {
    return info().attributes[static_cast<std::size_t>(paged_.attribute())].offset;
  }

  [[nodiscard]] const format::VolumeInfo& info() const { return volume_->info(); }
  [[nodiscard]] const format::Volume& volume() const { return *volume_; }
  [[nodiscard]] StreamerStatistics statistics() const;

 private:
  struct Frame;
  struct Choice {
    Cut cut;
    DetailOptions detail;
  };
  Streamer(std::shared_ptr<const format::Volume> volume, int attribute, const StreamerOptions& options);
  [[nodiscard]] Status set_memory_aside();
  [[nodiscard]] std::uint64_t frame_limit() const;
  [[nodiscard]] Result<Choice> choose(const View& view, const ValueVisibility& visibility, DetailOptions detail);
  [[nodiscard]] Result<Choice> choose_lower_resolution(const View& view, const ValueVisibility& visibility,
                                                       DetailOptions detail);
  [[nodiscard]] Result<Choice> choose_higher_tolerance(const View& view, const ValueVisibility& visibility,
                                                       DetailOptions detail);
  [[nodiscard]] tl::unexpected<Error> fail_for_memory(const View& view, const ValueVisibility& visibility,
                                                      const DetailOptions& detail);
  [[nodiscard]] Result<Cut> try_cut(const View& view, const ValueVisibility& visibility, const DetailOptions& detail);
  [[nodiscard]] Status fetch(Cut cut, const ValueVisibility& visibility);

  std::shared_ptr<const format::Volume> volume_;
  KernelKind kernel_;
  MemoryBudget budget_;
  std::uint64_t working_bytes_ = 0;
  Reservation preamble_;
  Cache cache_;
  PagedVolume paged_;
  std::optional<Gatherer> gatherer_;
  std::unique_ptr<Frame> frame_;
  std::uint64_t next_serial_ = 1;
  double cut_seconds_ = 0;
  double fetch_seconds_ = 0;
};

}  // namespace splatvol
