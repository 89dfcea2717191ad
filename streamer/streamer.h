// From a .svol file and a view to the splats of the view, within a budget of memory.
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
#include "streamer/step_prefetch.h"

namespace splatvol {

struct StreamerOptions {
  std::uint64_t memory_bytes = std::uint64_t{512} << 20;
  std::string attribute;
  KernelKind kernel = KernelKind::moments;
  bool gradients = false;           // kernel octant: with gradients, for lighting; moments always have them
  unsigned threads = read_threads;  // for reading and decoding in `advance`
  bool hide = true;                 // leaves out nodes behind an opaque front; false: for comparisons
};

/// The detail that a view asks for.
struct DetailOptions {
  double tolerance_percent = 1;                                          // see CutOptions
  std::optional<std::size_t> resolution = std::nullopt;                  // fixed; at most the finest of the file
  std::uint64_t max_splats = std::numeric_limits<std::uint64_t>::max();  // that the renderer can hold
  std::optional<ErrorGoal> goal = std::nullopt;                          // used instead of tolerance and resolution

  [[nodiscard]] bool operator==(const DetailOptions&) const = default;
};

/// How far a frame is from the picture that its view asks for.
struct FrameProgress {
  bool complete = true;      // it is the frame of `request` for its `detail`
  bool settled = true;       // it will not change: complete, except for parts that cannot be read
  std::uint64_t fading = 0;  // regions that fade

  // Parts of the file that are needed.
  std::uint64_t missing_chunks = 0;  // whose locations are known
  std::uint64_t missing_pages = 0;   // of index and directory
  std::uint64_t missing_bytes = 0;   // packed
  std::uint64_t needed_bytes = 0;    // packed, there or not

  std::vector<Error> errors;  // of parts that could not be read since the frame before; each part once
};

/// Splats for a view, back to front; owned by the streamer.
struct FrameSplats {
  SplatSpan data;                   // of all batches, one after another, in Streamer::units
  std::vector<SplatBatch> batches;  // one for each node that has splats
  std::uint64_t serial = 0;         // changes when the splats change; weights may change without it

  // The chosen cut. A coarser detail than the one asked for is what the budget allows.
  std::uint64_t nodes = 0;
  std::uint64_t splats = 0;
  std::vector<std::uint64_t> nodes_by_resolution;   // [resolution]
  std::vector<std::uint64_t> splats_by_resolution;  // [resolution]
  DetailOptions detail;
  double expected_error = 0;  // root mean square of RGB against the exact picture
  double goal_error = 0;      // of `request` with a goal: the same, as ErrorGoal counts it
  bool finest = false;        // of `request` with a goal: more splats would not change the picture

  FrameProgress progress;
};

/// A node of the index that has splats in a frame.
struct DrawnNode {
  Cube cube;
  std::uint32_t resolution;
};

struct StreamerStatistics {
  std::uint64_t bytes_read = 0;           // from the file, since it was opened
  std::uint64_t bytes_resident = 0;       // of the budget, in use now
  std::uint64_t bytes_resident_peak = 0;  // the most that were ever in use
  double cut_seconds = 0;                 // of the last request
  double fetch_seconds = 0;
};

/// An open file, seen through one attribute. All its memory counts against the budget: preamble, pages, chunks, packed
/// bytes that are being read, and splats. Not thread-safe; uses all processors, and its own threads for `advance`.
class Streamer {
 public:
  /// Reads the preamble. Fails if the file is damaged, does not have the attribute (the message lists those that it
  /// has), or lacks columns for the kernel, and if the preamble alone passes the budget.
  [[nodiscard]] static Result<std::unique_ptr<Streamer>> open(std::unique_ptr<ByteSource> source,
                                                              const StreamerOptions& options);

  /// The same for a file that is open, at its step.
  [[nodiscard]] static Result<std::unique_ptr<Streamer>> open(std::shared_ptr<const format::Volume> volume,
                                                              const StreamerOptions& options);
  Streamer(const Streamer&) = delete;
  Streamer& operator=(const Streamer&) = delete;
  ~Streamer();

  /// Returns the splats for a view: chooses, reads and gathers them first. Reuses the splats of the request before if
  /// the cut is the same. If they would pass the budget or max_splats, loses detail and never coverage: raises the
  /// tolerance, lowers the fixed resolution, or lowers the splats of a goal, until they fit. Fails with out_of_budget
  /// if not even the coarsest cut fits; the message names the number of bytes that would suffice. Fails with the
  /// reader's error if the file cannot be read or is damaged.
  ///
  /// The result stays valid until the next request, even if that fails.
  [[nodiscard]] Result<const FrameSplats*> request(const View& view, const TransferFunction& function,
                                                   const DetailOptions& detail);

