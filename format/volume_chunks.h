// The chunks of a file as a ChunkSource.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/part_table.h"
#include "format/chunk_source.h"
#include "format/volume.h"

namespace splatvol::format {

/// The chunk of a group in the row of the resolution that adds it.
struct ChunkName {
  ColumnKind kind;
  int attribute;  // -1: none
  std::uint64_t group;
};

class VolumeChunks final : public ChunkSource {
 public:
  /// `room`: for directory pages. The volume must outlive this.
  VolumeChunks(const Volume& volume, const PartRoom& room) : volume_(volume), room_(room) {}

  [[nodiscard]] const VolumeInfo& info() const override { return volume_.info(); }
  [[nodiscard]] const RowLayout& rows() const override { return volume_.rows(); }
  [[nodiscard]] Result<PackedChunk> read_chunk(ColumnKind kind, int attribute, std::uint64_t group) const override;

  /// Returns where chunks are in the file, in the same order. Reads pages of the directory ahead (Volume::read_ahead).
  [[nodiscard]] Result<std::vector<ByteRange>> ranges_of(std::span<const ChunkName> chunks, std::uint64_t memory) const;

 private:
  using Page = std::shared_ptr<const DirectoryPage>;
  // Where a chunk stands in the directory.
  struct Entry {
    int column;
    std::uint64_t row;
    std::uint64_t page;
  };
  [[nodiscard]] Result<Entry> find(const ChunkName& chunk) const;
  [[nodiscard]] Result<ChunkLocation> locate(const Entry& entry) const;
  [[nodiscard]] Result<Page> page(std::uint64_t number) const;

  [[nodiscard]] PartKey key_of(std::uint64_t page) const;

  const Volume& volume_;
  PartRoom room_;
};

}  // namespace splatvol::format
