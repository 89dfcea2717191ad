// From a .svol file and a view to the splats of the view, within a budget of memory.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <tuple>
#include <vector>

#include "base/error.h"
#include "base/file.h"
#include "format/volume.h"
#include "scene/scene.h"
#include "splat/record.h"
#include "splat/splat.h"
#include "streamer/splats/clip.h"
#include "streamer/splats/cut.h"
#include "streamer/splats/detail.h"
#include "streamer/splats/occlusion.h"
#include "streamer/splats/paged_volume.h"
#include "streamer/splats/pager.h"
#include "streamer/splats/row_reader.h"
#include "streamer/splats/step_prefetch.h"
#include "streamer/store/step_ahead.h"

namespace splatvol {

struct StreamerOptions {
  std::uint64_t memory_bytes = std::uint64_t{512} << 20;
  std::string attribute;
  KernelKind kernel = KernelKind::moments;
  bool gradients = false;           // kernel octant: with gradients, for lighting; moments always have them
  unsigned threads = read_threads;  // for reading and decoding in `advance`
  bool hide = true;                 // leaves out nodes behind an opaque front; false: for comparisons

  /// Called on the threads of `advance` when a part was read: another call would use it. Must not call the streamer.
  std::function<void()> on_data = {};

  std::string opacity_attribute = {};  // whose values give a factor on the extinction; empty: none

  // The room of the file, if others use its memory, too: then `memory_bytes` does not count.
  std::optional<PartRoom> room = {};
};

/// How far a frame is from the picture that its view asks for.
struct FrameProgress {
  bool complete = true;  // it is the frame of `request` for its `detail`
  bool settled = true;   // it will not change: complete, except for parts that cannot be read or held

  // Parts of the file that are needed.
  std::uint64_t missing_rows = 0;   // shapes or values of rows, whose locations are known
  std::uint64_t missing_pages = 0;  // of index and directory
  std::uint64_t missing_bytes = 0;  // packed
  std::uint64_t needed_bytes = 0;   // packed, there or not

  std::vector<Error> errors;  // of parts that could not be read or held since the frame before; each part once
};

/// The splats to draw for a view, in Streamer::units; owned by the streamer. The frame holds its rows: the budget
/// counts them. Rows that the caller still holds when another frame has taken its place are the caller's memory.
struct FrameSplats {
  DrawList list;
  DrawList sliced;           // the splats near the view's slices, some perhaps not in `list`; not clipped
  std::uint64_t serial = 0;  // changes when the list changes

  // The chosen cut. A coarser detail than the one asked for is what the budget allows.
  std::uint64_t nodes = 0;
  std::uint64_t splats = 0;
  std::vector<std::uint64_t> nodes_by_resolution;   // [resolution]
  std::vector<std::uint64_t> splats_by_resolution;  // [resolution]
  Detail detail;
  double expected_error = 0;  // root mean square of RGB against the exact picture
  double goal_error = 0;      // of a complete frame with a goal: the same, as ErrorGoal counts it
  bool finest = false;        // of a complete frame with a goal: more splats would not change the picture

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
  std::uint64_t bytes_read_again = 0;  // of bytes_read: those that had been read before
  std::uint64_t requests = 0;          // reads of the file; from a server, requests
};

/// An open file, seen through one attribute, and perhaps an opacity attribute. All its memory counts against
/// the budget: preamble, pages, rows of records, packed bytes that are being read, and draw lists. A row is decoded
/// once, and stays until its memory is needed.
///
/// One rule tells which cuts fit, for `request` and `advance`. A cut costs the rows that it touches, their directory
/// pages, the index pages from which it was chosen, its draw list, and its clipped rows. This is at most three quarters
/// of what the fixed parts leave of the budget. The rest is for parts on their way. All rows count as visible.
/// Not thread-safe; uses all processors, and its own threads for `advance`.
class Streamer {
 public:
  /// Reads the preamble. Fails if the file is damaged, does not have an attribute (the message lists those that it
  /// has), or lacks columns for the kernel, and if the preamble alone passes the budget.
  [[nodiscard]] static Result<std::unique_ptr<Streamer>> open(std::unique_ptr<ByteSource> source,
                                                              const StreamerOptions& options);

  /// The same for a file that is open, at its step.
  [[nodiscard]] static Result<std::unique_ptr<Streamer>> open(std::shared_ptr<const format::Volume> volume,
                                                              const StreamerOptions& options);
  Streamer(const Streamer&) = delete;
  Streamer& operator=(const Streamer&) = delete;
  ~Streamer();