  /// Returns the best splats for a view that are resident now, or within `wait_seconds`. Until the next call, reads
  /// what else the view asks for: coarse before fine, and larger errors first. The splats always show all of the
  /// volume. Calls with the same view end in a frame that is `complete`, which is the frame of `request` for its
  /// `detail`. This detail is coarser than the one asked for if the splats together with their chunks would pass the
  /// budget.
  ///
  /// `change`, (0, 1]: the share of a change of resolution that this call makes; 1: all at once. With less, a region
  /// whose resolution changes fades: it is drawn both as it was and as it will be. The weights of the two move by
  /// `change` in each call, and the frame is not `complete` before they end. A region changes at once if there are too
  /// few splats or bytes left for both.
  ///
  /// The first call waits for the root of the index and the coarsest resolution, which are held from then on. An error
  /// of a part is reported once, and the part is not asked for again; its nodes are drawn coarser. Fails if the parts
  /// of the first call cannot be read, and if not even the coarsest picture fits.
  ///
  /// The result stays valid until the next call or request.
  [[nodiscard]] Result<const FrameSplats*> advance(const View& view, const TransferFunction& function,
                                                   const DetailOptions& detail, double wait_seconds = 0,
                                                   double change = 1);

  /// Changes to another step of a time series. What all steps share stays in memory, and so do parts of other steps
  /// while there is room. The last result is no longer valid. Fails if there is no such step, if it is damaged, or if
  /// it does not fit the budget; then only destruction is allowed.
  [[nodiscard]] Status set_step(std::size_t step);

  /// The same for a step that is open. If it is in another file, nothing of the file before stays in memory.
  [[nodiscard]] Status set_step(std::shared_ptr<const format::Volume> volume);

  /// Begins to read what the last frame shows of another step of the same series, on a thread of its own, while memory
  /// is free: nothing gives way to it. `set_step` then finds it in memory. Does nothing without a frame, for a file
  /// that is no series, and if there is no such step.
  void prefetch_step(std::size_t step);

  /// Whether `prefetch_step` is still reading, so that `set_step` would wait for it.
  [[nodiscard]] bool is_prefetching() const { return prefetch_ && !prefetch_->is_done(); }

  /// Returns the nodes of the last frame, in the order of its batches; none if there is no frame.
  [[nodiscard]] std::vector<DrawnNode> drawn_nodes() const;

  /// Returns the units of the splats.
  [[nodiscard]] DrawingUnits units() const {
    const format::Attribute& attribute = info().attributes[static_cast<std::size_t>(paged_.attribute())];
    return {drawing_length(info().cube.edge), attribute.offset, attribute.scale};
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

  [[nodiscard]] std::vector<CacheKey> step_chunks_of_frame();
  void add_index_pages(std::size_t step, std::vector<PartLoad>& pages);
  void take_prefetched(StepPrefetch::Result result);
  [[nodiscard]] Status start_paging();
  [[nodiscard]] Status choose_aim(const View& view, const ValueVisibility& visibility, const DetailOptions& detail);
  void want_stages(const View& view, const ValueVisibility& visibility);
  void want_ahead(const View& last, const View& view, const ValueVisibility& visibility);
  [[nodiscard]] std::uint64_t coarsest_frame_bytes() const;
  [[nodiscard]] Result<Cut> choose_resident(DetailOptions& detail);
  [[nodiscard]] Result<Cut> choose_coarsest();
  [[nodiscard]] std::uint64_t fading_splats(const Cut& cut) const;
  void set_weights(FadingCut fading);
  [[nodiscard]] Status show_resident(double change);
  [[nodiscard]] Status make_resident_frame(FadingCut fading, DetailOptions detail);
  [[nodiscard]] FrameProgress extract_progress();

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
  std::optional<View> view_before_;            // the view before that of `aim_`, until `want_ahead`
  std::optional<Reservation> coarsest_frame_;  // while there is a pager: for a frame when memory is spent
  std::unique_ptr<Frame> frame_;
  std::optional<Box> clip_box_;  // of the view that is asked for
  std::unique_ptr<StepPrefetch> prefetch_;
  std::uint64_t next_serial_ = 1;
  double cut_seconds_ = 0;
  double fetch_seconds_ = 0;
};

}  // namespace splatvol
