#include "builder/output/row_collector.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <span>
#include <utility>

namespace splatvol {

std::vector<RowCollector::Queue>& RowCollector::queues(std::size_t segment) {
  while (queues_.size() <= segment) queues_.emplace_back(queues_.size() + 1);
  return queues_[segment];
}

bool RowCollector::is_complete(const PendingRow& row) const {
  return !row.splats || !row.chunks.empty() || row.splats->size() == points_per_chunk_.of(row.segment);
}

// The row that the next splat belongs to.
SplatColumns& RowCollector::open_row(std::size_t segment, std::size_t level) {
  Queue& queue = queues(segment)[level];
  if (queue.empty() || is_complete(queue.back())) {
    if (spare_.empty()) spare_.push_back(std::make_unique<SplatColumns>(attributes_));
    queue.push_back({segment, level, std::move(spare_.back()), {}});
    spare_.pop_back();
  }
  return *queue.back().splats;
}

void RowCollector::add_finest(const SplatColumns& splats) {
  for (std::size_t begin = 0; begin < splats.size();) {
    SplatColumns& row = open_row(0, 0);
    const std::size_t end = std::min(splats.size(), begin + points_per_chunk_.of(0) - row.size());
    row.append(splats, begin, end);
    begin = end;
  }
}

void RowCollector::add_packed_finest(PackedRow row) { queues(0)[0].push_back({0, 0, nullptr, std::move(row)}); }

void RowCollector::add_point(std::size_t segment, const Member& member) {
  SplatColumns* own = nullptr;
  for (std::size_t level = 0; level <= segment; ++level) {
    own = &open_row(segment, level);
    own->add_splat(member.splats[level], std::span(member.stored_values).subspan(level * attributes_, attributes_));
  }
  own->add_point(member.point);
  for (std::size_t a = 0; a < attributes_; ++a)
    own->add_point_value(a, member.values[a].value, member.values[a].gradient);
}

void RowCollector::recycle(std::vector<PendingRow>& rows) {
  for (PendingRow& row : rows) {
    if (!row.splats) continue;
    row.splats->clear();
    spare_.push_back(std::move(row.splats));
  }
  rows.clear();
}

void RowCollector::extract(std::vector<PendingRow>& rows, bool at_end) {
  recycle(rows);
  for (std::vector<Queue>& of_segment : queues_)
    for (std::size_t level = 0; level < of_segment.size(); ++level) {
      Queue& queue = of_segment[level];
      if (!at_end && fits_ && level == 0) {
        pack_waiting(queue);
        continue;
      }
      while (!queue.empty() && (at_end || is_complete(queue.front()))) {
        rows.push_back(std::move(queue.front()));
        queue.pop_front();
      }
    }
}

// Packs the complete rows of level 0 as far as their densities allow.
void RowCollector::pack_waiting(Queue& queue) const {
  if (!packer_) return;
  std::vector<PendingRow*> rows;
  for (auto row = queue.rbegin(); row != queue.rend() && row->chunks.empty(); ++row)
    if (row->splats && is_complete(*row)) rows.push_back(&*row);
  // Without isolation, this thread could take up other stages of the pipeline that calls.
  tbb::this_task_arena::isolate(
      [&] { tbb::parallel_for(std::size_t{0}, rows.size(), [&](std::size_t r) { packer_->pack_early(*rows[r]); }); });
}

void RowCollector::fit() {
  fit_densities(fitted_);
  for (const std::vector<Queue>& of_segment : queues_)
    for (const PendingRow& row : of_segment[0]) {
      SplatColumns::Splats& splats = row.splats->splats;
      for (std::size_t i = 0; i < splats.shapes.size(); ++i)
        splats.shapes[i].density = fitted_[splats.numbers[i]].shape.density;
    }
  fitted_ = {};
}

std::vector<PendingRow> RowCollector::extract_rest() {
  if (fits_) fit();
  std::vector<PendingRow> rows;
  extract(rows, true);
  return rows;
}

}  // namespace splatvol
