// The chunks of a file as a ChunkSource.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/part_table.h"
#include "format/chunk_source.h"
#include "format/volume.h"

namespace splatvol::format {

/// Names a chunk.
struct ChunkName {
  std::uint64_t row;
  int column;  // index into VolumeInfo::columns
};

class VolumeChunks final : public ChunkSource {
 public:
  /// `room`: for directory pages. The volume must outlive this.
  VolumeChunks(const Volume& volume, const PartRoom& room) : volume_(volume), room_(room) {}

  [[nodiscard]] const VolumeInfo& info() const override { return volume_.info(); }
  [[nodiscard]] const RowLayout& rows() const override { return volume_.rows(); }
  [[nodiscard]] Result<PackedChunk> read_chunk(ColumnKind kind, int attribute, std::uint64_t group) const override;

  /// Returns the chunk of a group in the row of the resolution that adds it. `attribute`: -1: none. Fails if there is
  /// no such column.
  [[nodiscard]] Result<ChunkName> find(ColumnKind kind, int attribute, std::uint64_t group) const;

  /// Returns where a chunk is in the file. Thread-safe.
  [[nodiscard]] Result<ChunkLocation> locate(const ChunkName& chunk) const;

  /// Returns where chunks are in the file, in the same order. Reads pages of the directory ahead (Volume::read_ahead).
  [[nodiscard]] Result<std::vector<ByteRange>> ranges_of(std::span<const ChunkName> chunks) const;

 private:
  [[nodiscard]] PartKey key_of(std::uint64_t page) const;

  const Volume& volume_;
  PartRoom room_;
};

}  // namespace splatvol::format
