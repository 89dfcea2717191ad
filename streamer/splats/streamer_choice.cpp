// How much detail fits: one rule for `request` and `advance`.
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "streamer/splats/frustum.h"
#include "streamer/splats/streamer.h"
#include "streamer/splats/streamer_frame.h"
#include "streamer/store/row_bytes.h"

namespace splatvol {
namespace {

constexpr std::uint64_t choice_share = 32;  // of the budget: one part in 32 is for choosing cuts by expected error

// Bytes in a frame, besides the cut itself: of an item; and of a part of a row, while the list is made.
constexpr std::uint64_t item_bytes = sizeof(std::uint32_t);
constexpr std::uint64_t part_bytes = sizeof(RowPart) + sizeof(DrawRange) + sizeof(std::uint32_t) +
                                     2 * sizeof(PartPointer) + sizeof(HeldRow) + 4 * sizeof(void*);

// Bytes of a range's entry in the map of clipped ranges.
constexpr std::uint64_t clipped_entry_bytes = 64 + sizeof(ClippedRange) + 4 * sizeof(void*);

std::uint64_t directory_page_bytes(const format::Volume& volume) {
  return volume.most_chunks_of_directory_pages() * (sizeof(format::ChunkEntry) + sizeof(format::ChunkLocation));
}

// Whether the splats of a node may reach beyond a region. A splat's material lies in its node but for its tails, which
// reach less than the node's edge beyond.
bool may_cut(const ClipRegion& clip, const Cube& cube) {
  return is_clipped({cube.origin - cube.edge, 3 * cube.edge}, clip);
}

}  // namespace

// Reserves the fixed parts of the budget, such as the preamble. Leaves room to work in: for the pages on the path to a
// node, and for the chunks of a row. And room for what `advance` holds always, so that it shows as much as `request`.
Status Streamer::set_memory_aside() {
  SPLATVOL_TRY_ASSIGN(root, paged_.read_root());
  working_bytes_ = reader_->working_bytes() + directory_page_bytes(*volume_) + 4 * root.memory_bytes();
  coarsest_bytes_ = reader_->coarsest_row_bytes() + root.memory_bytes() + coarsest_frame_bytes();
  if (kernel_ == KernelKind::moments && hide_) filled_ = FilledNodes::find(*volume_, root, paged_.attributes());
  auto fixed = share().reserve(fixed_bytes());
  if (!fixed || cut_limit() == 0)
    return fail(ErrorCode::out_of_budget, "{}: {} bytes of memory are too few: even opening it needs {}",
                volume_->name(), granted(share().capacity()), granted(budget_for(1)));
  fixed_ = std::move(*fixed);
  return {};
}

// Returns the most bytes for choosing a cut by expected error.
std::uint64_t Streamer::choice_bytes() const { return share().capacity() / choice_share; }

std::uint64_t Streamer::fixed_bytes() const {
  const std::uint64_t occlusion_bytes = filled_.any() ? sizeof(KeptOcclusion) + Occlusion::most_memory_bytes : 0;
  return volume_->memory_bytes() + filled_.memory_bytes() + occlusion_bytes;
}

// Returns the least budget under which a cut of so many bytes fits.
std::uint64_t Streamer::budget_for(std::uint64_t bytes) const {
  const std::uint64_t others = opening_bytes() + bytes + bytes / 3 + 8;
  return others + others / (choice_share - 1) + 1;
}

// Returns the memory that somebody has to grant so that the share has so many bytes.
std::uint64_t Streamer::granted(std::uint64_t bytes) const {
  const double of_one = static_cast<double>(share().budget().capacity()) / static_cast<double>(share().capacity());
  return static_cast<std::uint64_t>(std::ceil(of_one * static_cast<double>(bytes)));
}

// Returns what a streamer needs besides a cut. In a room that others use, another one may open beside this one, unless
// that takes much of the share.
std::uint64_t Streamer::opening_bytes() const {
  constexpr std::uint64_t little = 16;  // a part in so many
  const std::uint64_t bytes = fixed_bytes() + working_bytes_ + coarsest_bytes_;
  return own_ || bytes > share().capacity() / little ? bytes : 2 * bytes;
}

// Returns what the fixed parts leave of the share.
std::uint64_t Streamer::free_bytes() const {
  const std::uint64_t fixed = choice_bytes() + opening_bytes(), all = share().capacity();
  return all > fixed ? all - fixed : 0;
}

// Returns about the bytes of a frame's list and of what makes it.
std::uint64_t Streamer::list_bytes(const Cut& cut) const {
  std::uint64_t parts = 0;
  for (const CutItem& item : cut.items) {
    const auto ranges = cut.ranges_of(item);
    for (std::size_t s = 0; s < ranges.size(); ++s)
      if (ranges[s].count > 0) parts += ranges[s].count / info().points_per_chunk[s] + 2;
  }
  const std::uint64_t each =
      part_bytes + (clip_.is_all() ? 0 : clipped_entry_bytes) + (slices_.empty() ? 0 : sizeof(DrawRange));
  return cut.memory_bytes() + cut.items.size() * item_bytes + parts * each;
}

// Returns a bound on the bytes of clipped rows.
std::uint64_t Streamer::clipped_bytes(const Cut& cut) const {
  if (clip_.is_all()) return 0;
  std::uint64_t bytes = 0;
  for (const CutItem& item : cut.items) {
    if (!may_cut(clip_, item.cube)) continue;
    for (const PointRange& range : cut.ranges_of(item))
      bytes += most_clipped_bytes(kernel_, range.count, reader_->has_opacity());
  }
  return bytes;
}

// Returns a bound on the bytes of a frame of resolution 0 alone, besides its rows. A splat may be a range of its own.
std::uint64_t Streamer::coarsest_frame_bytes() const {
  return info().resolution_counts[0] *
         (sizeof(CutItem) + sizeof(PointRange) + item_bytes + part_bytes + clipped_entry_bytes +
          most_clipped_bytes(kernel_, 1, reader_->has_opacity()) + sizeof(DrawRange));
}

// Returns a bound on what select_cut counts of a cut of resolution 0 alone.
std::uint64_t Streamer::coarsest_cut_bytes() const {
  return info().resolution_counts[0] * (record_bytes(kernel_) + sizeof(CutItem) + sizeof(PointRange));
}

// Returns what a cut costs. `index_bytes`: of the index pages from which it was chosen.
std::uint64_t Streamer::cut_bytes(const Cut& cut, std::uint64_t index_bytes) const {
  return frame_bytes(cut) + reader_->row_bytes(cut) + index_bytes;
}

// The rule of the budget: fails with out_of_budget if a cut does not fit.
Status Streamer::check_fits(const Cut& cut, std::uint64_t index_bytes, const Detail& detail) const {
  if (cut.splats > detail.device_splats)
    return fail(ErrorCode::out_of_budget, "the view needs more than the {} splats of the device", detail.device_splats);
  if (cut_bytes(cut, index_bytes) > cut_limit())
    return fail(ErrorCode::out_of_budget, "the view needs more than {} bytes", cut_limit());
  return {};
}

// Returns the detail from which the search for one that fits begins.
Detail Streamer::first_detail(Detail detail) const {
  if (detail.resolution) detail.resolution = std::min(*detail.resolution, info().resolutions() - 1);
  if (detail.goal) {
    const std::uint64_t most = std::min(cut_limit() / record_bytes(kernel_), detail.device_splats);
    detail.goal->max_splats =
        std::min({detail.goal->max_splats, info().point_count(), std::max<std::uint64_t>(most, 1)});
  }
  return detail;
}

CutOptions Streamer::cut_options(const Detail& detail, std::uint64_t max_bytes) {
  CutOptions options{.detail = detail,
                     .kernel = kernel_,
                     .filled = &filled_,
                     .kept_occlusion = &occlusion_,
                     .max_choice_bytes = choice_bytes(),
                     .max_bytes = max_bytes};
  return options;
}

// Chooses a cut, and reserves the memory that this needs meanwhile.
Result<Cut> Streamer::select(IndexPages& index, Residency* residency, const View& view,
                             const ValueVisibility& visibility, const CutOptions& options) {
  std::optional<Reservation> room;
  if (options.detail.goal && !(room = share().reserve(choice_bytes())))
    return fail(ErrorCode::out_of_budget, "{}: no memory to choose by expected error", volume_->name());
  return residency ? select_resident_cut(info(), index, *residency, view, visibility, options)
                   : select_cut(info(), index, view, visibility, options);
}

namespace {

// Index pages that are there, and what is missing of those that were asked for.
class HeldPages final : public IndexPages {
 public:
  explicit HeldPages(PagedVolume& paged) : paged_(paged) {}

