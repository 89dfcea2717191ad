// Frames while the file is read.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/clock.h"
#include "streamer/splats/streamer_frame.h"

namespace splatvol {
namespace {

constexpr int stages = 3;  // coarser pictures on the way to the target cut

}  // namespace

Status Streamer::start_paging() {
  if (pager_) return {};
  drop_frame();
  auto pager = std::make_unique<Pager>(paged_, *reader_, free_bytes() / 8, threads_, on_data_);
  SPLATVOL_TRY(pager->pin_coarsest());
  coarsest_frame_ = share().reserve(coarsest_frame_bytes());
  if (!coarsest_frame_) return fail(ErrorCode::out_of_budget, "{}: no memory for the coarsest splats", volume_->name());
  pager_ = std::move(pager);
  return {};
}

Result<const FrameSplats*> Streamer::advance(const View& view, const Transfer& transfer, const Detail& detail,
                                             double wait_seconds) {
  SPLATVOL_TRY(check_detail(detail));
  clip_ = view.clip;
  slices_ = view.slices;
  const auto start = Clock::now();
  const auto deadline =
      start + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(std::min(wait_seconds, 1e6)));
  SPLATVOL_TRY(start_paging());
  if (frame_) frame_->splats.progress.errors.clear();
  const ValueVisibility visibility = visibility_of(transfer, view);
  const bool steady = target_ && target_->view == view && target_->visibility == visibility && target_->asked == detail;
  if (!steady) {
    view_before_ = target_ ? std::optional(target_->view) : std::nullopt;
    target_.reset();
  }

  for (Pager::Arrivals arrived = pager_->accept_arrivals();;) {
    if (!target_ || arrived.pages) SPLATVOL_TRY(choose_target(view, visibility, detail));
    const bool rests = steady && !arrived && frame_;
    if (!steady || arrived || !pager_->is_reading()) pager_->ask(rests);
    if (pager_->missing().settled() || Clock::now() >= deadline) break;
    pager_->wait_until(deadline);
    arrived = pager_->accept_arrivals();
    if (!arrived) break;
  }
  if (view_before_ && pager_->missing().settled()) {
    prefetch(*view_before_, view, visibility);
    view_before_.reset();
  }
  cut_seconds_ = seconds_since(start);
  SPLATVOL_TRY(show_resident());
  fetch_seconds_ = seconds_since(start) - cut_seconds_;
  return &frame_->splats;
}

// Chooses the target cut from the index pages that are there. When more pages have arrived for the same view, chooses
// again, but never finer than before: otherwise two choices might alternate.
Status Streamer::choose_target(const View& view, const ValueVisibility& visibility, const Detail& detail) {
  Pager::Pages pages;
  const auto try_cut = [&](const Detail& tried) -> Result<Cut> {
    if (target_ && is_finer(tried, target_->choice.detail))
      return fail(ErrorCode::out_of_budget, "the view needed more than {} bytes", cut_limit());
    pager_->begin_selection();
    SPLATVOL_TRY_ASSIGN(cut, select(*pager_, nullptr, view, visibility, cut_options(tried, cut_limit())));
    SPLATVOL_TRY(check_fits(cut, pager_->pages().index_bytes, tried));
    pages = pager_->pages();
    return cut;
  };
  auto choice = choose_finest(first_detail(detail), try_cut);
  if (!choice) {
    target_.reset();
    frame_.reset();
    if (choice.error().code == ErrorCode::out_of_budget) return fail_for_memory(view, visibility, detail);
    return tl::unexpected(choice.error());
  }
  pager_->forget(visibility);
  pager_->keep_pages(std::move(pages));
  pager_->want(choice->cut, 0);
  target_ = std::make_unique<TargetCut>(TargetCut{view, visibility, detail, std::move(*choice)});
  if (!holds_target()) want_stages(view, visibility);
  return {};
}

// Wants coarser pictures on the way to the target cut. They cost little: each has about a twentieth of the splats of
// the next.
void Streamer::want_stages(const View& view, const ValueVisibility& visibility) {
  const Detail& target = target_->choice.detail;
  std::uint64_t bytes_left = std::min(free_bytes() / 16, reader_->row_bytes(target_->choice.cut) / 5);
  for (int stage = stages; stage > 0; --stage) {
    Detail detail = target;
    if (target.resolution) {
      if (*target.resolution < static_cast<std::size_t>(2 * stage)) continue;
      *detail.resolution -= static_cast<std::size_t>(2 * stage);
    } else if (target.goal) {
      const double share = std::pow(20, -stage);
      detail.goal = ErrorGoal{0, static_cast<std::uint64_t>(share * static_cast<double>(target_->choice.cut.splats))};
    } else {
      detail.tolerance_percent = std::max(target.tolerance_percent, smallest_raised_tolerance) * std::pow(3, stage);
    }
    const auto cut = select(*pager_, nullptr, view, visibility, cut_options(detail, bytes_left));
    if (!cut) continue;
    const std::uint64_t bytes = reader_->row_bytes(*cut);
    if (bytes > bytes_left) continue;
    bytes_left -= bytes;
    pager_->want(*cut, stage);
  }
}

