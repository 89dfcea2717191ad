// The chunks of a file as a ChunkSource.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>

#include "format/chunk_source.h"
#include "format/last_used.h"
#include "format/volume.h"

namespace splatvol::format {

/// Holds directory pages that were used last.
class VolumeChunks final : public ChunkSource {
 public:
  /// `memory`: bytes to hold, besides a page. The volume must outlive this.
  VolumeChunks(const Volume& volume, std::uint64_t memory) : volume_(volume), memory_(memory) {}

  [[nodiscard]] const VolumeInfo& info() const override { return volume_.info(); }
  [[nodiscard]] const RowLayout& rows() const override { return volume_.rows(); }
  [[nodiscard]] Result<PackedChunk> read_chunk(ColumnKind kind, int attribute, std::uint64_t group) const override;

 private:
  using Page = std::shared_ptr<const DirectoryPage>;
  [[nodiscard]] Result<Page> page(std::uint64_t number) const;

  const Volume& volume_;
  std::uint64_t memory_;
  mutable std::mutex mutex_;
  mutable LastUsed<std::uint64_t, Page> pages_;
};

}  // namespace splatvol::format
