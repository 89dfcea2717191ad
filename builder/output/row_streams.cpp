#include "builder/output/row_streams.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstring>
#include <iterator>
#include <utility>

namespace splatvol {
namespace {

using format::Bytes;
using format::PackedChunk;

constexpr std::uint64_t given_back_together = 4u << 20;  // a call for each row takes longer than its copying

// A row in the temporary file: the entries of its chunks, then their bytes.
Bytes serialize(std::span<const PackedChunk> chunks) {
  std::size_t size = chunks.size() * sizeof(format::ChunkEntry);
  for (const PackedChunk& chunk : chunks) size += chunk.bytes.size();
  Bytes bytes;
  bytes.reserve(size);
  for (const PackedChunk& chunk : chunks) format::append_record(bytes, chunk.entry);
  for (const PackedChunk& chunk : chunks) bytes.insert(bytes.end(), chunk.bytes.begin(), chunk.bytes.end());
  return bytes;
}

}  // namespace

RowStreams::RowStreams(const format::VolumeInfo& info, bool fits, std::string folder, AtomicFile& finest)
    : attributes_(info.attributes),
      all_columns_(info.columns),
      points_per_chunk_(info.points_per_chunk),
      fits_(fits),
      folder_(std::move(folder)),
      finest_(finest) {
  std::ranges::copy_if(all_columns_, std::back_inserter(resolution_columns_),
                       [](const format::Column& column) { return column.scope == format::ColumnScope::resolution; });
}

std::vector<RowStreams::Stream>& RowStreams::streams(std::size_t segment) {
  while (streams_.size() <= segment) {
    std::vector<Stream>& at = streams_.emplace_back(streams_.size() + 1);
    for (Stream& stream : at) stream.columns = &stream == &at.back() ? &all_columns_ : &resolution_columns_;
    at.front().finest = streams_.size() == 1;
  }
  return streams_[segment];
}

bool RowStreams::is_complete(const Chunk& chunk) const {
  return !chunk.rows_ || chunk.rows_->size() == points_per_chunk_;
}

// Where the stream's next row goes.
SplatRows& RowStreams::open_chunk(Stream& stream) {
  if (stream.chunks.empty() || is_complete(stream.chunks.back())) {
    if (spare_.empty()) spare_.push_back(std::make_unique<SplatRows>(attributes_.size()));
    Chunk& chunk = stream.chunks.emplace_back();
    chunk.stream_ = &stream;
    chunk.rows_ = std::move(spare_.back());
    spare_.pop_back();
  }
  return *stream.chunks.back().rows_;
}

void RowStreams::add_finest(const SplatRows& rows) {
  Stream& stream = streams(0)[0];
  for (std::size_t begin = 0; begin < rows.size();) {
    SplatRows& chunk = open_chunk(stream);
    const std::size_t end = std::min(rows.size(), begin + points_per_chunk_ - chunk.size());
    chunk.append(rows, begin, end);
    begin = end;
  }
}

void RowStreams::add_packed_finest(Bytes chunk) {
  Stream& stream = streams(0)[0];
  Chunk& added = stream.chunks.emplace_back();
  added.stream_ = &stream;
  added.packed_ = std::move(chunk);
}

Bytes RowStreams::pack_finest(const SplatRows& rows) const {
  return serialize(pack_rows(rows, all_columns_, attributes_));
}

void RowStreams::add_point(std::size_t segment, const Member& member) {
  const std::size_t attributes = attributes_.size();
  std::vector<Stream>& at = streams(segment);
  SplatRows* own = nullptr;
  for (std::size_t level = 0; level <= segment; ++level) {
    SplatRows& rows = open_chunk(at[level]);
    own = &rows;
    rows.add_splat(member.splats[level], std::span(member.value_rows).subspan(level * attributes, attributes));
  }
  own->add_point(member.point);
  for (std::size_t a = 0; a < attributes; ++a)
    own->add_point_value(a, member.values[a].value, member.values[a].gradient);
}

void RowStreams::take(std::vector<Chunk>& chunks, bool at_end) {
  for (Chunk& chunk : chunks)
    if (chunk.rows_) {
      chunk.rows_->clear();
      spare_.push_back(std::move(chunk.rows_));
    }
  chunks.clear();
  for (std::size_t segment = 0; segment < streams_.size(); ++segment)
    for (std::size_t level = 0; level <= segment; ++level) {
      if (!at_end && is_fitted(level)) continue;
      std::deque<Chunk>& waiting = streams_[segment][level].chunks;
      while (!waiting.empty() && (at_end || is_complete(waiting.front()))) {
        chunks.push_back(std::move(waiting.front()));
        waiting.pop_front();
      }
    }
}

void RowStreams::pack(Chunk& chunk) const {
  if (chunk.rows_) chunk.packed_ = serialize(pack_rows(*chunk.rows_, *chunk.stream_->columns, attributes_));
}

Status RowStreams::write(const Chunk& chunk) {
  // With 15 resolutions each stream has its own file; of what is coarser there is little.
  constexpr std::size_t most_files = 128;
  Stream& stream = *chunk.stream_;
  if (!stream.file) {
    if (files_.size() < most_files) {
      SPLATVOL_TRY_ASSIGN(file, TempFile::create(folder_));
      files_.push_back(std::move(file));
    }
    stream.file = &files_.back();
  }
  std::span<const std::byte> row = chunk.packed_;
  const std::size_t head = stream.columns->size() * sizeof(format::ChunkEntry);
  if (stream.finest) {
    SPLATVOL_TRY(finest_.append(row.subspan(head)));
    row = row.first(head);
  } else {
    coarse_bytes_ += row.size() - head;
  }
  stream.packed.push_back({stream.file->size(), row.size()});
  return stream.file->append(row);
}

void RowStreams::fit() {
  fit_densities(shapes_);
  for (std::vector<Stream>& at : streams_)
    for (const Chunk& chunk : at[0].chunks) {
      SplatRows::Splats& splats = chunk.rows_->splats;
      for (std::size_t i = 0; i < splats.shapes.size(); ++i)
        splats.shapes[i].density = shapes_[splats.numbers[i]].shape.density;
    }
  shapes_ = {};
}

Status RowStreams::finish(std::size_t levels) {
  if (fits_) fit();
  levels_ = levels;
  std::vector<Chunk> chunks;
  take(chunks, true);
  // Not all at once: what is packed is held until it is written.
  constexpr std::size_t chunks_in_flight = 256;
  for (std::size_t first = 0; first < chunks.size(); first += chunks_in_flight) {
    const std::size_t last = std::min(first + chunks_in_flight, chunks.size());
    tbb::parallel_for(first, last, [&](std::size_t c) { pack(chunks[c]); });
    for (std::size_t c = first; c < last; ++c) {
      SPLATVOL_TRY(write(chunks[c]));
      chunks[c] = {};
    }
  }
  return {};
}

Status RowStreams::read(const Visit& visit) {
  Bytes bytes;
  for (std::size_t level = levels_; level-- > 0;) {
    for (std::size_t segment = std::min(levels_, streams_.size()); segment-- > level;) {
      Stream& stream = streams_[segment][level];
      std::vector<format::ChunkEntry> entries(stream.columns->size());
      const std::size_t head = entries.size() * sizeof(format::ChunkEntry);
      Extent done{0, 0};  // read, but not given back yet
      const auto give_back = [&] {
        if (done.bytes > 0) stream.file->release(done.offset, done.bytes);
        done = {done.offset + done.bytes, 0};
      };
      for (const Extent& extent : stream.packed) {
        bytes.resize(extent.bytes);
        SPLATVOL_TRY(stream.file->read(extent.offset, bytes));
        std::memcpy(entries.data(), bytes.data(), head);
        SPLATVOL_TRY(visit(entries, std::span(bytes).subspan(head)));
        if (extent.offset != done.offset + done.bytes) {
          give_back();
          done.offset = extent.offset;
        }
        done.bytes += extent.bytes;
        if (done.bytes >= given_back_together) give_back();
      }
      give_back();
    }
  }
  return {};
}

}  // namespace splatvol
