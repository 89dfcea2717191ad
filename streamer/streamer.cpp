#include "streamer/streamer.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>

namespace splatvol {
namespace {

// Where a tolerance does not fit, it is doubled from here until one does, then refined by halving the interval.
constexpr double smallest_raised_tolerance = 1.0 / 16;
constexpr double largest_raised_tolerance = 1 << 20;
constexpr int refinements = 4;

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

double next_tolerance(double refused) {
  if (refused >= largest_raised_tolerance) return std::numeric_limits<double>::infinity();
  return std::max(2 * refused, smallest_raised_tolerance);
}

// A bound on what a cut takes as a frame: itself, its plan, and the splats.
std::uint64_t frame_bytes(const Cut& cut, const format::VolumeInfo& info, KernelKind kernel) {
  std::uint64_t jobs = 0;
  for (const PointRange& range : cut.ranges)
    if (range.count > 0) jobs += range.count / info.points_per_chunk + 2;
  return cut.memory_bytes() + cut.splats * splat_bytes(kernel) +
         cut.items.size() * (sizeof(SplatBatch) + sizeof(std::uint64_t)) + jobs * sizeof(CopyJob);
}

std::uint64_t directory_page_bytes(const format::Volume& volume) {
  const std::uint64_t rows = std::min<std::uint64_t>(volume.rows().row_count(), volume.info().rows_per_directory_page);
  return rows * volume.info().columns.size() * (sizeof(format::ChunkEntry) + sizeof(format::ChunkPlace));
}

Status check_detail(const DetailOptions& detail) {
  if (detail.tolerance_percent >= 0) return {};
  return fail(ErrorCode::invalid_argument, "a tolerance of {} % is out of range", detail.tolerance_percent);
}

}  // namespace

struct Streamer::Frame {
  Cut cut;
  ValueVisibility visibility;
  Reservation reservation;
  SplatArray array;
  FrameSplats splats;
};

Streamer::Streamer(std::shared_ptr<const format::Volume> volume, int attribute, const StreamerOptions& options)
    : volume_(std::move(volume)),
      kernel_(options.kernel),
      budget_(options.memory_bytes),
      cache_(budget_),
      paged_(*volume_, attribute, cache_) {}

Streamer::~Streamer() = default;

Result<std::unique_ptr<Streamer>> Streamer::open(std::unique_ptr<ByteSource> source, const StreamerOptions& options) {
  SPLATVOL_TRY_ASSIGN(volume, format::Volume::open(std::move(source)));
  const format::VolumeInfo& info = volume->info();
  const int attribute = info.find_attribute(options.attribute);
  if (attribute < 0) {
    std::vector<std::string> names;
    for (const format::Attribute& a : info.attributes) names.push_back(a.name);
    return fail(ErrorCode::invalid_argument, "{}: no attribute '{}'; there are: {}", volume->name(), options.attribute,
                fmt::join(names, ", "));
  }

  std::unique_ptr<Streamer> streamer(new Streamer(std::move(volume), attribute, options));
  SPLATVOL_TRY_ASSIGN(gatherer,
                      Gatherer::create(streamer->paged_, streamer->cache_, options.kernel, options.gradients));
  streamer->gatherer_ = std::move(gatherer);
  SPLATVOL_TRY(streamer->set_memory_aside());
  return streamer;
}

// The budget's fixed parts: the preamble, which stays, and room to work in: for the pages on the way to a node, and the
// chunks of a row.
Status Streamer::set_memory_aside() {
  SPLATVOL_TRY_ASSIGN(root, volume_->read_index_root(paged_.attribute()));
  working_bytes_ = gatherer_->working_bytes() + directory_page_bytes(*volume_) + 4 * root.memory_bytes();
  auto preamble = budget_.reserve(volume_->memory_bytes());
  if (!preamble || frame_limit() == 0)
    return fail(ErrorCode::out_of_budget, "{}: {} bytes of memory are too few: even opening it needs {}",
                volume_->name(), budget_.capacity(), volume_->memory_bytes() + working_bytes_ + 1);
  preamble_ = std::move(*preamble);
  return {};
}

std::uint64_t Streamer::frame_limit() const {
  const std::uint64_t fixed = volume_->memory_bytes() + working_bytes_;
  return budget_.capacity() > fixed ? budget_.capacity() - fixed : 0;
}

Result<const FrameSplats*> Streamer::request(const View& view, const TransferFunction& function,
                                             const DetailOptions& detail) {
  SPLATVOL_TRY(check_detail(detail));
  const auto cut_start = std::chrono::steady_clock::now();
  const ValueVisibility visibility(function, info().attributes[static_cast<std::size_t>(paged_.attribute())]);
  auto choice = choose(view, visibility, detail);
  cut_seconds_ = seconds_since(cut_start);
  fetch_seconds_ = 0;
  if (!choice) {
    frame_.reset();
    return tl::unexpected(choice.error());
  }

  const bool same = frame_ && frame_->cut == choice->cut && frame_->visibility == visibility;
  if (!same) {
    const auto fetch_start = std::chrono::steady_clock::now();
    SPLATVOL_TRY(fetch(std::move(choice->cut), visibility));
    fetch_seconds_ = seconds_since(fetch_start);
  }
  frame_->splats.detail = choice->detail;
  return &frame_->splats;
}

Result<Cut> Streamer::try_cut(const View& view, const ValueVisibility& visibility, const DetailOptions& detail) {
  CutOptions options;
  options.tolerance_percent = detail.tolerance_percent;
  options.kernel = kernel_;
  options.resolution = detail.resolution;
  options.max_bytes = frame_limit();
  SPLATVOL_TRY_ASSIGN(cut, select_cut(info(), paged_, view, visibility, options));
  if (cut.splats > detail.max_splats)
    return fail(ErrorCode::out_of_budget, "the view needs more than {} splats", detail.max_splats);
  if (frame_bytes(cut, info(), kernel_) > frame_limit())
    return fail(ErrorCode::out_of_budget, "the view needs more than {} bytes", frame_limit());
  return cut;
}

Result<Streamer::Choice> Streamer::choose(const View& view, const ValueVisibility& visibility, DetailOptions detail) {
  if (detail.resolution) detail.resolution = std::min(*detail.resolution, info().resolutions() - 1);
  auto cut = try_cut(view, visibility, detail);
  if (cut) return Choice{std::move(*cut), detail};
  if (cut.error().code != ErrorCode::out_of_budget) return tl::unexpected(cut.error());
  return detail.resolution ? choose_lower_resolution(view, visibility, detail)
                           : choose_higher_tolerance(view, visibility, detail);
}

Result<Streamer::Choice> Streamer::choose_lower_resolution(const View& view, const ValueVisibility& visibility,
                                                           DetailOptions detail) {
  while (*detail.resolution > 0) {
    --*detail.resolution;
    auto cut = try_cut(view, visibility, detail);
    if (cut) return Choice{std::move(*cut), detail};
    if (cut.error().code != ErrorCode::out_of_budget) return tl::unexpected(cut.error());
  }
  return fail_for_memory(view, visibility, detail);
}

Result<Streamer::Choice> Streamer::choose_higher_tolerance(const View& view, const ValueVisibility& visibility,
                                                           DetailOptions detail) {
  // Up, until it fits.
  double refused = detail.tolerance_percent;
  std::optional<Choice> best;
  while (!best) {
    if (std::isinf(refused)) return fail_for_memory(view, visibility, detail);
    detail.tolerance_percent = next_tolerance(refused);
    auto cut = try_cut(view, visibility, detail);
    if (!cut && cut.error().code != ErrorCode::out_of_budget) return tl::unexpected(cut.error());
    if (cut)
      best = Choice{std::move(*cut), detail};
    else
      refused = detail.tolerance_percent;
  }

  // Down again, as far as it still does.
  for (int i = 0; i < refinements && refused > 0 && std::isfinite(best->detail.tolerance_percent); ++i) {
    detail.tolerance_percent = std::sqrt(refused * best->detail.tolerance_percent);
    auto cut = try_cut(view, visibility, detail);
    if (cut)
      best = Choice{std::move(*cut), detail};
    else
      refused = detail.tolerance_percent;
  }
  return std::move(*best);
}

tl::unexpected<Error> Streamer::fail_for_memory(const View& view, const ValueVisibility& visibility,
                                                const DetailOptions& detail) {
  CutOptions options;
  options.tolerance_percent = detail.tolerance_percent;
  options.kernel = kernel_;
  options.resolution = detail.resolution;
  const auto coarsest = select_cut(info(), paged_, view, visibility, options);
  if (!coarsest) return tl::unexpected(coarsest.error());
  if (coarsest->splats > detail.max_splats)
    return fail(ErrorCode::out_of_budget, "{}: even the coarsest picture needs {} splats, more than {}",
                volume_->name(), coarsest->splats, detail.max_splats);
  return fail(ErrorCode::out_of_budget, "{}: {} bytes of memory are too few: even the coarsest picture needs {}",
              volume_->name(), budget_.capacity(),
              volume_->memory_bytes() + working_bytes_ + frame_bytes(*coarsest, info(), kernel_));
}

Status Streamer::fetch(Cut cut, const ValueVisibility& visibility) {
  frame_.reset();
  auto reservation = cache_.reserve(frame_bytes(cut, info(), kernel_));
  if (!reservation) return fail(ErrorCode::out_of_budget, "{}: no memory for {} splats", volume_->name(), cut.splats);
  SPLATVOL_TRY_ASSIGN(plan, gatherer_->plan(cut, visibility));
  SPLATVOL_TRY_ASSIGN(array, gatherer_->gather(cut, plan));

  FrameSplats splats;
  splats.data = array.splats();
  splats.serial = next_serial_++;
  splats.splats = plan.splats;
  splats.nodes_by_resolution.resize(info().resolutions());
  splats.splats_by_resolution.resize(info().resolutions());
  std::uint64_t begin = 0;
  for (std::size_t i = 0; i < cut.items.size(); ++i) {
    const CutItem& item = cut.items[i];
    const std::uint64_t count = plan.item_ends[i] - begin;
    if (count > 0) {
      ++splats.nodes;
      ++splats.nodes_by_resolution[item.resolution];
      splats.splats_by_resolution[item.resolution] += count;
      splats.batches.push_back({item.cell.origin + 0.5 * item.cell.edge, begin, count});
    }
    begin += count;
  }
  frame_ = std::make_unique<Frame>(
      Frame{std::move(cut), visibility, std::move(*reservation), std::move(array), std::move(splats)});
  return {};
}

StreamerStatistics Streamer::statistics() const {
  return {volume_->bytes_read(), budget_.used(), budget_.peak(), cut_seconds_, fetch_seconds_};
}

}  // namespace splatvol
