// From a .svol file and a view to the splats that the view asks for, within a budget of memory.
#pragma once

#include <cstdint>
#include <functional>
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
#include "streamer/fade.h"
#include "streamer/gather.h"
#include "streamer/occlusion.h"
#include "streamer/paged_volume.h"
#include "streamer/pager.h"
#include "streamer/splat.h"

namespace splatvol {

struct StreamerOptions {
  std::uint64_t memory_bytes = std::uint64_t{512} << 20;
  std::string attribute;
  KernelKind kernel = KernelKind::moments;
  bool gradients = false;           // octant: with them, for lighting; moments have theirs in any case
  unsigned threads = read_threads;  // that read and decode for `advance`
  bool hide = true;                 // leave out what lies behind an opaque front; false: to compare with
};

/// What a view asks for.
struct DetailOptions {
  double tolerance_percent = 1;                                          // see CutOptions
  std::optional<std::size_t> resolution = std::nullopt;                  // fixed; the finest where the file has fewer
  std::uint64_t max_splats = std::numeric_limits<std::uint64_t>::max();  // what the renderer can hold
  std::optional<ErrorGoal> goal = std::nullopt;                          // by expected error, instead of both

  [[nodiscard]] bool operator==(const DetailOptions&) const = default;
};

/// How far a frame is from what its view asks for.
struct FrameProgress {
  bool complete = true;      // it is what `request` gives for the frame's `detail`
  bool settled = true;       // nothing more will come: complete, but for what cannot be read
  std::uint64_t fading = 0;  // regions that are drawn from two resolutions

  // Of what is needed.
  std::uint64_t missing_chunks = 0;  // as far as it is known where they lie
  std::uint64_t missing_pages = 0;   // of index and directory
  std::uint64_t missing_bytes = 0;   // packed
  std::uint64_t needed_bytes = 0;    // packed, there or not

  std::vector<Error> errors;  // what could not be read since the frame before; each part once
};

/// Splats for a view, back to front; owned by the streamer.
struct FrameSplats {
  SplatSpan data;                   // all of them, one batch after another
  std::vector<SplatBatch> batches;  // one for each node that has splats
  std::uint64_t serial = 0;         // another one whenever the splats are others; weights may change without

  // What was chosen. A coarser detail than the one asked for is what the budget allows.
  std::uint64_t nodes = 0;
  std::uint64_t splats = 0;
  std::vector<std::uint64_t> nodes_by_resolution;   // [resolution]
  std::vector<std::uint64_t> splats_by_resolution;  // [resolution]
  DetailOptions detail;
  double expected_error = 0;  // root mean square of RGB against the exact picture

  FrameProgress progress;
};

/// A node of the octree, of which a frame has splats.
struct DrawnNode {
  Cube cube;
  std::uint32_t resolution;
};

struct StreamerStatistics {
  std::uint64_t bytes_read = 0;           // from the file, since it was opened
  std::uint64_t bytes_resident = 0;       // of the budget in use now
  std::uint64_t bytes_resident_peak = 0;  // and at most
  double cut_seconds = 0;                 // of the last request
  double fetch_seconds = 0;
};

/// An open file, seen through one attribute. Everything that it holds in memory counts against the budget: preamble,
/// pages, chunks, packed bytes on their way, and splats. Not thread-safe; uses all processors, and threads of its own
/// for `advance`.
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
  /// the tolerance is raised, the fixed resolution lowered, or the splats of a goal made fewer, until they fit. Fails
  /// with out_of_budget where not even the coarsest fits, with the number of bytes that would do, and with the reader's
  /// error where the file fails or is damaged.
  ///
  /// The result stays valid until the next request, also one that fails.
  [[nodiscard]] Result<const FrameSplats*> request(const View& view, const TransferFunction& function,
                                                   const DetailOptions& detail);

