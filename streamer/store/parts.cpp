#include "streamer/store/parts.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <new>
#include <utility>

#include "base/interruption.h"
#include "base/run_tasks.h"
#include "format/columns.h"
#include "streamer/store/decode.h"
#include "streamer/store/row_bytes.h"

namespace splatvol {

Result<format::IndexPage> read_index_page(const format::Volume& volume, const format::SummaryAttributes& attributes,
                                          const IndexPageLoad& load) {
  if (load.structure) return volume.with_summaries(*load.structure, attributes);
  return volume.read_index_page(load.ref, load.child_mask, load.parent_counts, attributes);
}

namespace {

ByteRange range_of(const ChunkLoad& chunk) {
  return {chunk.location.offset, chunk.location.offset + chunk.location.entry.packed_bytes};
}

// The bytes of a part, in ascending order.
std::vector<ByteRange> ranges_of(const format::Volume& volume, const PartLoad& part) {
  if (const auto* page = std::get_if<IndexPageLoad>(&part.what))
    return {page->structure ? volume.range_of_summaries(*page->structure) : volume.range_of_index_page(page->ref)};
  if (std::holds_alternative<DirectoryPageLoad>(part.what)) return {volume.range_of_directory_page(part.key.number)};
  std::vector<ByteRange> ranges;
  std::ranges::transform(part.row().chunks, std::back_inserter(ranges), range_of);
  std::ranges::sort(ranges, {}, &ByteRange::begin);
  return ranges;
}

std::string name_of(const format::Volume& volume, const ChunkLoad& chunk) {
  const format::ColumnKind kind = volume.info().columns[static_cast<std::size_t>(chunk.column)].kind;
  return fmt::format("chunk '{}' of row {}", column_kind_name(kind), chunk.row);
}

std::string describe(const format::Volume& volume, const PartLoad& part) {
  if (const auto* row = std::get_if<RowLoad>(&part.what)) {
    std::string text = fmt::format("{}: {}", volume.name(), name_of(volume, row->chunks.front()));
    for (const ChunkLoad& chunk : std::span(row->chunks).subspan(1)) text += " or " + name_of(volume, chunk);
    return text;
  }
  const bool of_index = part.key.kind != format::directory_page;
  return fmt::format("{}: {} page {}", volume.name(), of_index ? "index" : "directory", part.key.number);
}

// Puts the name of the part in front of the reason, unless the reader did.
tl::unexpected<Error> fail_in_part(const format::Volume& volume, const PartLoad& part, const Error& error) {
  const std::string what = describe(volume, part);
  if (error.message.starts_with(what)) return tl::unexpected(error);
  return fail(error.code, "{}: {}", what, error.message);
}

template <class Page>
Result<PartData> as_data(const format::Volume& volume, const PartLoad& part, Result<Page> page) {
  if (!page) return fail_in_part(volume, part, page.error());
  return PartData(std::move(*page));
}

Result<PartData> decode(const format::Volume& volume, const PartLoad& part, std::span<const ChunkBytes> chunks,
                        std::string_view what) {
  const RowLoad& row = part.row();
  if (part.key.kind == format::row_shapes) {
    SPLATVOL_TRY_ASSIGN(shapes, decode_shapes(row.kernel, chunks[0], chunks[1], row.points, volume.info().cube, what));
    return PartData(std::make_shared<const ShapeRow>(std::move(shapes)));
  }
  ValueChunks of_values{chunks[0]};
  if (row.opacity) of_values.opacity = &chunks.back();
  if (chunks.size() > (row.opacity ? 2 : 1)) of_values.gradients = &chunks[1];
  SPLATVOL_TRY_ASSIGN(values, decode_values(row.kernel, of_values, row.points, what));
  return PartData(std::make_shared<const ValueRow>(std::move(values)));
}

// Decoding names all chunks of the part. If one of them is damaged, names this one.
Result<PartData> read_row(const format::Volume& volume, const PartLoad& part) {
  std::vector<format::Bytes> packed;
  std::vector<ChunkBytes> chunks;
  for (const ChunkLoad& chunk : part.row().chunks) {
    const auto [begin, end] = range_of(chunk);
    auto read = volume.read_bytes(begin, end - begin);
    if (!read)
      return fail(read.error().code, "{}: {}: {}", volume.name(), name_of(volume, chunk), read.error().message);
    packed.push_back(std::move(*read));
    chunks.push_back({chunk.location.entry, packed.back()});
  }
  auto data = decode(volume, part, chunks, describe(volume, part));
  if (data) return data;
  for (std::size_t i = 0; i < chunks.size(); ++i)
    if (format::hash_bytes(chunks[i].packed) != chunks[i].entry.hash)
      return fail(ErrorCode::invalid_data, "{}: {}: checksum mismatch", volume.name(),
                  name_of(volume, part.row().chunks[i]));
  return data;
}

Result<PartData> read_part(const format::Volume& volume, const format::SummaryAttributes& attributes,
                           const PartLoad& part) {
  if (const auto* page = std::get_if<IndexPageLoad>(&part.what))
    return as_data(volume, part, read_index_page(volume, attributes, *page));
  if (std::holds_alternative<DirectoryPageLoad>(part.what))
    return as_data(volume, part, volume.read_directory_page(part.key.number));
  return read_row(volume, part);
}

// Of the first read.
std::vector<ByteRange> ranges_of(const format::Volume& volume, const LoadRun& run) {
  std::vector<ByteRange> ranges;
  for (const PartLoad& part : run) std::ranges::copy(ranges_of(volume, part), std::back_inserter(ranges));
  return ranges;
}

// Where the bytes cannot be read together, each part is read by itself and tells what failed.
void read_parts(const format::Volume& volume, const format::SummaryAttributes& attributes, LoadRun& run) {
  const auto together = volume.read_together(ranges_of(volume, run));
  std::vector<ByteRange> ranges;
  for (const PartLoad& part : run)
    if (const auto* page = std::get_if<IndexPageLoad>(&part.what); page && !page->structure)
      std::ranges::copy(volume.ranges_behind(page->ref, attributes), std::back_inserter(ranges));
  const auto behind = volume.read_together(std::move(ranges));
  for (PartLoad& part : run)
    part.data = together || !volume.is_far() ? read_part(volume, attributes, part)
                                             : fail_in_part(volume, part, together.error());
}

// A run goes on along the chunks that are near the end of those before. Other chunks of its parts only add bytes.
std::vector<LoadRun> neighbours_of(const format::Volume& volume, std::vector<PartLoad> parts, std::uint64_t run_bytes) {
  std::vector<std::pair<std::vector<ByteRange>, PartLoad*>> sorted;
  for (PartLoad& part : parts) sorted.emplace_back(ranges_of(volume, part), &part);
  std::ranges::sort(sorted, {},
                    [](const auto& part) { return std::pair(part.first.front().begin, part.first.back().begin); });
  std::vector<LoadRun> runs;
  std::uint64_t end = 0, bytes = 0;  // of the last run
  for (auto& [ranges, part] : sorted) {
    std::uint64_t new_end = ranges.front().begin, added = 0;
    for (const ByteRange& range : ranges) {
      if (range.begin <= new_end + volume.cheap_gap())
        new_end = std::max(new_end, range.end);
      else
        added += range.end - range.begin;
    }
    const std::uint64_t begin = ranges.front().begin;
    const bool joins = !runs.empty() && is_of_row(part->key) && is_of_row(runs.back().back().key) &&
                       begin <= end + volume.cheap_gap() && bytes + added + std::max(new_end, end) - end <= run_bytes;
    if (!joins) {
      runs.emplace_back();
      bytes = 0;
    }
    bytes += added + (joins ? std::max(new_end, end) - end : new_end - begin);
    end = joins ? std::max(new_end, end) : new_end;
    runs.back().push_back(std::move(*part));
  }
  return runs;
}

// Packs parts in their order. A request has about as many ranges and bytes as servers accept.
std::vector<LoadRun> requests_of(const format::Volume& volume, std::vector<PartLoad> parts, std::uint64_t run_bytes) {
  std::vector<LoadRun> runs;
  std::uint64_t bytes = 0;
  std::size_t ranges = 0;
  for (PartLoad& part : parts) {
    std::uint64_t added = 0;
    const std::vector<ByteRange> of_part = join_ranges(ranges_of(volume, part), bytes_of_part);
    for (const ByteRange& range : of_part) added += range.end - range.begin;
    if (runs.empty() || bytes + added > run_bytes || ranges + of_part.size() > most_parts) {
      runs.emplace_back();
      bytes = ranges = 0;
    }
    bytes += added;
    ranges += of_part.size();
    runs.back().push_back(std::move(part));
  }
  return runs;
}

}  // namespace

PartLoad load_part(const PartKey& key, std::variant<IndexPageLoad, DirectoryPageLoad, RowLoad> what) {
  return {key, std::move(what), {}, {}, PartData()};
}

std::uint64_t decoded_bytes(const PartLoad& part) {
  const RowLoad& row = part.row();
  return part.key.kind == format::row_shapes ? shape_row_bytes(row.kernel, row.points)
                                             : value_row_bytes(row.kernel, row.points, row.opacity);
}

std::uint64_t working_bytes(const format::Volume& volume, const PartLoad& part) {
  const RowLoad& row = part.row();
  const std::uint64_t gap = volume.read_gap();
  std::uint64_t unpacked = 0, packed = 0;
  for (const ChunkLoad& chunk : row.chunks) {
    unpacked += chunk.location.entry.unpacked_bytes;
    packed += chunk.location.entry.packed_bytes + gap;
  }
  return packed + (part.key.kind == format::row_shapes ? shape_decoding_bytes(row.kernel, row.points, unpacked)
                                                       : value_decoding_bytes(row.kernel, row.points, unpacked));
}

std::uint64_t held_bytes(const PartData& data) {
  struct Held {
    std::uint64_t operator()(const format::IndexPage& page) const { return page.memory_bytes(); }
    std::uint64_t operator()(const format::DirectoryPage& page) const { return page.memory_bytes(); }
    std::uint64_t operator()(const std::shared_ptr<const ShapeRow>& row) const { return held_bytes(*row); }
    std::uint64_t operator()(const std::shared_ptr<const ValueRow>& row) const { return held_bytes(*row); }
  };
  return std::visit(Held(), data);
}

PartPointer insert(const PartRoom& room, PartLoad part) {
  return std::visit(
      [&](auto& data) -> PartPointer { return room.insert(part.key, std::move(data), std::move(part.decoded)); },
      *part.data);
}

std::vector<LoadRun> runs_of(const format::Volume& volume, std::vector<PartLoad> parts, std::uint64_t run_bytes) {
  if (volume.may_join_requests()) return requests_of(volume, std::move(parts), run_bytes);
  return neighbours_of(volume, std::move(parts), run_bytes);
}

// The system may have less memory than the budget grants. An exception must not leave a thread.
void read_run(const format::Volume& volume, const format::SummaryAttributes& attributes, LoadRun& run) {
  try {
    read_parts(volume, attributes, run);
  } catch (const std::bad_alloc&) {
    // Of so few letters that they need no memory.
    for (PartLoad& part : run) part.data = tl::unexpected(Error{ErrorCode::out_of_budget, "out of memory"});
  }
}

namespace {

void cancel(LoadRun& run) {
  for (PartLoad& part : run) part.data = fail(ErrorCode::cancelled, "cancelled");
}

}  // namespace

void read_runs(const format::Volume& volume, const format::SummaryAttributes& attributes, std::span<LoadRun> runs) {
  for (const LoadRun& run : runs) prefetch(volume, run);
  static_cast<void>(run_tasks(runs.size(), read_threads, [&](std::size_t i, std::size_t /*thread*/) -> Status {
    is_interrupted() ? cancel(runs[i]) : read_run(volume, attributes, runs[i]);
    return {};
  }));
}

bool prefetch(const format::Volume& volume, const LoadRun& run) {
  return volume.waits() || volume.prefetch(ranges_of(volume, run));
}

}  // namespace splatvol
