// Chunks of a file, or of what is to become a part of one.
#pragma once

#include <cstdint>

#include "base/error.h"
#include "format/columns.h"
#include "format/volume_info.h"

namespace splatvol::format {

class ChunkSource {
 public:
  virtual ~ChunkSource() = default;

  /// Cube and counts of the file; groups and rows. The columns of a part may be others than those of info().
  [[nodiscard]] virtual const VolumeInfo& info() const = 0;
  [[nodiscard]] virtual const RowLayout& rows() const = 0;

  /// Reads the chunk of a group in the row of the resolution that adds it. Fails if there is no such column.
  /// Thread-safe.
  [[nodiscard]] virtual Result<PackedChunk> read_chunk(ColumnKind kind, int attribute, std::uint64_t group) const = 0;

 protected:
  ChunkSource() = default;
  ChunkSource(const ChunkSource&) = default;
  ChunkSource& operator=(const ChunkSource&) = default;
};

}  // namespace splatvol::format
