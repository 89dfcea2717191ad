#include "builder/row_streams.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstring>
#include <iterator>
#include <utility>

namespace splatvol {
namespace {

using format::Bytes;
using format::PackedChunk;

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

RowStreams::RowStreams(const format::VolumeInfo& info, std::uint64_t fitted_splats, std::string folder)
    : attributes_(info.attributes),
      all_columns_(info.columns),
      points_per_chunk_(info.points_per_chunk),
      fitted_splats_(fitted_splats),
      folder_(std::move(folder)) {
  std::ranges::copy_if(all_columns_, std::back_inserter(resolution_columns_),
                       [](const format::Column& column) { return column.scope == format::ColumnScope::resolution; });
}

std::vector<RowStreams::Stream>& RowStreams::streams(std::size_t segment) {
  while (streams_.size() <= segment) streams_.emplace_back(streams_.size() + 1);
  return streams_[segment];
}

// Where the stream's next row goes.
SplatRows& RowStreams::open_chunk(Stream& stream) {
  if (stream.rows.empty() || stream.rows.back().size() == points_per_chunk_) {
    if (spare_.empty()) spare_.emplace_back(attributes_.size());
    stream.rows.push_back(std::move(spare_.back()));
    spare_.pop_back();
  }
  return stream.rows.back();
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

RowStreams::Fit& RowStreams::fit(std::size_t step) {
  if (fits_.size() <= step) fits_.resize(step + 1);
  return fits_[step];
}

void RowStreams::add_splat(std::size_t step, const SplatRow& splat, std::uint64_t first_part) {
  Fit& at = fit(step);
  if (!at.wanted) return;
  if (splat.number == fitted_splats_) {
    at = {};
    at.wanted = false;
    return;
  }
  at.shapes.push_back({splat.centroid, splat.shape});
  at.begins.push_back(first_part);
}

void RowStreams::add_point(std::size_t segment, const Member& member) {
  const std::size_t attributes = attributes_.size();
  std::vector<Stream>& at = streams(segment);
  SplatRows* own = nullptr;
  for (std::size_t step = 0; step <= segment; ++step) {
    SplatRows& rows = open_chunk(at[step]);
    own = &rows;
    rows.add_splat(member.splats[step], std::span(member.value_rows).subspan(step * attributes, attributes));
  }
  own->add_point(member.point);
  for (std::size_t a = 0; a < attributes; ++a)
    own->add_point_value(a, member.values[a].value, member.values[a].gradient);
}

Status RowStreams::pack(bool at_end) {
  struct Job {
    Stream* stream;
    const SplatRows* rows;
    const std::vector<format::Column>* columns;
    Bytes bytes;
  };
  std::vector<Job> jobs;
  for (std::size_t segment = 0; segment < streams_.size(); ++segment)
    for (std::size_t step = 0; step <= segment; ++step) {
      if (!at_end && fit(step).wanted) continue;
      Stream& stream = streams_[segment][step];
      for (const SplatRows& rows : stream.rows)
        if (at_end || rows.size() == points_per_chunk_) jobs.push_back({&stream, &rows, &columns(step, segment), {}});
    }

  // Not all at once: what is packed is held until it is written.
  constexpr std::size_t jobs_in_flight = 256;
  for (std::size_t first = 0; first < jobs.size(); first += jobs_in_flight) {
    const std::size_t last = std::min(first + jobs_in_flight, jobs.size());
    tbb::parallel_for(first, last, [&](std::size_t j) {
      jobs[j].bytes = serialize(pack_rows(*jobs[j].rows, *jobs[j].columns, attributes_));
    });
    for (std::size_t j = first; j < last; ++j) {
      Stream& stream = *jobs[j].stream;
      SPLATVOL_TRY(append(stream, jobs[j].bytes));
      jobs[j].bytes = {};
      spare_.push_back(std::move(stream.rows.front()));
      spare_.back().clear();
      stream.rows.pop_front();
    }
  }
  return {};
}

Status RowStreams::append(Stream& stream, std::span<const std::byte> row) {
  // With 15 resolutions each stream has its own; of what is coarser there is little.
  constexpr std::size_t most_files = 128;
  if (!stream.file) {
    if (files_.size() < most_files) {
      SPLATVOL_TRY_ASSIGN(file, TempFile::create(folder_));
      files_.push_back(std::move(file));
    }
    stream.file = &files_.back();
  }
  stream.packed.push_back({stream.file->size(), row.size()});
  return stream.file->append(row);
}

Status RowStreams::pack() { return pack(false); }

// From fine to coarse: a splat looks where its parts are.
void RowStreams::fit_step(std::size_t step) {
  Fit& at = fits_[step];
  if (step > 0 && !fits_[step - 1].shapes.empty()) {
    at.begins.push_back(fits_[step - 1].shapes.size());
    fit_densities(at.shapes, fits_[step - 1].shapes, at.begins);
  } else {
    fit_densities(at.shapes);
  }
  for (std::size_t segment = step; segment < streams_.size(); ++segment)
    for (SplatRows& rows : streams_[segment][step].rows)
      for (std::size_t i = 0; i < rows.size(); ++i)
        rows.splats.shapes[i].density = at.shapes[rows.splats.numbers[i]].shape.density;
}

Status RowStreams::finish(std::size_t steps) {
  for (std::size_t step = 0; step < steps; ++step)
    if (fit(step).wanted) fit_step(step);
  fits_.clear();
  fits_.resize(steps);
  SPLATVOL_TRY(pack(true));
  return {};
}

Status RowStreams::read(const Visit& visit) {
  const std::size_t steps = fits_.size();
  Bytes bytes;
  for (std::size_t step = steps; step-- > 0;) {
    for (std::size_t segment = std::min(steps, streams_.size()); segment-- > step;) {
      std::vector<format::ChunkEntry> entries(columns(step, segment).size());
      const std::size_t head = entries.size() * sizeof(format::ChunkEntry);
      Stream& stream = streams_[segment][step];
      for (const Extent& extent : stream.packed) {
        bytes.resize(extent.bytes);
        SPLATVOL_TRY(stream.file->read(extent.offset, bytes));
        std::memcpy(entries.data(), bytes.data(), head);
        SPLATVOL_TRY(visit(entries, std::span(bytes).subspan(head)));
        stream.file->release(extent.offset, extent.bytes);
      }
    }
  }
  return {};
}

}  // namespace splatvol