// Wants the cut of the next view, as far as memory is free. Assumes that the camera goes on as before.
void Streamer::prefetch(const View& last, const View& view, const ValueVisibility& visibility) {
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
  CutOptions options = cut_options(target_->choice.detail, cut_limit());
  options.kept_occlusion = nullptr;
  const auto cut = select(*pager_, nullptr, next, visibility, options);
  pager_->keep_pages_and_ask_ahead(std::move(pages));
  if (!cut) return;
  pager_->want(*cut, Pager::ahead);
  pager_->ask(false);
}

// Whether the target cut can be drawn as it is.
bool Streamer::holds_target() {
  const Cut& target = target_->choice.cut;
  return target.complete &&
         std::ranges::all_of(target.items, [&](const CutItem& item) { return pager_->holds(target.ranges_of(item)); });
}

// Chooses the best resident cut, or else the coarsest. It has little more splats than the target cut, unless the
// coarsest has. Makes `detail` coarser if it must.
Result<Cut> Streamer::choose_resident(Detail& detail) {
  const Cut& target = target_->choice.cut;
  if (holds_target()) return target;
  const std::uint64_t limit =
      std::max(target.memory_bytes() + target.splats * record_bytes(kernel_) + free_bytes() / 16, coarsest_cut_bytes());
  do {
    auto cut = select(*pager_, pager_.get(), target_->view, target_->visibility, cut_options(detail, limit));
    if (!cut && cut.error().code != ErrorCode::out_of_budget) return cut;
    if (cut && cut->splats <= detail.device_splats) return cut;
  } while (make_coarser(detail));
  return choose_coarsest();
}

Result<Cut> Streamer::choose_coarsest() {
  struct CoarsestOnly final : Residency {
    bool holds(std::span<const PointRange> ranges) override { return ranges.size() == 1; }
  } coarsest;
  Detail detail{.tolerance_percent = std::numeric_limits<double>::infinity()};
  return select_resident_cut(info(), *pager_, coarsest, target_->view, target_->visibility,
                             cut_options(detail, coarsest_cut_bytes()));
}

Status Streamer::show_resident() {
  Detail detail = target_->choice.detail;
  auto cut = choose_resident(detail);
  if (!cut) return tl::unexpected(cut.error());
  const bool same = shows(target_->visibility) && frame_->cut == *cut;
  if (!same) SPLATVOL_TRY(make_resident_frame(std::move(*cut), detail));
  frame_->splats.detail = target_->choice.detail;
  frame_->splats.progress = extract_progress();
  if (frame_->splats.progress.complete) {
    // The substitute that was drawn is the target cut, about which more is known.
    frame_->splats.goal_error = std::sqrt(target_->choice.cut.squared_goal_error);
    frame_->splats.finest = target_->choice.cut.finest;
  }
  return {};
}

// Makes the frame, or a simpler one if memory is short: first after letting go of substitutes, last the coarsest.
Status Streamer::make_resident_frame(Cut cut, Detail detail) {
  drop_frame();
  if (!coarsest_frame_) coarsest_frame_ = share().reserve(coarsest_frame_bytes());
  const auto reserve = [&] { return share().reserve(frame_bytes(cut)); };
  auto reservation = reserve();
  if (!reservation) {
    // If even this does not suffice, parts that are no longer wanted are still being read.
    pager_->hold_wanted();
    static_cast<void>(reserve());
    SPLATVOL_TRY_SET(cut, choose_resident(detail));
    reservation = reserve();
  }
  if (!reservation) return make_coarsest_frame();
  Status assembled = assemble(std::move(cut), target_->visibility, std::move(*reservation));
  if (!assembled && assembled.error().code == ErrorCode::out_of_budget) return make_coarsest_frame();
  return assembled;
}

Status Streamer::make_coarsest_frame() {
  SPLATVOL_TRY_ASSIGN(coarsest, choose_coarsest());
  auto reservation = std::exchange(coarsest_frame_, std::nullopt);
  if (!reservation) return fail(ErrorCode::out_of_budget, "{}: no memory for a frame", volume_->name());
  return assemble(std::move(coarsest), target_->visibility, std::move(*reservation));
}

// Tells how far the frame is from the target cut, and moves the errors out of the pager.
FrameProgress Streamer::extract_progress() {
  const Pager::Missing& missing = pager_->missing();
  const Cut& target = target_->choice.cut;
  FrameProgress progress;
  progress.complete = target.complete && missing.rows + missing.pages == 0 && frame_->cut == target;
  progress.settled = missing.settled() && (progress.complete || missing.failed > 0 || !pager_->is_reading());
  progress.missing_rows = missing.rows;
  progress.missing_pages = missing.pages;
  progress.missing_bytes = missing.bytes;
  progress.needed_bytes = pager_->needed_bytes();
  progress.errors = pager_->extract_errors();
  return progress;
}

}  // namespace splatvol
