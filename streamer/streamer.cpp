#include "streamer/streamer.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <set>
#include <utility>

#include "streamer/clip.h"

namespace splatvol {
namespace {

// A tolerance that does not fit is doubled, from this one on, until it fits, and then refined by halving the interval.
constexpr double smallest_raised_tolerance = 1.0 / 16;
constexpr double largest_raised_tolerance = 1 << 20;
constexpr int refinements = 4;

// Bytes of an item in a frame, besides the cut itself.
constexpr std::uint64_t item_bytes =
    sizeof(FadingCut::Role) + sizeof(SplatBatch) + sizeof(std::uint32_t) + sizeof(std::uint64_t);

constexpr std::uint64_t choice_share = 32;  // of the budget: one part in 32 is for choosing cuts by expected error

constexpr int stages = 3;  // coarser pictures on the way to the aim

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

double next_tolerance(double refused) {
  if (refused >= largest_raised_tolerance) return std::numeric_limits<double>::infinity();
  return std::max(2 * refused, smallest_raised_tolerance);
}

// Returns a bound on the bytes of a frame: the cut, its plan, and the splats.
std::uint64_t frame_bytes(const Cut& cut, const format::VolumeInfo& info, KernelKind kernel) {
  std::uint64_t jobs = 0;
  for (const CutItem& item : cut.items) {
    const auto ranges = cut.ranges_of(item);
    for (std::size_t s = 0; s < ranges.size(); ++s)
      if (ranges[s].count > 0) jobs += ranges[s].count / info.points_per_chunk[s] + 2;
  }
  return cut.memory_bytes() + cut.splats * splat_bytes(kernel) + cut.items.size() * item_bytes + jobs * sizeof(CopyJob);
}

void clip_items(const Cut& cut, const GatherPlan& plan, const Box& clip_box, double length, SplatArray& array) {
  tbb::parallel_for(std::size_t{0}, cut.items.size(), [&](std::size_t i) {
    const std::uint64_t begin = i > 0 ? plan.item_ends[i - 1] : 0;
    const dvec3 origin = cut.items[i].cube.origin + 0.5 * cut.items[i].cube.edge;
    const std::uint64_t count = plan.item_ends[i] - begin;
    const Box box{(clip_box.low - origin) / length, (clip_box.high - origin) / length};
    if (std::holds_alternative<std::span<const MomentsSplat>>(array.splats()))
      clip(array.as<MomentsSplat>().subspan(begin, count), box);
    else
      clip(array.as<OctantSplat>().subspan(begin, count), box);
  });
}

std::uint64_t directory_page_bytes(const format::Volume& volume) {
  return volume.most_chunks_of_directory_pages() * (sizeof(format::ChunkEntry) + sizeof(format::ChunkLocation));
}

// The coarseness is the number that is raised for less detail: the tolerance, or the inverse of a goal's splats.
double coarseness(const DetailOptions& detail) {
  return detail.goal ? 1 / static_cast<double>(detail.goal->max_splats) : detail.tolerance_percent;
}

DetailOptions with_coarseness(DetailOptions detail, double coarseness) {
  if (detail.goal)
    detail.goal->max_splats = static_cast<std::uint64_t>(1 / coarseness);
  else
    detail.tolerance_percent = coarseness;
  return detail;
}

// Returns false, and changes nothing, if the detail is the coarsest.
bool make_coarser(DetailOptions& detail) {
  if (detail.goal) return detail.goal->max_splats > 1 && (detail.goal->max_splats /= 2, true);
  if (detail.resolution) return *detail.resolution > 0 && (--*detail.resolution, true);
  if (std::isinf(detail.tolerance_percent)) return false;
  detail.tolerance_percent = next_tolerance(detail.tolerance_percent);
  return true;
}

Status check_detail(const DetailOptions& detail) {
  if (detail.goal && !(detail.goal->max_error >= 0))
    return fail(ErrorCode::invalid_argument, "an error of {} is out of range", detail.goal->max_error);
  if (detail.tolerance_percent >= 0) return {};
  return fail(ErrorCode::invalid_argument, "a tolerance of {} % is out of range", detail.tolerance_percent);
}

}  // namespace

struct Streamer::Frame {
  FadingCut fading;
  std::vector<std::uint32_t> items;  // [batch]: of the cut
  ValueVisibility visibility;
  std::optional<Box> clip_box;
  Reservation reservation;
  SplatArray array;
  FrameSplats splats;
};

// The cut that a view should be drawn with, chosen from the index pages that are there.
struct Streamer::Aim {
  View view;
  ValueVisibility visibility;
  DetailOptions asked;
  Choice choice;
  std::uint64_t bytes;  // of its frame, its chunks and the index pages
};

Streamer::Streamer(std::shared_ptr<const format::Volume> volume, int attribute, const StreamerOptions& options)
    : volume_(std::move(volume)),
      kernel_(options.kernel),
      threads_(std::max(options.threads, 1U)),
      hide_(options.hide),
      budget_(options.memory_bytes),
      cache_(budget_),
      paged_(*volume_, attribute, cache_) {}

Streamer::~Streamer() = default;

Result<std::unique_ptr<Streamer>> Streamer::open(std::unique_ptr<ByteSource> source, const StreamerOptions& options) {
  SPLATVOL_TRY_ASSIGN(volume, format::Volume::open(std::move(source)));
  return open(std::move(volume), options);
}

Result<std::unique_ptr<Streamer>> Streamer::open(std::shared_ptr<const format::Volume> volume,
                                                 const StreamerOptions& options) {
  SPLATVOL_TRY_ASSIGN(attribute, format::find_attribute(volume->info(), options.attribute, volume->name()));
  std::unique_ptr<Streamer> streamer(new Streamer(std::move(volume), attribute, options));
  SPLATVOL_TRY_ASSIGN(gatherer,
                      Gatherer::create(streamer->paged_, streamer->cache_, options.kernel, options.gradients));
  streamer->gatherer_ = std::move(gatherer);
  SPLATVOL_TRY(streamer->set_memory_aside());
  return streamer;
}

Status Streamer::set_step(std::size_t step) {
  if (prefetch_ && prefetch_->step() == step) {
    StepPrefetch::Result read = prefetch_->extract();
    prefetch_.reset();
    if (read.volume) {
      std::shared_ptr<const format::Volume> volume = read.volume;
      take_prefetched(std::move(read));
      return set_step(std::move(volume));
    }
  }
  SPLATVOL_TRY_ASSIGN(volume, volume_->at_step(step));
  return set_step(std::move(volume));
}

void Streamer::take_prefetched(StepPrefetch::Result result) {
  for (PartLoad& part : result.parts) cache_.insert(part.key, std::move(*part.data), std::move(part.decoded));
}

// The chunks of the step that the frame consists of, coarse before fine.
std::vector<CacheKey> Streamer::step_chunks_of_frame() {
  std::vector<CacheKey> keys;
  const auto plan = gatherer_->plan(frame_->fading.cut, frame_->visibility);
  if (!plan) return keys;
  for (const CopyJob& job : plan->jobs)
    for (const int column : gatherer_->columns())
      if (volume_->is_of_step(column)) keys.push_back(gatherer_->chunk_key(job.resolution, job.group, column));
  std::ranges::sort(keys);
  keys.erase(std::ranges::unique(keys).begin(), keys.end());
  return keys;
}

// Adds the index pages from which the frame was chosen, as at another step. Without memory for a page, it stops.
void Streamer::add_index_pages(std::size_t step, std::vector<PartLoad>& pages) {
  std::set<CacheKey> keys = paged_.used();
  if (pager_)
    for (const auto& [key, held] : pager_->pages().held) keys.insert(key);
  for (CacheKey key : keys) {
    if (key.kind == CacheKey::Kind::directory_page) continue;
    const Cache::Pointer held = cache_.find(key);
    key.step = step + 1;
    if (!held || cache_.find(key)) continue;
    const std::shared_ptr<const format::IndexPage> structure(held, &std::get<format::IndexPage>(*held));
    auto room = cache_.reserve_spare(structure->memory_bytes());
    if (!room) return;
    pages.push_back({key, IndexPageLoad{{}, 0, {}, structure}, std::move(*room), {}, CacheData()});
  }
}

void Streamer::prefetch_step(std::size_t step) {
  if (!frame_ || !volume_->series() || step >= volume_->series()->steps.size()) return;
  if (step == volume_->step() || (prefetch_ && prefetch_->step() == step)) return;
  prefetch_.reset();
  const std::uint64_t points = info().largest_group();
  const std::uint64_t payload = largest_payload(format::ColumnKind::value_moments, points);
  auto working = cache_.reserve_spare(format::max_preamble_bytes + StepPrefetch::run_bytes + payload +
                                      decoding_bytes(format::ColumnKind::value_moments, points, payload));
  if (!working) return;

  std::vector<PartLoad> pages, chunks;
  add_index_pages(step, pages);
  std::set<std::uint64_t> numbers;
  for (CacheKey key : step_chunks_of_frame()) {
    const std::uint64_t number = volume_->directory_page_of_row(key.number, key.column);
    key.step = step + 1;
    if (cache_.find(key)) continue;
    if (!numbers.contains(number)) {
      auto room = cache_.reserve_spare(paged_.directory_page_bytes(number));
      if (!room) break;
      numbers.insert(number);
      const CacheKey page{CacheKey::Kind::directory_page, number, -1, step + 1};
      pages.push_back({page, DirectoryPageLoad(), std::move(*room), {}, CacheData()});
    }
    const format::ColumnKind kind = gatherer_->column(key.column).kind;
    const std::uint32_t count = volume_->rows().group(volume_->rows().group_of_row(key.number)).count;
    auto room = cache_.reserve_spare(decoded_bytes(kind, count));
    if (!room) break;
    chunks.push_back(chunk_load(key, {kind, count, {}}));
    chunks.back().decoded = std::move(*room);
  }
  prefetch_ = std::make_unique<StepPrefetch>(volume_, step, paged_.attribute(), std::move(pages), std::move(chunks),
                                             std::move(*working));
}

// The pager, the frame and what hides others belong to the step before.
Status Streamer::set_step(std::shared_ptr<const format::Volume> volume) {
  const std::string& name = info().attributes[static_cast<std::size_t>(paged_.attribute())].name;
  SPLATVOL_TRY_ASSIGN(attribute, format::find_attribute(volume->info(), name, volume->name()));
  const bool gradients = gatherer_->columns().size() > 3;
  prefetch_.reset();
  pager_.reset();
  aim_.reset();
  frame_.reset();
  coarsest_frame_.reset();
  occlusion_.reset();
  filled_ = {};
  view_before_.reset();
  if (!volume->is_same_file(*volume_)) cache_.clear();
  const auto before = std::exchange(volume_, std::move(volume));  // paged_ and gatherer_ still refer to it
  paged_.set_step(*volume_, attribute);
  SPLATVOL_TRY_ASSIGN(gatherer, Gatherer::create(paged_, cache_, kernel_, gradients));
  gatherer_ = std::move(gatherer);
  fixed_ = Reservation();
  return set_memory_aside();
}

// Reserves the fixed parts of the budget, such as the preamble. Leaves room to work in: for the pages on the path to a
// node, and for the chunks of a row.
Status Streamer::set_memory_aside() {
  SPLATVOL_TRY_ASSIGN(root, paged_.read_root());
  working_bytes_ = gatherer_->working_bytes() + directory_page_bytes(*volume_) + 4 * root.memory_bytes();
  if (kernel_ == KernelKind::moments && hide_) filled_ = FilledNodes::find(*volume_, root, paged_.attribute());
  auto fixed = cache_.reserve(fixed_bytes());
  if (!fixed || frame_limit() == 0)
    return fail(ErrorCode::out_of_budget, "{}: {} bytes of memory are too few: even opening it needs {}",
                volume_->name(), budget_.capacity(), budget_for(1));
  fixed_ = std::move(*fixed);
  return {};
}

// Returns the most bytes for choosing a cut by expected error.
std::uint64_t Streamer::choice_bytes() const { return budget_.capacity() / choice_share; }

std::uint64_t Streamer::fixed_bytes() const {
  const std::uint64_t occlusion_bytes = filled_.any() ? sizeof(KeptOcclusion) + Occlusion::most_memory_bytes : 0;
  return volume_->memory_bytes() + filled_.memory_bytes() + occlusion_bytes;
}

// Returns the least budget that leaves this many bytes for a frame.
std::uint64_t Streamer::budget_for(std::uint64_t bytes) const {
  const std::uint64_t others = fixed_bytes() + working_bytes_ + bytes;
  return others + others / (choice_share - 1) + 1;
}

std::uint64_t Streamer::frame_limit() const {
  const std::uint64_t fixed = fixed_bytes() + working_bytes_ + choice_bytes();
  return budget_.capacity() > fixed ? budget_.capacity() - fixed : 0;
}

Result<const FrameSplats*> Streamer::request(const View& view, const TransferFunction& function,
                                             const DetailOptions& detail) {
  SPLATVOL_TRY(check_detail(detail));
  clip_box_ = view.clip_box;
  aim_.reset();
  pager_.reset();
  coarsest_frame_.reset();
  paged_.forget_used();
  const auto cut_start = std::chrono::steady_clock::now();
  const ValueVisibility visibility(function, info().attributes[static_cast<std::size_t>(paged_.attribute())],
                                   units().length);
  auto choice = choose(detail, [&](const DetailOptions& tried) { return try_cut(view, visibility, tried); });
  cut_seconds_ = seconds_since(cut_start);
  fetch_seconds_ = 0;
  if (!choice) {
    frame_.reset();
    if (choice.error().code == ErrorCode::out_of_budget) return fail_for_memory(view, visibility, detail, false);
    return tl::unexpected(choice.error());
  }

  const bool same = shows(visibility) && frame_->fading.cut == choice->cut && frame_->fading.fades.empty();
  if (!same) {
    const auto fetch_start = std::chrono::steady_clock::now();
    SPLATVOL_TRY(fetch(std::move(choice->cut), visibility));
    fetch_seconds_ = seconds_since(fetch_start);
  }
  frame_->splats.detail = choice->detail;
  frame_->splats.progress = {};
  return &frame_->splats;
}

CutOptions Streamer::cut_options(const DetailOptions& detail, std::uint64_t max_bytes) {
  CutOptions options;
  options.tolerance_percent = detail.tolerance_percent;
  options.kernel = kernel_;
  options.resolution = detail.resolution;
  options.goal = detail.goal;
  options.filled = &filled_;
  options.kept_occlusion = &occlusion_;
  options.max_choice_bytes = choice_bytes();
  options.max_bytes = max_bytes;
  return options;
}

// Chooses a cut, and reserves the memory that this needs meanwhile.
Result<Cut> Streamer::select(IndexPages& index, Residency* residency, const View& view,
                             const ValueVisibility& visibility, const CutOptions& options) {
  std::optional<Reservation> room;
  if (options.goal && !(room = cache_.reserve(choice_bytes())))
    return fail(ErrorCode::out_of_budget, "{}: no memory to choose by expected error", volume_->name());
  return residency ? select_resident_cut(info(), index, *residency, view, visibility, options)
                   : select_cut(info(), index, view, visibility, options);
}

Result<Cut> Streamer::try_cut(const View& view, const ValueVisibility& visibility, const DetailOptions& detail) {
  SPLATVOL_TRY_ASSIGN(cut, select(paged_, nullptr, view, visibility, cut_options(detail, frame_limit())));
  if (cut.splats > detail.max_splats)
    return fail(ErrorCode::out_of_budget, "the view needs more than {} splats", detail.max_splats);
  if (frame_bytes(cut, info(), kernel_) > frame_limit())
    return fail(ErrorCode::out_of_budget, "the view needs more than {} bytes", frame_limit());
  return cut;
}

// Chooses the finest detail that fits, no finer than `detail`. Fails with the error of try_cut for the coarsest.
Result<Streamer::Choice> Streamer::choose(DetailOptions detail, const TryCut& try_cut) const {
  if (detail.resolution) detail.resolution = std::min(*detail.resolution, info().resolutions() - 1);
  if (detail.goal)
    detail.goal->max_splats = std::min({detail.goal->max_splats, detail.max_splats, info().point_count(),
                                        std::max<std::uint64_t>(frame_limit() / splat_bytes(kernel_), 1)});

  // Makes the detail coarser until it fits.
  DetailOptions refused = detail;
  auto cut = try_cut(detail);
  while (!cut) {
    refused = detail;
    if (cut.error().code != ErrorCode::out_of_budget || !make_coarser(detail)) return tl::unexpected(cut.error());
    cut = try_cut(detail);
  }
  Choice best{std::move(*cut), detail};
  if (detail.resolution) return best;

  // Makes it finer again while it fits.
  double too_fine = coarseness(refused);
  for (int i = 0; i < refinements; ++i) {
    const double fits = coarseness(best.detail);
    if (!(too_fine > 0 && too_fine < fits && std::isfinite(fits))) break;
    detail = with_coarseness(detail, std::sqrt(too_fine * fits));
    cut = try_cut(detail);
    if (cut)
      best = Choice{std::move(*cut), detail};
    else
      too_fine = coarseness(detail);
  }
  return best;
}

tl::unexpected<Error> Streamer::fail_for_memory(const View& view, const ValueVisibility& visibility,
                                                const DetailOptions& detail, bool paging) {
  DetailOptions coarsest_detail = detail;
  while (make_coarser(coarsest_detail)) {
  }
  const CutOptions options = cut_options(coarsest_detail, std::numeric_limits<std::uint64_t>::max());
  const auto coarsest = select(paged_, nullptr, view, visibility, options);
  if (!coarsest) return tl::unexpected(coarsest.error());
  if (coarsest->splats > detail.max_splats)
    return fail(ErrorCode::out_of_budget, "{}: even the coarsest picture needs {} splats, more than {}",
                volume_->name(), coarsest->splats, detail.max_splats);
  std::uint64_t bytes = frame_bytes(*coarsest, info(), kernel_);
  if (paging)
    bytes = pager_->pinned_bytes() + coarsest_frame_bytes() +
            2 * (bytes + gatherer_->resident_bytes(*coarsest) + pager_->pages().index_bytes);
  return fail(ErrorCode::out_of_budget, "{}: {} bytes of memory are too few: even the coarsest picture needs {}",
              volume_->name(), budget_.capacity(), budget_for(bytes));
}

Status Streamer::fetch(Cut cut, const ValueVisibility& visibility) {
  frame_.reset();
  auto reservation = cache_.reserve(frame_bytes(cut, info(), kernel_));
  if (!reservation) return fail(ErrorCode::out_of_budget, "{}: no memory for {} splats", volume_->name(), cut.splats);
  return assemble({{}, std::move(cut), {}, {}}, visibility, std::move(*reservation));
}

// Whether the frame was made for these visible values, and for the present clip box.
bool Streamer::shows(const ValueVisibility& visibility) const {
  return frame_ && frame_->visibility == visibility && frame_->clip_box == clip_box_;
}

Status Streamer::assemble(FadingCut fading, const ValueVisibility& visibility, Reservation reservation) {
  const Cut& cut = fading.cut;
  SPLATVOL_TRY_ASSIGN(plan, gatherer_->plan(cut, visibility));
  SPLATVOL_TRY_ASSIGN(array, gatherer_->gather(cut, plan));
  if (clip_box_) clip_items(cut, plan, *clip_box_, units().length, array);

  FrameSplats splats;
  splats.data = array.splats();
  splats.serial = next_serial_++;
  splats.expected_error = std::sqrt(cut.squared_error);
  splats.goal_error = std::sqrt(cut.squared_goal_error);
  splats.finest = cut.finest;
  splats.splats = plan.splats;
  splats.nodes_by_resolution.resize(info().resolutions());
  splats.splats_by_resolution.resize(info().resolutions());
  std::vector<std::uint32_t> items;
  std::uint64_t begin = 0;
  for (std::uint32_t i = 0; i < cut.items.size(); ++i) {
    const CutItem& item = cut.items[i];
    const std::uint64_t count = plan.item_ends[i] - begin;
    if (count > 0) {
      ++splats.nodes;
      ++splats.nodes_by_resolution[item.resolution];
      splats.splats_by_resolution[item.resolution] += count;
      splats.batches.push_back({item.cube.origin + 0.5 * item.cube.edge, begin, count, fading.weight_of(i)});
      items.push_back(i);
    }
    begin += count;
  }
  frame_ = std::make_unique<Frame>(Frame{std::move(fading), std::move(items), visibility, clip_box_,
                                         std::move(reservation), std::move(array), std::move(splats)});
  return {};
}

// Returns the memory for paging. Most of it is for the splats of the aim and their chunks. A little is for pictures on
// the way to the aim, which may have more splats, and for parts that are being read.
std::uint64_t Streamer::paging_memory() const {
  const std::uint64_t fixed =
      fixed_bytes() + choice_bytes() + gatherer_->working_bytes() + pager_->pinned_bytes() + coarsest_frame_bytes();
  return budget_.capacity() > fixed ? budget_.capacity() - fixed : 0;
}

Status Streamer::start_paging() {
  if (pager_) return {};
  frame_.reset();
  auto pager = std::make_unique<Pager>(paged_, cache_, *gatherer_, frame_limit() / 8, threads_);
  SPLATVOL_TRY(pager->pin_coarsest());
  coarsest_frame_ = cache_.reserve(coarsest_frame_bytes());
  if (!coarsest_frame_) return fail(ErrorCode::out_of_budget, "{}: no memory for the coarsest splats", volume_->name());
  pager_ = std::move(pager);
  return {};
}

Result<const FrameSplats*> Streamer::advance(const View& view, const TransferFunction& function,
                                             const DetailOptions& detail, double wait_seconds, double change) {
  SPLATVOL_TRY(check_detail(detail));
  clip_box_ = view.clip_box;
  if (!(change > 0 && change <= 1)) return fail(ErrorCode::invalid_argument, "{} is no share of a change", change);
  const auto start = std::chrono::steady_clock::now();
  const auto deadline = start + std::chrono::duration_cast<std::chrono::steady_clock::duration>(
                                    std::chrono::duration<double>(std::min(wait_seconds, 1e6)));
  SPLATVOL_TRY(start_paging());
  if (frame_) frame_->splats.progress.errors.clear();
  const ValueVisibility visibility(function, info().attributes[static_cast<std::size_t>(paged_.attribute())],
                                   units().length);
  const bool steady = aim_ && aim_->view == view && aim_->visibility == visibility && aim_->asked == detail;
  if (!steady) {
    view_before_ = aim_ ? std::optional(aim_->view) : std::nullopt;
    aim_.reset();
  }

  for (Pager::Arrivals arrived = pager_->accept_arrivals();;) {
    if (!aim_ || arrived.pages) SPLATVOL_TRY(choose_aim(view, visibility, detail));
    if (!steady || arrived || !pager_->is_reading()) pager_->ask();
    if (pager_->missing().settled() || std::chrono::steady_clock::now() >= deadline) break;
    pager_->wait_until(deadline);
    arrived = pager_->accept_arrivals();
    if (!arrived) break;
  }
  if (view_before_ && pager_->missing().settled()) {
    want_ahead(*view_before_, view, visibility);
    view_before_.reset();
  }
  cut_seconds_ = seconds_since(start);
  SPLATVOL_TRY(show_resident(change));
  fetch_seconds_ = seconds_since(start) - cut_seconds_;
  return &frame_->splats;
}

// Chooses the aim from the index pages that are there. When more pages have arrived for the same view, chooses again,
// but never finer than before: otherwise two choices might alternate.
Status Streamer::choose_aim(const View& view, const ValueVisibility& visibility, const DetailOptions& detail) {
  const std::uint64_t limit = paging_memory() / 4 * 3;
  Pager::Pages pages;
  std::uint64_t aimed_bytes = 0;
  const auto try_cut = [&](const DetailOptions& tried) -> Result<Cut> {
    pager_->begin_selection();
    SPLATVOL_TRY_ASSIGN(cut, select(*pager_, nullptr, view, visibility, cut_options(tried, limit)));
    if (cut.splats > tried.max_splats)
      return fail(ErrorCode::out_of_budget, "the view needs more than {} splats", tried.max_splats);
    const std::uint64_t bytes =
        frame_bytes(cut, info(), kernel_) + gatherer_->resident_bytes(cut) + pager_->pages().index_bytes;
    if (bytes > limit) return fail(ErrorCode::out_of_budget, "the view needs more than {} bytes", limit);
    pages = pager_->pages();
    aimed_bytes = bytes;
    return cut;
  };
  auto choice = choose(aim_ ? aim_->choice.detail : detail, try_cut);
  if (!choice) {
    aim_.reset();
    frame_.reset();
    if (choice.error().code == ErrorCode::out_of_budget) return fail_for_memory(view, visibility, detail, true);
    return tl::unexpected(choice.error());
  }
  pager_->forget(visibility);
  pager_->keep_pages(std::move(pages));
  pager_->want(choice->cut, 0);
  aim_ = std::make_unique<Aim>(Aim{view, visibility, detail, std::move(*choice), aimed_bytes});
  want_stages(view, visibility);
  return {};
}

// Wants coarser pictures on the way to the aim. They cost little: each has about a twentieth of the splats of the next.
void Streamer::want_stages(const View& view, const ValueVisibility& visibility) {
  const DetailOptions& aimed = aim_->choice.detail;
  std::uint64_t bytes_left = std::min(paging_memory() / 16, gatherer_->resident_bytes(aim_->choice.cut) / 5);
  for (int stage = stages; stage > 0; --stage) {
    DetailOptions detail = aimed;
    if (aimed.resolution) {
      if (*aimed.resolution < static_cast<std::size_t>(2 * stage)) continue;
      *detail.resolution -= static_cast<std::size_t>(2 * stage);
    } else if (aimed.goal) {
      const double share = std::pow(20, -stage);
      detail.goal = ErrorGoal{0, static_cast<std::uint64_t>(share * static_cast<double>(aim_->choice.cut.splats))};
    } else {
      detail.tolerance_percent = std::max(aimed.tolerance_percent, smallest_raised_tolerance) * std::pow(3, stage);
    }
    const auto cut = select(*pager_, nullptr, view, visibility, cut_options(detail, bytes_left));
    if (!cut) continue;
    const std::uint64_t bytes = gatherer_->resident_bytes(*cut);
    if (bytes > bytes_left) continue;
    bytes_left -= bytes;
    pager_->want(*cut, stage);
  }
}

// Wants the cut of the next view, as far as memory is free. Assumes that the camera goes on as before.
void Streamer::want_ahead(const View& last, const View& view, const ValueVisibility& visibility) {
  View next = view;
  next.eye += view.eye - last.eye;
  const dvec3 forward = 2.0 * view.forward - last.forward;
  const dvec3 right = 2.0 * view.right - last.right;
  if (!(glm::length(glm::cross(forward, right)) > 0)) return;
  next.forward = glm::normalize(forward);
  next.right = glm::normalize(right - glm::dot(right, next.forward) * next.forward);
  next.up = glm::cross(next.right, next.forward);

  // The occlusion of the next view must not replace that of this view.
  Pager::Pages pages = pager_->pages();
  CutOptions options = cut_options(aim_->choice.detail, paging_memory() / 4 * 3);
  options.kept_occlusion = nullptr;
  const auto cut = select(*pager_, nullptr, next, visibility, options);
  pager_->keep_pages_and_ask_ahead(std::move(pages));
  if (!cut) return;
  pager_->want(*cut, Pager::ahead);
  pager_->ask();
}

// Returns a bound on the bytes of a frame of resolution 0 alone.
std::uint64_t Streamer::coarsest_frame_bytes() const {
  return info().resolution_counts[0] *
         (splat_bytes(kernel_) + sizeof(CutItem) + sizeof(PointRange) + item_bytes + 2 * sizeof(CopyJob));
}

// Chooses the best resident cut within the memory and the splats for it, or else the coarsest. Makes `detail` coarser
// if it must.
Result<Cut> Streamer::choose_resident(DetailOptions& detail) {
  const std::uint64_t limit =
      std::max(frame_bytes(aim_->choice.cut, info(), kernel_) + paging_memory() / 16, coarsest_frame_bytes());
  do {
    auto cut = select(*pager_, pager_.get(), aim_->view, aim_->visibility, cut_options(detail, limit));
    if (!cut && cut.error().code != ErrorCode::out_of_budget) return cut;
    if (cut && cut->splats <= detail.max_splats && frame_bytes(*cut, info(), kernel_) <= limit) return cut;
  } while (make_coarser(detail));
  return choose_coarsest();
}

Result<Cut> Streamer::choose_coarsest() {
  struct CoarsestOnly final : Residency {
    bool holds(std::span<const PointRange> ranges) override { return ranges.size() == 1; }
  } coarsest;
  DetailOptions detail;
  detail.tolerance_percent = std::numeric_limits<double>::infinity();
  return select_resident_cut(info(), *pager_, coarsest, aim_->view, aim_->visibility,
                             cut_options(detail, coarsest_frame_bytes()));
}

// Returns how many splats fades may draw besides those of a cut. The aim and the parts that are being read leave memory
// for them and for their chunks, which are about twice as large.
std::uint64_t Streamer::fading_splats(const Cut& cut) const {
  const std::uint64_t most_bytes = paging_memory() / 8 * 7;
  const std::uint64_t bytes = most_bytes - std::min(aim_->bytes, most_bytes);
  const std::uint64_t splats = aim_->choice.detail.max_splats;
  return std::min(bytes / (3 * splat_bytes(kernel_)), splats - std::min(cut.splats, splats));
}

// Sets the weights of a frame whose splats stay the same.
void Streamer::set_weights(FadingCut fading) {
  frame_->fading = std::move(fading);
  for (std::size_t i = 0; i < frame_->items.size(); ++i)
    frame_->splats.batches[i].weight = frame_->fading.weight_of(frame_->items[i]);
}

Status Streamer::show_resident(double change) {
  DetailOptions detail = aim_->choice.detail;
  auto cut = choose_resident(detail);
  if (!cut) return tl::unexpected(cut.error());
  const bool same_values = shows(aim_->visibility);
  FadingCut fading{aim_->view, std::move(*cut), {}, {}};
  if (same_values) {
    const FadeOptions options{change, fading_splats(fading.cut)};
    fading = fade(info().cube, aim_->view, frame_->fading, std::move(fading.cut), *pager_, options);
  }
  if (same_values && frame_->fading.cut == fading.cut)
    set_weights(std::move(fading));
  else
    SPLATVOL_TRY(make_resident_frame(std::move(fading), detail));
  frame_->splats.detail = aim_->choice.detail;
  frame_->splats.progress = extract_progress();
  return {};
}

// Makes the frame, or a simpler one if memory is short: first without fades, then after letting go of substitutes, last
// the coarsest.
Status Streamer::make_resident_frame(FadingCut fading, DetailOptions detail) {
  frame_.reset();
  if (!coarsest_frame_) coarsest_frame_ = cache_.reserve(coarsest_frame_bytes());
  const auto reserve = [&] { return cache_.reserve(frame_bytes(fading.cut, info(), kernel_)); };
  auto reservation = reserve();
  if (!reservation && !fading.fades.empty()) {
    SPLATVOL_TRY_ASSIGN(at_once, choose_resident(detail));
    fading = {aim_->view, std::move(at_once), {}, {}};
    reservation = reserve();
  }
  if (!reservation) {
    // If even this does not suffice, parts that are no longer wanted are still being read.
    pager_->hold_wanted();
    static_cast<void>(reserve());
    SPLATVOL_TRY_ASSIGN(of_wanted, choose_resident(detail));
    fading = {aim_->view, std::move(of_wanted), {}, {}};
    reservation = reserve();
  }
  if (!reservation) {
    SPLATVOL_TRY_ASSIGN(coarsest, choose_coarsest());
    fading = {aim_->view, std::move(coarsest), {}, {}};
    reservation = std::exchange(coarsest_frame_, std::nullopt);
  }
  if (!reservation) return fail(ErrorCode::out_of_budget, "{}: no memory for a frame", volume_->name());
  return assemble(std::move(fading), aim_->visibility, std::move(*reservation));
}

// Tells how far the frame is from the aim, and moves the errors out of the pager.
FrameProgress Streamer::extract_progress() {
  const Pager::Missing& missing = pager_->missing();
  const Cut& aimed = aim_->choice.cut;
  FrameProgress progress;
  progress.complete = aimed.complete && missing.chunks + missing.pages == 0 && frame_->fading.fades.empty() &&
                      frame_->fading.cut == aimed;
  progress.fading = frame_->fading.fades.size();
  progress.settled =
      missing.settled() && progress.fading == 0 && (progress.complete || missing.failed > 0 || !pager_->is_reading());
  progress.missing_chunks = missing.chunks;
  progress.missing_pages = missing.pages;
  progress.missing_bytes = missing.bytes;
  progress.needed_bytes = pager_->needed_bytes();
  progress.errors = pager_->extract_errors();
  return progress;
}

std::vector<DrawnNode> Streamer::drawn_nodes() const {
  std::vector<DrawnNode> nodes;
  if (!frame_) return nodes;
  for (const std::uint32_t i : frame_->items) {
    const CutItem& item = frame_->fading.cut.items[i];
    nodes.push_back({item.cube, item.resolution});
  }
  return nodes;
}

StreamerStatistics Streamer::statistics() const {
  return {volume_->bytes_read(), budget_.used(), budget_.peak(), cut_seconds_, fetch_seconds_};
}

}  // namespace splatvol
