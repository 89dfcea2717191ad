#include "builder/output/row_collector.h"

#include <algorithm>
#include <span>
#include <utility>

namespace splatvol {
namespace {

// Rows with fewer splats are not worth a write.
constexpr std::size_t least_written_splats = 32;

bool has_gradients(const format::VolumeInfo& info) {
  return std::ranges::find(info.columns, format::ColumnKind::gradient, &format::Column::kind) != info.columns.end();
}

}  // namespace

RowCollector::RowCollector(const format::VolumeInfo& info, GroupSizes points_per_chunk, std::size_t memory,
                           std::string folder, SharedRows shared)
    : attributes_(info.attributes.size()),
      points_per_chunk_(std::move(points_per_chunk)),
      memory_(memory),
      folder_(std::move(folder)),
      shared_(std::move(shared)),
      splat_bytes_(SplatColumns::bytes_of_splat(attributes_, has_gradients(info))) {}

std::vector<RowCollector::Queue>& RowCollector::queues(std::size_t segment) {
  while (queues_.size() <= segment) {
    const std::size_t added = queues_.size();
    queues_.emplace_back(added + 1);
    const std::uint64_t before = added < shared_.before.size() ? shared_.before[added] : 0;
    const std::size_t absent = before % points_per_chunk_.of(added);
    for (std::size_t level = 0; level <= added && absent > 0; ++level)
      queues_[added][level].push_back({.segment = added,
                                       .level = level,
                                       .splats = std::make_unique<SplatColumns>(attributes_),
                                       .packed = {},
                                       .absent = absent});
  }
  return queues_[segment];
}

bool RowCollector::is_complete(const PendingRow& row) const {
  return !row.splats || size_of(row) == points_per_chunk_.of(row.segment);
}

// The row that the next splat belongs to.
PendingRow& RowCollector::open_row(std::size_t segment, std::size_t level) {
  Queue& queue = queues(segment)[level];
  if (queue.empty() || is_complete(queue.back())) {
    if (spare_.empty()) spare_.push_back(std::make_unique<SplatColumns>(attributes_));
    queue.push_back({segment, level, std::move(spare_.back()), {}});
    spare_.pop_back();
  }
  return queue.back();
}

void RowCollector::add_finest(const SplatColumns& splats) {
  for (std::size_t begin = 0; begin < splats.size();) {
    PendingRow& row = open_row(0, 0);
    const std::size_t end = std::min(splats.size(), begin + points_per_chunk_.of(0) - size_of(row));
    row.splats->append(splats, begin, end);
    begin = end;
  }
}

void RowCollector::add_packed_finest(PackedRow row) { queues(0)[0].push_back({0, 0, nullptr, std::move(row)}); }

void RowCollector::add_point(std::size_t segment, const Member& member) {
  SplatColumns* own = nullptr;
  for (std::size_t level = 0; level <= segment; ++level) {
    own = open_row(segment, level).splats.get();
    own->add_splat(member.splats[level], std::span(member.stored_values).subspan(level * attributes_, attributes_));
  }
  own->add_point(member.point);
  for (std::size_t a = 0; a < attributes_; ++a) own->add_point_value(a, member.values[a].value);
  for (std::size_t a = 0; a < member.gradients.size(); ++a) own->add_gradient(a, member.gradients[a]);
}

void RowCollector::recycle(std::vector<PendingRow>& rows) {
  for (PendingRow& row : rows) {
    if (!row.splats || (spare_.size() + 1) * row_bytes() > spare_memory()) continue;
    row.splats->clear();
    spare_.push_back(std::move(row.splats));
  }
  rows.clear();
}

Status RowCollector::extract(std::vector<PendingRow>& rows, bool at_end) {
  recycle(rows);
  for (std::vector<Queue>& of_segment : queues_)
    for (Queue& queue : of_segment)
      while (!queue.empty() && (at_end || is_complete(queue.front()))) {
        PendingRow& row = queue.front();
        const bool shared = is_shared(row);
        if (!at_end || shared) SPLATVOL_TRY(read_back(row));
        (!shared ? rows : row.absent > 0 ? ends_.first : ends_.last).push_back(std::move(row));
        queue.pop_front();
      }
  return at_end ? Status{} : write_out_open_rows();
}

// Writes out the rows that are not complete, if together they take too much memory.
Status RowCollector::write_out_open_rows() {
  std::vector<PendingRow*> open;
  std::size_t splats = 0;
  for (std::vector<Queue>& of_segment : queues_)
    for (Queue& queue : of_segment) {
      if (queue.empty() || is_complete(queue.back())) continue;
      splats += queue.back().splats->size();
      if (queue.back().splats->size() >= least_written_splats) open.push_back(&queue.back());
    }
  if (splats <= memory_ / 2 / splat_bytes_) return {};
  for (PendingRow* row : open) SPLATVOL_TRY(write_out(*row));
  spare_.clear();
  return {};
}

Status RowCollector::write_out(PendingRow& row) {
  if (!spool_) {
    SPLATVOL_TRY_ASSIGN(file, TempFile::create(folder_));
    spool_ = std::make_unique<TempFile>(std::move(file));
  }
  const std::uint64_t offset = spool_->size();
  SPLATVOL_TRY_ASSIGN(bytes, row.splats->write_to(*spool_));
  row.spool = spool_.get();
  row.written.push_back({offset, bytes});
  row.written_splats += row.splats->size();
  row.splats = std::make_unique<SplatColumns>(attributes_);
  return {};
}

Status RowCollector::read_back(PendingRow& row) {
  const std::vector<FilePart> parts = row.written;
  if (row.splats) SPLATVOL_TRY(read_written(row));
  for (const FilePart& part : parts) spool_->release(part.offset, part.bytes);
  return {};
}

Result<std::vector<PendingRow>> RowCollector::extract_rest() {
  spare_.clear();
  std::vector<PendingRow> rows;
  SPLATVOL_TRY(extract(rows, true));
  return rows;
}

}  // namespace splatvol
