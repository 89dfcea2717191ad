// Parts of a file that were read and decoded, kept as long as the budget allows.
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
#include "splat/record.h"
#include "streamer/budget.h"

namespace splatvol {

/// Names a part of the file. `number` is the offset of an index page, the number of a directory page, or a row of the
/// file. `step` is 0 for what all steps of a series share, and for files without steps; else the step's number + 1.
struct CacheKey {
  enum class Kind { index_root, index_page, directory_page, shapes, values };
  Kind kind;
  std::uint64_t number;
  int column = -1;  // of values
  std::uint64_t step = 0;

  [[nodiscard]] auto operator<=>(const CacheKey&) const = default;
};

/// Pages, and the shapes or values of a row.
using CacheData = std::variant<format::IndexPage, format::DirectoryPage, std::shared_ptr<const ShapeRow>,
                               std::shared_ptr<const ValueRow>>;

/// Parts of a file, each with its reservation. When the budget is spent, drops the parts whose last use is longest ago,
/// except parts that somebody holds. Not thread-safe; the parts may be read from any thread.
class Cache {
 public:
  using Pointer = std::shared_ptr<const CacheData>;

  explicit Cache(MemoryBudget& budget) : budget_(budget) {}

  /// Returns the part, or null if it is not held.
  [[nodiscard]] Pointer find(const CacheKey& key);

  /// Adds a part, with the reservation for its bytes. Returns it, or the held part if there is one of this key.
  Pointer insert(const CacheKey& key, CacheData data, Reservation reservation);

  /// Reserves bytes, and drops parts as needed. Returns nullopt if even this does not suffice.
  [[nodiscard]] std::optional<Reservation> reserve(std::uint64_t bytes);

  /// Makes a reservation at least this large. Returns false, and gives it back, if the bytes do not fit.
  [[nodiscard]] bool extend(Reservation& reservation, std::uint64_t bytes);

  /// Reserves bytes without dropping parts. Returns nullopt if they do not fit.
  [[nodiscard]] std::optional<Reservation> reserve_spare(std::uint64_t bytes) { return budget_.reserve(bytes); }

  /// Drops all parts that nobody holds.
  void clear();

  /// Adds the shapes of rows that another cache of the same file holds, those used last first, while there is room: the
  /// other cache keeps them, too.
  void add_shapes_of(const Cache& other);

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
  std::list<CacheKey> uses_;  // last used first
  std::map<CacheKey, Slot> slots_;
};

}  // namespace splatvol