  [[nodiscard]] Result<std::shared_ptr<const format::IndexPage>> root() override { return paged_.root(); }
  [[nodiscard]] Result<std::shared_ptr<const format::IndexPage>> linked(const format::IndexPage& page,
                                                                        std::uint32_t node) override {
    auto [key, load] = paged_.load_of_linked(page, node);
    auto held = paged_.room().find<format::IndexPage>(key);
    if (!held) missing.emplace(key, std::move(load));
    return held;
  }

  std::map<PartKey, IndexPageLoad> missing = {};

 private:
  PagedVolume& paged_;
};

}  // namespace

// Reads the index pages from which a cut will be chosen: those of a level together. Ends if memory does not hold them.
Status Streamer::read_index_ahead(const View& view, const ValueVisibility& visibility, const Detail& detail) {
  CutOptions options = cut_options(first_detail(detail), cut_limit());
  options.kept_occlusion = nullptr;
  for (std::set<PartKey> read;;) {
    HeldPages pages(paged_);
    if (!select(pages, nullptr, view, visibility, options)) return {};
    const std::size_t before = read.size();
    for (const auto& [key, load] : pages.missing) read.insert(key);
    if (read.size() == before) return {};
    SPLATVOL_TRY(paged_.read_index_pages(std::move(pages.missing)));
  }
}

// Chooses for `request`, which waits for index pages.
Result<Choice> Streamer::choose(const View& view, const ValueVisibility& visibility, const Detail& detail) {
  if (volume_->is_far()) SPLATVOL_TRY(read_index_ahead(view, visibility, detail));
  PagedVolume::Used used;
  auto choice = choose_finest(first_detail(detail), [&](const Detail& tried) -> Result<Cut> {
    paged_.forget_used();
    SPLATVOL_TRY_ASSIGN(cut, select(paged_, nullptr, view, visibility, cut_options(tried, cut_limit())));
    SPLATVOL_TRY(check_fits(cut, paged_.used().bytes, tried));
    used = paged_.used();
    return cut;
  });
  paged_.set_used(std::move(used));
  return choice;
}

tl::unexpected<Error> Streamer::fail_for_memory(const View& view, const ValueVisibility& visibility,
                                                const Detail& detail) {
  Detail coarsest_detail = detail;
  while (make_coarser(coarsest_detail)) {
  }
  const CutOptions options = cut_options(coarsest_detail, std::numeric_limits<std::uint64_t>::max());
  paged_.forget_used();
  const auto coarsest = select(paged_, nullptr, view, visibility, options);
  if (!coarsest && coarsest.error().code == ErrorCode::out_of_budget)
    return fail(ErrorCode::out_of_budget,
                "{}: {} bytes of memory are too few for the index of this view: grant more, such as {}",
                volume_->name(), granted(share().capacity()), granted(2 * share().capacity()));
  if (!coarsest) return tl::unexpected(coarsest.error());
  if (coarsest->splats > detail.device_splats)
    return fail(ErrorCode::out_of_budget, "{}: even the coarsest picture has {} splats, and the device holds {}",
                volume_->name(), coarsest->splats, detail.device_splats);
  return fail(ErrorCode::out_of_budget, "{}: {} bytes of memory are too few: even the coarsest picture needs {}",
              volume_->name(), granted(share().capacity()),
              granted(budget_for(cut_bytes(*coarsest, paged_.used().bytes))));
}

}  // namespace splatvol
