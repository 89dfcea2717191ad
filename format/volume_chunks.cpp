#include "format/volume_chunks.h"

#include <utility>

#include "format/part_kinds.h"

namespace splatvol::format {

Result<PackedChunk> VolumeChunks::read_chunk(ColumnKind kind, int attribute, std::uint64_t group) const {
  SPLATVOL_TRY_ASSIGN(chunk, find(kind, attribute, group));
  SPLATVOL_TRY_ASSIGN(location, locate(chunk));
  SPLATVOL_TRY_ASSIGN(bytes, volume_.read_bytes(location.offset, location.entry.packed_bytes));
  return PackedChunk{location.entry, std::move(bytes)};
}

Result<std::vector<ByteRange>> VolumeChunks::ranges_of(std::span<const ChunkName> chunks) const {
  std::vector<ByteRange> pages, ranges;
  for (const ChunkName& chunk : chunks) {
    const std::uint64_t page = volume_.directory_page_of_row(chunk.row, chunk.column);
    if (!room_.table->holds(key_of(page))) pages.push_back(volume_.range_of_directory_page(page));
  }
  SPLATVOL_TRY_ASSIGN(ahead, volume_.read_ahead(std::move(pages), *room_.share));
  for (const ChunkName& chunk : chunks) {
    SPLATVOL_TRY_ASSIGN(location, locate(chunk));
    ranges.push_back({location.offset, location.offset + location.entry.packed_bytes});
  }
  return ranges;
}

Result<ChunkName> VolumeChunks::find(ColumnKind kind, int attribute, std::uint64_t group) const {
  const int column = volume_.info().find_column(kind, attribute);
  if (column < 0) return fail(ErrorCode::invalid_argument, "{}: attribute {} has no values", volume_.name(), attribute);
  return ChunkName{volume_.rows().row(volume_.rows().group(group).segment, group), column};
}

Result<ChunkLocation> VolumeChunks::locate(const ChunkName& chunk) const {
  const std::uint64_t number = volume_.directory_page_of_row(chunk.row, chunk.column);
  SPLATVOL_TRY_ASSIGN(page, room_.table->get<DirectoryPage>(
                                key_of(number), *room_.share, sizeof(DirectoryPage),
                                [&] { return volume_.read_directory_page(number); },
                                [](const DirectoryPage& read) { return read.memory_bytes(); }));
  return volume_.find_chunk(*page, chunk.row, chunk.column);
}

PartKey VolumeChunks::key_of(std::uint64_t page) const {
  return {room_.file, directory_page, page, -1, volume_.is_page_of_step(page) ? volume_.step_key() : 0};
}

}  // namespace splatvol::format
