// A volume whose index and directory pages are read when they are needed, through the cache.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <set>
#include <span>

#include "base/error.h"
#include "format/volume.h"
#include "streamer/cache.h"
#include "streamer/cut.h"

namespace splatvol {

/// A volume, seen through one attribute, or through a second one for the opacity, too. Reading a page waits for the
/// file. Not thread-safe.
class PagedVolume final : public IndexPages {
 public:
  /// Keeps references to the volume and the cache.
  PagedVolume(const format::Volume& volume, const format::SummaryAttributes& attributes, Cache& cache)
      : volume_(&volume), attributes_(attributes), cache_(cache) {}

  /// Changes to another step, or to another file. Keeps a reference. If it is a step of the same series, index pages of
  /// the step before are used for their structure while the cache has them.
  void set_step(const format::Volume& volume, const format::SummaryAttributes& attributes) {
    step_before_ = volume.is_same_file(*volume_) ? step_key() : 0;
    volume_ = &volume;
    attributes_ = attributes;
    used_ = {};
  }

  [[nodiscard]] const format::Volume& volume() const { return *volume_; }
  [[nodiscard]] const format::SummaryAttributes& attributes() const { return attributes_; }

  [[nodiscard]] Result<std::shared_ptr<const format::IndexPage>> root() override;
  [[nodiscard]] Result<std::shared_ptr<const format::IndexPage>> linked(const format::IndexPage& page,
                                                                        std::uint32_t node) override;

  /// Reads the root page, without the cache.
  [[nodiscard]] Result<format::IndexPage> read_root() const;

  /// Returns an index page as it was at the step before; null if the cache does not have it.
  [[nodiscard]] std::shared_ptr<const format::IndexPage> structure_of(CacheKey key) const;

  /// The index pages that `root` and `linked` have returned since the last `forget_used`, and their bytes.
  struct Used {
    std::set<CacheKey> keys;
    std::uint64_t bytes = 0;
  };
  [[nodiscard]] const Used& used() const { return used_; }
  void set_used(Used used) { used_ = std::move(used); }
  void forget_used() { used_ = {}; }

  /// The keys of parts in the cache.
  [[nodiscard]] CacheKey root_key() const { return {CacheKey::Kind::index_root, 0, -1, step_key()}; }
  [[nodiscard]] CacheKey index_key(std::uint64_t offset) const {
    return {CacheKey::Kind::index_page, offset, -1, step_key()};
  }
  [[nodiscard]] CacheKey directory_key(std::uint64_t number) const {
    return {CacheKey::Kind::directory_page, number, -1, volume_->is_page_of_step(number) ? step_key() : 0};
  }
  [[nodiscard]] CacheKey row_key(CacheKey::Kind kind, std::uint64_t row, std::span<const int> columns) const {
    const bool of_step = std::ranges::any_of(columns, [&](int column) { return volume_->is_of_step(column); });
    return {kind, row, kind == CacheKey::Kind::values ? columns.front() : -1, of_step ? step_key() : 0};
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
  [[nodiscard]] Result<std::shared_ptr<const format::IndexPage>> note_used(
      const CacheKey& key, Result<std::shared_ptr<const format::IndexPage>> page);
  [[nodiscard]] Result<std::shared_ptr<const format::DirectoryPage>> directory_page(std::uint64_t number);
  [[nodiscard]] std::uint64_t step_key() const { return volume_->series() ? volume_->step() + 1 : 0; }

  const format::Volume* volume_;
  format::SummaryAttributes attributes_;
  std::uint64_t step_before_ = 0;  // the step of keys; 0: none
  Used used_;
  Cache& cache_;
};

}  // namespace splatvol
