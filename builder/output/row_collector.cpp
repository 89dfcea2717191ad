#include "builder/output/row_collector.h"

#include <algorithm>
#include <iterator>
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
      gradients_(has_gradients(info)),
      splat_bytes_(SplatColumns::bytes_of_splat(attributes_, gradients_)) {}

// The rows that the next point of a segment belongs to: [level].
std::vector<PendingRow>& RowCollector::open_rows(std::size_t segment) {
  if (open_.size() <= segment) open_.resize(segment + 1);
  std::vector<PendingRow>& rows = open_[segment];
  if (!rows.empty()) return rows;
  const std::uint64_t before = segment < shared_.before.size() ? std::exchange(shared_.before[segment], 0) : 0;
  for (std::size_t level = 0; level <= segment; ++level) {
    if (spare_.empty()) spare_.push_back(std::make_unique<SplatColumns>(attributes_));
    rows.push_back({.segment = segment,
                    .level = level,
                    .splats = std::move(spare_.back()),
                    .packed = {},
                    .absent = before % points_per_chunk_.of(segment)});
    spare_.pop_back();
  }
  return rows;
}

// Closes the rows of a segment if they are complete: they have equally many splats.
void RowCollector::close_rows(std::size_t segment) {
  const PendingRow& row = open_[segment].front();
  if (row.absent + row.written_splats + row.splats->size() < points_per_chunk_.of(segment)) return;
  std::ranges::move(open_[segment], std::back_inserter(complete_));
  open_[segment].clear();
}

void RowCollector::add_finest(SplatColumns& splats) {
  if (splats.size() == 0) return;
  SplatColumns& row = *open_rows(0).front().splats;
  if (row.size() == 0)
    std::swap(row, splats);
  else
    row.append(splats);
  close_rows(0);
}

void RowCollector::add_packed_finest(PackedRow row) { complete_.push_back({0, 0, nullptr, std::move(row)}); }

void RowCollector::add_point(std::size_t segment, const Member& member) {
  std::vector<PendingRow>& rows = open_rows(segment);
  for (std::size_t level = 0; level <= segment; ++level)
    rows[level].splats->add_splat(member.splat(level), member.stored_values(level));
  SplatColumns& own = *rows.back().splats;
  own.add_point(member.point);
  for (std::size_t a = 0; a < attributes_; ++a) {
    own.add_point_value(a, member.values()[a].value);
    if (gradients_) own.add_gradient(a, member.values()[a].gradient);
  }
  close_rows(segment);
}

void RowCollector::recycle(std::vector<PendingRow>& rows) {
  for (PendingRow& row : rows) {
    if (!row.splats || (spare_.size() + 1) * row_bytes() > spare_memory()) continue;
    row.splats->clear();
    spare_.push_back(std::move(row.splats));
  }
  rows.clear();
}

Status RowCollector::extract_complete(std::vector<PendingRow>& rows) {
  recycle(rows);
  for (PendingRow& row : complete_) {
    SPLATVOL_TRY(read_back(row));
    (row.absent > 0 ? ends_.first : rows).push_back(std::move(row));
  }
  complete_.clear();
  return write_out_open_rows();
}

// Writes out the rows that are not complete, if together they take too much memory.
Status RowCollector::write_out_open_rows() {
  std::size_t splats = 0;
  for (const std::vector<PendingRow>& rows : open_)
    for (const PendingRow& row : rows) splats += row.splats->size();
  if (splats <= memory_ / 2 / splat_bytes_) return {};
  for (std::vector<PendingRow>& rows : open_)
    for (PendingRow& row : rows)
      if (row.splats->size() >= least_written_splats) SPLATVOL_TRY(write_out(row));
  spare_.clear();
  return {};
}

Status RowCollector::write_out(PendingRow& row) {
  if (!spool_) {
    SPLATVOL_TRY_ASSIGN(file, TempFile::create(folder_));
    spool_ = std::make_unique<TempFile>(std::move(file));
  }
  format::Bytes bytes;
  row.splats->put_into(bytes);
  row.spool = spool_.get();
  row.written.push_back({spool_->size(), bytes.size(), format::hash_bytes(bytes)});
  SPLATVOL_TRY(spool_->append(bytes));
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
  std::vector<PendingRow> rest;
  SPLATVOL_TRY(extract_complete(rest));
  spare_.clear();
  for (std::vector<PendingRow>& rows : open_)
    for (PendingRow& row : rows) {
      const bool shared = row.absent > 0 || shared_.ends_inside;
      if (shared) SPLATVOL_TRY(read_back(row));
      (!shared ? rest : row.absent > 0 ? ends_.first : ends_.last).push_back(std::move(row));
    }
  open_.clear();
  return rest;
}

}  // namespace splatvol
