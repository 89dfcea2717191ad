// A volume whose index and directory pages are read when they are needed, through the cache.
#pragma once

#include <cstdint>
#include <memory>
#include <set>

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

  /// Changes to another step, or to another file. Keeps a reference. If it is a step of the same series, index pages of
  /// the step before are used for their structure while the cache has them.
  void set_step(const format::Volume& volume, int attribute) {
    step_before_ = volume.is_same_file(*volume_) ? step_key() : 0;
    volume_ = &volume;
    attribute_ = attribute;
    used_.clear();
  }

  [[nodiscard]] const format::Volume& volume() const { return *volume_; }
  [[nodiscard]] int attribute() const { return attribute_; }

  [[nodiscard]] Result<std::shared_ptr<const format::IndexPage>> root() override;
  [[nodiscard]] Result<std::shared_ptr<const format::IndexPage>> linked(const format::IndexPage& page,
                                                                        std::uint32_t node) override;

  /// Reads the root page, without the cache.
  [[nodiscard]] Result<format::IndexPage> read_root() const;

  /// Returns an index page as it was at the step before; null if the cache does not have it.
  [[nodiscard]] std::shared_ptr<const format::IndexPage> structure_of(CacheKey key) const;

  /// The index pages that `root` and `linked` have returned since the last `forget_used`.
  [[nodiscard]] const std::set<CacheKey>& used() const { return used_; }
  void forget_used() { used_.clear(); }

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
  std::uint64_t step_before_ = 0;  // the step of keys; 0: none
  std::set<CacheKey> used_;
  Cache& cache_;
};

}  // namespace splatvol
