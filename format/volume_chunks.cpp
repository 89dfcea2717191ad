#include "format/volume_chunks.h"

#include <utility>

namespace splatvol::format {

Result<PackedChunk> VolumeChunks::read_chunk(ColumnKind kind, int attribute, std::uint64_t group) const {
  const int column = volume_.info().find_column(kind, attribute);
  if (column < 0) return fail(ErrorCode::invalid_argument, "{}: attribute {} has no values", volume_.name(), attribute);
  const std::uint64_t row = volume_.rows().row(volume_.rows().group(group).segment, group);
  SPLATVOL_TRY_ASSIGN(page, this->page(volume_.directory_page_of_row(row, column)));
  const ChunkLocation& location = volume_.find_chunk(*page, row, column);
  SPLATVOL_TRY_ASSIGN(bytes, volume_.read_bytes(location.offset, location.entry.packed_bytes));
  return PackedChunk{location.entry, std::move(bytes)};
}

Result<VolumeChunks::Page> VolumeChunks::page(std::uint64_t number) const {
  {
    const std::scoped_lock lock(mutex_);
    if (const Page* held = pages_.find(number)) return *held;
  }
  SPLATVOL_TRY_ASSIGN(read, volume_.read_directory_page(number));
  const std::uint64_t bytes = read.memory_bytes();
  auto page = std::make_shared<const DirectoryPage>(std::move(read));
  const std::scoped_lock lock(mutex_);
  if (!pages_.find(number)) pages_.add(number, page, bytes, memory_);
  return page;
}

}  // namespace splatvol::format
