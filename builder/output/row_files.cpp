#include "builder/output/row_files.h"

#include <sys/resource.h>
#include <tbb/parallel_for.h>
#include <tbb/task_group.h>

#include <algorithm>
#include <cstring>
#include <utility>

namespace splatvol {
namespace {

constexpr std::uint64_t read_together = 1u << 20;  // bytes; calls for each row take longer than to copy the row

// Returns how many files may be open: those that the process may have, less those that the rest of a build needs. With
// 15 resolutions, 120 streams have their own file. The streams of coarser resolutions hold little, and share the last.
std::size_t most_files() {
  constexpr rlim_t most = 128, others = 24;
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0) return most;
  return std::clamp<rlim_t>(limit.rlim_cur, others + 1, others + most) - others;
}

}  // namespace

Result<RowFiles::Stream*> RowFiles::open_stream(const PendingRow& row) {
  while (streams_.size() <= row.segment) streams_.emplace_back(streams_.size() + 1);
  Stream& stream = streams_[row.segment][row.level];
  if (!stream.file) {
    if (files_.size() < most_files()) {
      SPLATVOL_TRY_ASSIGN(file, TempFile::create(folder_));
      files_.push_back(std::move(file));
    }
    stream.file = &files_.back();
    stream.entry_bytes = row.packed.size() * sizeof(format::ChunkEntry);
  }
  return &stream;
}

Status RowFiles::write(const PendingRow& row) {
  SPLATVOL_TRY_ASSIGN(stream, open_stream(row));
  const bool finest = row.segment == 0 && finest_;
  const std::uint64_t begin = stream->file->size();
  format::Bytes bytes;
  for (const format::PackedChunk& chunk : row.packed) format::append_record(bytes, chunk.entry);
  for (const format::PackedChunk& chunk : row.packed) {
    if (finest) {
      SPLATVOL_TRY(finest_->append(chunk.bytes));
    } else {
      bytes.insert(bytes.end(), chunk.bytes.begin(), chunk.bytes.end());
      coarse_bytes_ += chunk.bytes.size();
    }
  }
  stream->rows.push_back({begin, bytes.size()});
  return stream->file->append(bytes);
}

Status RowFiles::write_first(const PendingRow& row) {
  SPLATVOL_TRY(write(row));
  std::vector<Extent>& rows = streams_[row.segment][row.level].rows;
  std::ranges::rotate(rows, rows.end() - 1);
  return {};
}

std::uint64_t RowFiles::chunk_bytes(std::size_t segment, std::size_t level) const {
  if (segment >= streams_.size()) return 0;
  const Stream& stream = streams_[segment][level];
  std::uint64_t bytes = 0;
  for (const Extent& row : stream.rows) bytes += row.bytes - stream.entry_bytes;
  return bytes;
}

Status RowFiles::read(std::size_t segment, std::size_t level, const Visit& visit) {
  return segment < streams_.size() ? read(streams_[segment][level], visit) : Status{};
}

Status RowFiles::read(std::size_t levels, const Visit& visit) {
  return for_each_stream(levels, [&](std::size_t segment, std::size_t level) { return read(segment, level, visit); });
}

// Reads the rows that come next and lie side by side, and gives their disk space back.
Status RowFiles::read_next(Stream& stream, std::size_t first, RowBlock& block) {
  block = {std::move(block.bytes), first, first};
  if (first == stream.rows.size()) return {};
  const std::uint64_t begin = stream.rows[first].offset;
  std::uint64_t end = begin;
  for (; block.end < stream.rows.size() && end - begin < read_together; ++block.end) {
    const Extent& row = stream.rows[block.end];
    if (row.offset != end) break;
    end += row.bytes;
  }
  block.bytes.resize(end - begin);
  SPLATVOL_TRY(stream.file->read(begin, block.bytes));
  stream.file->release(begin, end - begin);
  return {};
}

// Some rows are read while the ones before them are visited.
Status RowFiles::read(Stream& stream, const Visit& visit) {
  std::vector<format::ChunkEntry> entries(stream.entry_bytes / sizeof(format::ChunkEntry));
  RowBlock block, next;
  Status read = read_next(stream, 0, block), visited;
  while (read && visited && block.first < block.end) {
    tbb::task_group reading;
    reading.run([&] { read = read_next(stream, block.end, next); });
    auto bytes = std::span<const std::byte>(block.bytes);
    for (std::size_t r = block.first; r < block.end && visited; ++r) {
      const auto row = bytes.first(stream.rows[r].bytes);
      std::memcpy(entries.data(), row.data(), stream.entry_bytes);
      visited = visit(entries, row.subspan(stream.entry_bytes));
      bytes = bytes.subspan(row.size());
    }
    reading.wait();
    std::swap(block, next);
  }
  return visited ? read : visited;
}

Status write_rows(std::span<PendingRow> rows, const RowPacker& packer, RowFiles& files) {
  constexpr std::size_t packed_together = 32;  // packed rows are held until they are written
  for (; !rows.empty(); rows = rows.subspan(std::min(packed_together, rows.size()))) {
    const std::span<PendingRow> packed = rows.first(std::min(packed_together, rows.size()));
    std::vector<Status> done(packed.size());
    tbb::parallel_for(std::size_t{0}, packed.size(), [&](std::size_t r) { done[r] = packer.pack(packed[r]); });
    for (const Status& status : done) SPLATVOL_TRY(status);
    for (PendingRow& row : packed) {
      SPLATVOL_TRY(files.write(row));
      row = {};
    }
  }
  return {};
}

}  // namespace splatvol
