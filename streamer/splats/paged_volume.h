// A volume whose index and directory pages are read when they are needed, and held in a room.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "base/error.h"
#include "format/volume.h"
#include "streamer/splats/cut.h"
#include "streamer/store/parts.h"

namespace splatvol {

/// A volume, seen through one attribute, or through a second one for the opacity, too. Reading a page waits for the
/// file. Not thread-safe.
class PagedVolume final : public IndexPages {
 public:
  /// Keeps a reference to the volume. `room`: of its file.
  PagedVolume(const format::Volume& volume, const format::SummaryAttributes& attributes, const PartRoom& room)
      : volume_(&volume), attributes_(attributes), room_(room) {}

  /// Changes to another step, or to another file. Keeps a reference. If it is a step of the same series, index pages of
  /// the step before are used for their structure while they are held.
  void set_step(const format::Volume& volume, const format::SummaryAttributes& attributes, const PartRoom& room) {
    step_before_ = volume.is_same_file(*volume_) ? step_key() : 0;
    volume_ = &volume;
    attributes_ = attributes;
    room_ = room;
    used_ = {};
  }

  [[nodiscard]] const format::Volume& volume() const { return *volume_; }
  [[nodiscard]] const format::SummaryAttributes& attributes() const { return attributes_; }
  [[nodiscard]] const PartRoom& room() const { return room_; }

  [[nodiscard]] Result<std::shared_ptr<const format::IndexPage>> root() override;
  [[nodiscard]] Result<std::shared_ptr<const format::IndexPage>> linked(const format::IndexPage& page,
                                                                        std::uint32_t node) override;

  /// Returns how to read the page that a node links to.
  [[nodiscard]] std::pair<PartKey, IndexPageLoad> load_of_linked(const format::IndexPage& page,
                                                                 std::uint32_t node) const;

  /// Reads the root page, and does not hold it.
  [[nodiscard]] Result<format::IndexPage> read_root() const;

  /// Returns an index page as it was at the step before; null if it is not held.
  [[nodiscard]] std::shared_ptr<const format::IndexPage> structure_of(PartKey key) const;

  /// The index pages that `root` and `linked` have returned since the last `forget_used`, and their bytes.
  struct Used {
    std::set<PartKey> keys;
    std::uint64_t bytes = 0;
  };
  [[nodiscard]] const Used& used() const { return used_; }
  void set_used(Used used) { used_ = std::move(used); }
  void forget_used() { used_ = {}; }

  /// The keys of parts. Those of index pages tell whose summaries they have; those of rows begin with their columns.
  [[nodiscard]] PartKey root_key() const { return {room_.file, format::index_root, 0, summaries_key(), step_key()}; }
  [[nodiscard]] PartKey index_key(std::uint64_t offset) const {
    return {room_.file, format::index_page, offset, summaries_key(), step_key()};
  }
  [[nodiscard]] PartKey directory_key(std::uint64_t number) const {
    return {room_.file, format::directory_page, number, -1, volume_->is_page_of_step(number) ? step_key() : 0};
  }
  [[nodiscard]] PartKey row_key(format::PartKind kind, std::uint64_t row, std::span<const int> columns) const {
    const bool of_step = std::ranges::any_of(columns, [&](int column) { return volume_->is_of_step(column); });
    return {room_.file, kind, row, format::columns_key(columns), of_step ? step_key() : 0};
  }

  /// Returns the bytes of a directory page in memory.
  [[nodiscard]] std::uint64_t directory_page_bytes(std::uint64_t number) const {
    return sizeof(format::DirectoryPage) + volume_->chunks_of_directory_page(number) * sizeof(format::ChunkLocation);
  }

  /// Returns the location of a chunk. Requires a column that the row has.
  [[nodiscard]] Result<format::ChunkLocation> find_chunk(std::uint64_t row, int column);

  /// Reads those of these directory pages that are not there together, as far as there is room for them.
  [[nodiscard]] Status read_directory_pages(const std::set<std::uint64_t>& numbers);

  /// The same for index pages.
  [[nodiscard]] Status read_index_pages(std::map<PartKey, IndexPageLoad> pages);

 private:
  template <class Page, class Read>
  [[nodiscard]] Result<std::shared_ptr<const Page>> page(PartKey key, std::uint64_t packed_bytes, Read read);
  [[nodiscard]] Result<std::shared_ptr<const format::IndexPage>> note_used(
      const PartKey& key, Result<std::shared_ptr<const format::IndexPage>> page);
  [[nodiscard]] Result<std::shared_ptr<const format::DirectoryPage>> directory_page(std::uint64_t number);
  void add_page(PartLoad page, std::uint64_t bytes, std::vector<PartLoad>& pages) const;
  [[nodiscard]] Status read_pages(std::vector<PartLoad> pages);
  [[nodiscard]] std::uint64_t step_key() const { return volume_->step_key(); }
  [[nodiscard]] std::int64_t summaries_key() const {
    return format::columns_key(std::array{attributes_.values, attributes_.opacity});
  }

  const format::Volume* volume_;
  format::SummaryAttributes attributes_;
  std::uint64_t step_before_ = 0;  // the step of keys; 0: none
  Used used_;
  PartRoom room_;
};

}  // namespace splatvol
