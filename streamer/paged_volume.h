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
      : volume_(&volume), attribute_(attribute), cache_(cache) {}

  /// Changes to another step. Keeps a reference.
  void set_step(const format::Volume& volume, int attribute) {
    volume_ = &volume;
    attribute_ = attribute;
  }

  [[nodiscard]] const format::Volume& volume() const { return *volume_; }
  [[nodiscard]] int attribute() const { return attribute_; }

  [[nodiscard]] Result<std::shared_ptr<const format::IndexPage>> root() override;
  [[nodiscard]] Result<std::shared_ptr<const format::IndexPage>> linked(const format::IndexPage& page,
                                                                        std::uint32_t node) override;

  /// The keys of parts in the cache.
  [[nodiscard]] CacheKey root_key() const { return {CacheKey::Kind::index_root, 0, -1, step_key()}; }
  [[nodiscard]] CacheKey index_key(std::uint64_t offset) const {
    return {CacheKey::Kind::index_page, offset, -1, step_key()};
  }
  [[nodiscard]] CacheKey directory_key(std::uint64_t number) const {
    return {CacheKey::Kind::directory_page, number, -1, volume_->is_page_of_step(number) ? step_key() : 0};
  }
  [[nodiscard]] CacheKey chunk_key(std::uint64_t row, int column) const {
    return {CacheKey::Kind::chunk, row, column, volume_->is_of_step(column) ? step_key() : 0};
  }

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
  [[nodiscard]] std::uint64_t step_key() const { return volume_->series() ? volume_->step() + 1 : 0; }

  const format::Volume* volume_;
  int attribute_;
  Cache& cache_;
};

}  // namespace splatvol
