// From a cut to a frame: its rows, its draw list, and the rows that a clip region cuts.
#include "streamer/splats/streamer_frame.h"

#include <cmath>
#include <utility>

#include "base/parallel.h"
#include "streamer/store/row_bytes.h"

namespace splatvol {
// Whether the frame was made for these visible values, and for the present clip region and slices.
bool Streamer::shows(const ValueVisibility& visibility) const {
  return frame_ && frame_->visibility == visibility && frame_->clip == clip_ && frame_->slices == slices_;
}

// Clipped ranges of the same region are kept for the next frame.
void Streamer::drop_frame() {
  if (frame_ && !clip_.is_all() && frame_->clip == clip_) clipped_before_ = std::move(frame_->clipped);
  frame_.reset();
}

Status Streamer::fetch(Cut cut, const ValueVisibility& visibility) {
  drop_frame();
  auto reservation = share().reserve(frame_bytes(cut));
  if (!reservation) return fail(ErrorCode::out_of_budget, "{}: no memory for {} splats", volume_->name(), cut.splats);
  return assemble(std::move(cut), visibility, std::move(*reservation));
}

Status Streamer::assemble(Cut cut, const ValueVisibility& visibility, Reservation reservation) {
  SPLATVOL_TRY_ASSIGN(plan, reader_->plan(cut, visibility));
  SPLATVOL_TRY_ASSIGN(rows, reader_->hold(plan));
  auto frame = std::make_unique<Frame>(
      Frame{std::move(cut), visibility, clip_, slices_, std::move(reservation), {}, {}, {}, {}, {}});
  for (const auto& [number, row] : rows) {
    frame->rows.push_back(row.shapes);
    frame->rows.push_back(row.values);
  }
  add_ranges(*frame, plan, rows);
  auto before = std::exchange(clipped_before_, {});
  if (!slices_.empty()) add_sliced(*frame);
  if (!clip_.is_all()) clip_ranges(*frame, std::move(before));
  const std::uint64_t bytes = frame->memory_bytes();
  if (!frame->reservation.grow(bytes))
    return fail(ErrorCode::out_of_budget, "{}: no memory for a list of {} bytes", volume_->name(), bytes);
  count_splats(*frame);
  frame_ = std::move(frame);
  return {};
}

void Streamer::add_ranges(Frame& frame, std::span<const RowPart> plan, const HeldRows& rows) const {
  DrawList& list = frame.splats.list;
  for (const RowPart& part : plan) {
    append(list, rows.at(part.row.number()).row(), part.begin, part.count);
    frame.range_items.resize(list.ranges.size(), part.item);
  }
}

// Keeps the ranges near a slice, as they are before they are clipped.
void Streamer::add_sliced(Frame& frame) const {
  const DrawList& list = frame.splats.list;
  for (std::size_t i = 0; i < list.ranges.size(); ++i) {
    if (!frame.cut.items[frame.range_items[i]].sliced) continue;
    frame.splats.sliced.ranges.push_back(list.ranges[i]);
    frame.splats.sliced.splats += list.ranges[i].count;
  }
}

// Replaces ranges that the region cuts, and leaves out those outside. `before`: clipped by the same region.
void Streamer::clip_ranges(Frame& frame, std::map<RangeName, ClippedRange> before) const {
  const std::vector<DrawRange> whole = std::exchange(frame.splats.list, {}).ranges;
  const std::vector<std::uint32_t> items = std::exchange(frame.range_items, {});
  std::vector<ClippedRange*> clipped(whole.size());
  std::vector<std::size_t> unknown;
  for (std::size_t i = 0; i < whole.size(); ++i) {
    const auto& [row, block, begin, count] = whole[i];
    const RangeName name{row.shapes->id(), row.values->id(), begin, count};
    auto known = before.extract(name);
    if (known)
      frame.clipped.insert(std::move(known));
    else if (!frame.clipped.contains(name))
      unknown.push_back(i);
    clipped[i] = &frame.clipped[name];
  }
  before.clear();
  parallel_for(std::size_t{0}, unknown.size(), [&](std::size_t k) {
    const DrawRange& range = whole[unknown[k]];
    *clipped[unknown[k]] = clip(range, clip_, units().length);
  });
  DrawList& list = frame.splats.list;
  for (std::size_t i = 0; i < whole.size(); ++i) {
    const DrawRange& range = whole[i];
    if (clipped[i]->part == ClippedRange::Part::all) {
      list.ranges.push_back(range);
      list.splats += range.count;
    } else if (clipped[i]->part == ClippedRange::Part::some) {
      append(list, clipped[i]->row, 0, range.count);
    }
    frame.range_items.resize(list.ranges.size(), items[i]);
  }
}

void Streamer::count_splats(Frame& frame) {
  const Cut& cut = frame.cut;
  FrameSplats& splats = frame.splats;
  splats.serial = next_serial_++;
  splats.expected_error = std::sqrt(cut.squared_error);
  splats.goal_error = std::sqrt(cut.squared_goal_error);
  splats.finest = cut.finest;
  splats.splats = splats.list.splats;
  splats.nodes_by_resolution.resize(info().resolutions());
  splats.splats_by_resolution.resize(info().resolutions());
  for (std::size_t i = 0; i < frame.range_items.size(); ++i) {
    const std::uint32_t item = frame.range_items[i];
    splats.splats_by_resolution[cut.items[item].resolution] += splats.list.ranges[i].count;
    if (!frame.drawn_items.empty() && frame.drawn_items.back() == item) continue;
    frame.drawn_items.push_back(item);
    ++splats.nodes;
    ++splats.nodes_by_resolution[cut.items[item].resolution];
  }
}

std::uint64_t Streamer::Frame::memory_bytes() const {
  std::uint64_t bytes = cut.memory_bytes() + rows.size() * sizeof(PartPointer) +
                        splats.list.ranges.size() * (sizeof(DrawRange) + sizeof(std::uint32_t)) +
                        splats.sliced.ranges.size() * sizeof(DrawRange) + drawn_items.size() * sizeof(std::uint32_t);
  for (const auto& [name, range] : clipped) {
    bytes += sizeof(name) + sizeof(range) + 4 * sizeof(void*);
    if (range.part == ClippedRange::Part::some) bytes += held_bytes(*range.row.shapes) + held_bytes(*range.row.values);
  }
  return bytes;
}

}  // namespace splatvol