  /// Returns the splats for a view: chooses a cut, and reads the rows that are not there. If the cut does not fit the
  /// budget, or its splats device_splats, loses detail and never coverage: raises the tolerance, lowers the fixed
  /// resolution, or lowers the splats of a goal, until they fit. Fails with out_of_budget if not even the coarsest cut
  /// fits; the message names the number of bytes that would suffice. Fails with the reader's error if the file cannot
  /// be read or is damaged.
  ///
  /// The result stays valid until the next request, even if that fails.
  [[nodiscard]] Result<const FrameSplats*> request(const View& view, const Transfer& transfer, const Detail& detail);

  /// Returns the best splats for a view that are resident now, or within `wait_seconds`. Until the next call, reads
  /// what else the view asks for: coarse before fine, and larger errors first. The splats always show all of the
  /// volume. Calls with the same view end in a frame that is `complete`, which is the frame of `request` for the same
  /// detail: both lose as much detail for the budget.
  ///
  /// The first call waits for the root of the index and the coarsest resolution, which are held from then on. An error
  /// of a part is reported once, and the part is not asked for again; its nodes are drawn coarser. Fails if the parts
  /// of the first call cannot be read, and if not even the coarsest picture fits.
  ///
  /// The result stays valid until the next call or request.
  [[nodiscard]] Result<const FrameSplats*> advance(const View& view, const Transfer& transfer, const Detail& detail,
                                                   double wait_seconds = 0);

  /// Changes to another step of a time series. Parts that all steps share stay in memory, and so do parts of other
  /// steps while there is room. The last result is no longer valid. Fails if there is no such step, if it is damaged,
  /// or if it does not fit the budget; then only destruction is allowed.
  [[nodiscard]] Status set_step(std::size_t step);

  /// The same for a step that is open. If it is in another file, nothing of the file before stays in memory.
  [[nodiscard]] Status set_step(std::shared_ptr<const format::Volume> volume);

  /// Begins to read what the last frame shows of another step of the same series, on a thread of its own, while memory
  /// is free: nothing gives way to it. `set_step` then finds it in memory. Does nothing without a frame, for a file
  /// that is no series, and if there is no such step.
  void prefetch_step(std::size_t step);

  /// Whether `prefetch_step` is still reading, so that `set_step` would wait for it.
  [[nodiscard]] bool is_prefetching() const { return prefetch_ && !prefetch_->is_done(); }

  /// Returns the nodes of the last frame, back to front; none if there is no frame.
  [[nodiscard]] std::vector<DrawnNode> drawn_nodes() const;

  /// Returns the attributes that the file is seen through. They belong to `info`.
  [[nodiscard]] ShownAttributes shown_attributes() const;

  /// Returns the units of the splats.
  [[nodiscard]] DrawingUnits units() const {
    const auto [values, opacity] = shown_attributes();
    const double length = drawing_length(info().cube.edge);
    return {length,
            values.offset,
            values.scale,
            info().cube.edge / length,
            opacity ? opacity->offset : 0,
            opacity ? opacity->scale : 1};
  }

  [[nodiscard]] KernelKind kernel() const { return kernel_; }
  [[nodiscard]] const format::VolumeInfo& info() const { return volume_->info(); }
  [[nodiscard]] const format::Volume& volume() const { return *volume_; }
  [[nodiscard]] std::shared_ptr<const format::Volume> shared_volume() const { return volume_; }

  /// Where the parts of its file are held.
  [[nodiscard]] const PartRoom& room() const { return paged_.room(); }
  [[nodiscard]] StreamerStatistics statistics() const;

 private:
  struct Frame;
  struct TargetCut;

  // A range of records: the ids of its shapes and values, its first record and its number of records.
  using RangeName = std::tuple<std::uint64_t, std::uint64_t, std::uint32_t, std::uint32_t>;
  Streamer(std::shared_ptr<const format::Volume> volume, const format::SummaryAttributes& attributes,
           const StreamerOptions& options);
  [[nodiscard]] MemoryShare& share() const { return *room().share; }
  [[nodiscard]] ValueVisibility visibility_of(const Transfer& transfer, const View& view) const;

