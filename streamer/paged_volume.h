// A volume whose index and directory pages are read when they are needed, through the cache.
#pragma once

#include <cstdint>
#include <memory>

#include "base/error.h"
#include "format/volume.h"
#include "streamer/cache.h"
#include "streamer/cut.h"

namespace splatvol {

/// A volume, seen through one attribute. Reading a page waits for the file. Not thread-safe.
class PagedVolume final : public IndexPages {
 public:
  /// `attribute` is an index into volume.info().attributes. Keeps references to both.
  PagedVolume(const format::Volume& volume, int attribute, Cache& cache)
      : volume_(volume), attribute_(attribute), cache_(cache) {}

  [[nodiscard]] const format::Volume& volume() const { return volume_; }
  [[nodiscard]] int attribute() const { return attribute_; }

  [[nodiscard]] Result<std::shared_ptr<const format::IndexPage>> root() override;
  [[nodiscard]] Result<std::shared_ptr<const format::IndexPage>> linked(const format::IndexPage& page,
                                                                        std::uint32_t node) override;

  /// Return the number of chunks of a directory page, and its bytes in memory.
  [[nodiscard]] std::uint64_t directory_page_chunks(std::uint64_t number) const;
  [[nodiscard]] std::uint64_t directory_page_bytes(std::uint64_t number) const {
    return sizeof(format::DirectoryPage) + directory_page_chunks(number) * sizeof(format::ChunkLocation);
  }

  /// Returns the location of a chunk. Requires a column that the row has.
  [[nodiscard]] Result<format::ChunkLocation> find_chunk(std::uint64_t row, int column);

 private:
  template <class Page, class Read>
  [[nodiscard]] Result<std::shared_ptr<const Page>> page(CacheKey key, std::uint64_t packed_bytes, Read read);
  [[nodiscard]] Result<std::shared_ptr<const format::DirectoryPage>> directory_page(std::uint64_t number);

  const format::Volume& volume_;
  int attribute_;
  Cache& cache_;
};

}  // namespace splatvol
