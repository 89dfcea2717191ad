// What has been read and decoded, kept as long as the budget allows.
#pragma once

#include <compare>
#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <optional>
#include <variant>

#include "format/octree.h"
#include "format/volume.h"
#include "streamer/budget.h"
#include "streamer/decode.h"

namespace splatvol {

/// Names a part of the file; `number` counts within its kind: an index page's offset, a directory page, a chunk's row.
struct CacheKey {
  enum class Kind { index_root, index_page, directory_page, chunk };
  Kind kind;
  std::uint64_t number;
  int column = -1;  // a chunk's

  [[nodiscard]] auto operator<=>(const CacheKey&) const = default;
};

/// Pages and decoded chunks.
using CacheData = std::variant<format::IndexPage, format::DirectoryPage, DecodedChunk>;

/// Parts of a file by last use, each with its reservation. Where the budget is spent, those go first that were used
/// longest ago; what somebody still holds stays. Not thread-safe; what it hands out may be read from any thread.
class Cache {
 public:
  using Pointer = std::shared_ptr<const CacheData>;

  explicit Cache(MemoryBudget& budget) : budget_(budget) {}

  /// Empty where the part is not held.
  [[nodiscard]] Pointer find(const CacheKey& key);

  /// Takes a part in; `reservation` holds its bytes.
  Pointer insert(const CacheKey& key, CacheData data, Reservation reservation);

  /// Reserves bytes, and drops parts for it as needed; nullopt where even that does not suffice.
  [[nodiscard]] std::optional<Reservation> reserve(std::uint64_t bytes);

  /// Reserves bytes that nothing has to be dropped for.
  [[nodiscard]] std::optional<Reservation> reserve_spare(std::uint64_t bytes) { return budget_.reserve(bytes); }

  /// Drops everything that nobody holds.
  void clear();

 private:
  struct Entry {
    CacheData data;
    Reservation reservation;
  };
  struct Slot {
    std::shared_ptr<const Entry> entry;
    std::list<CacheKey>::iterator use;
  };
  [[nodiscard]] bool drop_oldest();
  [[nodiscard]] static Pointer data_of(const std::shared_ptr<const Entry>& entry) { return {entry, &entry->data}; }

  MemoryBudget& budget_;
  std::list<CacheKey> uses_;  // the last used first
  std::map<CacheKey, Slot> slots_;
};

}  // namespace splatvol