  /// The best splats for a view that are there now, or come within `wait_seconds`; what else the view asks for is read
  /// meanwhile, until the next call: coarse before fine, and where the error is largest first. The splats always show
  /// all of the volume. Calls with the same view end in a frame that is `complete`: what `request` gives for its
  /// `detail`. That is coarser than the one asked for where splats and the chunks that they come from would pass the
  /// budget together.
  ///
  /// `change`, (0, 1]: the share of a change of resolution that this call makes; 1: all at once. With less, a region
  /// whose resolution changes is drawn both as it was and as it will be, by the weights of their batches, which move by
  /// `change` from call to call; until then the frame is not `complete`. Fewer splats or bytes left than this takes:
  /// the region changes at once.
  ///
  /// Waits for the file in the first call, for the root of the index and the coarsest resolution, which are kept from
  /// then on. A part that cannot be read is told once and not asked for again; its nodes are drawn coarser. Fails where
  /// those of the first call cannot be read, and where not even the coarsest picture fits.
  ///
  /// The result stays valid until the next call or request.
  [[nodiscard]] Result<const FrameSplats*> advance(const View& view, const TransferFunction& function,
                                                   const DetailOptions& detail, double wait_seconds = 0,
                                                   double change = 1);

  /// Nodes of the last frame, a batch of splats each; none where there is no frame.
  [[nodiscard]] std::vector<DrawnNode> drawn_nodes() const;

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
  struct Aim;
  using TryCut = std::function<Result<Cut>(const DetailOptions& detail)>;
  Streamer(std::shared_ptr<const format::Volume> volume, int attribute, const StreamerOptions& options);
  [[nodiscard]] Status set_memory_aside();
  [[nodiscard]] std::uint64_t choice_bytes() const;
  [[nodiscard]] std::uint64_t fixed_bytes() const;
  [[nodiscard]] std::uint64_t budget_for(std::uint64_t bytes) const;
  [[nodiscard]] std::uint64_t frame_limit() const;
  [[nodiscard]] std::uint64_t paging_memory() const;
  [[nodiscard]] CutOptions cut_options(const DetailOptions& detail, std::uint64_t max_bytes);
  [[nodiscard]] Result<Choice> choose(DetailOptions detail, const TryCut& try_cut) const;
  [[nodiscard]] tl::unexpected<Error> fail_for_memory(const View& view, const ValueVisibility& visibility,
                                                      const DetailOptions& detail, bool paging);
  [[nodiscard]] Result<Cut> select(IndexPages& index, Residency* residency, const View& view,
                                   const ValueVisibility& visibility, const CutOptions& options);
  [[nodiscard]] Result<Cut> try_cut(const View& view, const ValueVisibility& visibility, const DetailOptions& detail);
  [[nodiscard]] Status fetch(Cut cut, const ValueVisibility& visibility);
  [[nodiscard]] bool shows(const ValueVisibility& visibility) const;
  [[nodiscard]] Status assemble(FadingCut fading, const ValueVisibility& visibility, Reservation reservation);

  [[nodiscard]] Status start_paging();
  [[nodiscard]] Status take_aim(const View& view, const ValueVisibility& visibility, const DetailOptions& detail);
  void aim_in_steps(const View& view, const ValueVisibility& visibility);
  void aim_ahead(const View& last, const View& view, const ValueVisibility& visibility);
  [[nodiscard]] std::uint64_t coarsest_frame_bytes() const;
  [[nodiscard]] Result<Cut> choose_resident(DetailOptions& detail);
  [[nodiscard]] Result<Cut> choose_coarsest();
  [[nodiscard]] std::uint64_t fading_splats(const Cut& cut) const;
  void set_weights(FadingCut fading);
  [[nodiscard]] Status show_resident(double change);

  std::shared_ptr<const format::Volume> volume_;
  KernelKind kernel_;
  unsigned threads_;
  bool hide_;
  MemoryBudget budget_;
  std::uint64_t working_bytes_ = 0;
  Reservation fixed_;
  FilledNodes filled_;
  std::optional<KeptOcclusion> occlusion_;
  Cache cache_;
  PagedVolume paged_;
  std::optional<Gatherer> gatherer_;
  std::unique_ptr<Pager> pager_;  // while frames come from `advance`
  std::unique_ptr<Aim> aim_;
  std::optional<View> view_before_;            // that of `aim_`, until what comes after it has been asked for
  std::optional<Reservation> coarsest_frame_;  // while there is a pager: for a frame when all else is taken
  std::unique_ptr<Frame> frame_;
  std::optional<Box> clip_box_;  // of the view that is asked for
  std::uint64_t next_serial_ = 1;
  double cut_seconds_ = 0;
  double fetch_seconds_ = 0;
};

}  // namespace splatvol