  // Budget and choice (streamer_choice.cpp).
  [[nodiscard]] Status set_memory_aside();
  [[nodiscard]] std::uint64_t choice_bytes() const;
  [[nodiscard]] std::uint64_t fixed_bytes() const;
  [[nodiscard]] std::uint64_t budget_for(std::uint64_t bytes) const;
  [[nodiscard]] std::uint64_t granted(std::uint64_t bytes) const;
  [[nodiscard]] std::uint64_t opening_bytes() const;
  [[nodiscard]] std::uint64_t free_bytes() const;
  [[nodiscard]] std::uint64_t cut_limit() const { return free_bytes() / 4 * 3; }
  [[nodiscard]] std::uint64_t list_bytes(const Cut& cut) const;
  [[nodiscard]] std::uint64_t clipped_bytes(const Cut& cut) const;
  [[nodiscard]] std::uint64_t frame_bytes(const Cut& cut) const { return list_bytes(cut) + clipped_bytes(cut); }
  [[nodiscard]] std::uint64_t coarsest_frame_bytes() const;
  [[nodiscard]] std::uint64_t coarsest_cut_bytes() const;
  [[nodiscard]] std::uint64_t cut_bytes(const Cut& cut, std::uint64_t index_bytes) const;
  [[nodiscard]] Status check_fits(const Cut& cut, std::uint64_t index_bytes, const Detail& detail) const;
  [[nodiscard]] Detail first_detail(Detail detail) const;
  [[nodiscard]] CutOptions cut_options(const Detail& detail, std::uint64_t max_bytes);
  [[nodiscard]] Result<Cut> select(IndexPages& index, Residency* residency, const View& view,
                                   const ValueVisibility& visibility, const CutOptions& options);
  [[nodiscard]] Status read_index_ahead(const View& view, const ValueVisibility& visibility, const Detail& detail);
  [[nodiscard]] Result<Choice> choose(const View& view, const ValueVisibility& visibility, const Detail& detail);
  [[nodiscard]] tl::unexpected<Error> fail_for_memory(const View& view, const ValueVisibility& visibility,
                                                      const Detail& detail);

  // Frames (streamer_frame.cpp).
  void drop_frame();
  [[nodiscard]] Status fetch(Cut cut, const ValueVisibility& visibility);
  [[nodiscard]] bool shows(const ValueVisibility& visibility) const;
  [[nodiscard]] Status assemble(Cut cut, const ValueVisibility& visibility, Reservation reservation);
  void add_ranges(Frame& frame, std::span<const RowPart> plan, const HeldRows& rows) const;
  void clip_ranges(Frame& frame, std::map<RangeName, ClippedRange> before) const;
  void count_splats(Frame& frame);
  void add_sliced(Frame& frame) const;

  // Steps (streamer.cpp).
  [[nodiscard]] std::vector<PartLoad> step_rows_of_frame();
  void add_index_pages(std::size_t step, std::vector<PartLoad>& pages);
  [[nodiscard]] bool add_directory_pages(std::size_t step, const PartLoad& row, std::vector<PartLoad>& pages);

  // Paging (streamer_paging.cpp).
  [[nodiscard]] Status start_paging();
  [[nodiscard]] Status choose_target(const View& view, const ValueVisibility& visibility, const Detail& detail);
  void want_stages(const View& view, const ValueVisibility& visibility);
  void prefetch(const View& last, const View& view, const ValueVisibility& visibility);
  [[nodiscard]] bool holds_target();
  [[nodiscard]] Result<Cut> choose_resident(Detail& detail);
  [[nodiscard]] Result<Cut> choose_coarsest();
  [[nodiscard]] Status show_resident();
  [[nodiscard]] Status make_resident_frame(Cut cut, Detail detail);
  [[nodiscard]] Status make_coarsest_frame();
  [[nodiscard]] FrameProgress extract_progress();

  std::shared_ptr<const format::Volume> volume_;
  KernelKind kernel_;
  unsigned threads_;
  bool hide_;
  std::function<void()> on_data_;
  std::optional<PartRoom> own_;  // of the first file
  std::uint64_t working_bytes_ = 0;
  std::uint64_t coarsest_bytes_ = 0;  // of what `advance` always holds: the root, the coarsest rows and their frame
  Reservation fixed_;
  FilledNodes filled_;
  std::optional<KeptOcclusion> occlusion_;
  PagedVolume paged_;
  std::optional<RowReader> reader_;
  std::unique_ptr<Pager> pager_;  // while frames come from `advance`
  std::unique_ptr<TargetCut> target_;
  std::optional<View> view_before_;            // the view before that of `target_`, until `prefetch`
  std::optional<Reservation> coarsest_frame_;  // while there is a pager: for a frame when memory is spent
  std::unique_ptr<Frame> frame_;
  std::map<RangeName, ClippedRange> clipped_before_;  // of the frame before, while a frame is made
  ClipRegion clip_;                                   // of the view that is asked for
  std::vector<Slice> slices_;                         // of the same view
  std::unique_ptr<StepAhead<StepParts>> prefetch_;
  std::uint64_t next_serial_ = 1;
  double cut_seconds_ = 0;
  double fetch_seconds_ = 0;
};

}  // namespace splatvol
