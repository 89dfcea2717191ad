// Parts of a file that were read and decoded, kept as long as the budget allows.
#pragma once

#include <compare>
#include <cstdint>
#include <memory>
#include <optional>
#include <variant>

#include "base/part_table.h"
#include "format/octree.h"
#include "format/volume.h"
#include "splat/record.h"

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

/// The parts of a file as one attribute and one kernel show it, in a table that others use, too. Thread-safe.
class Cache {
 public:
  using Pointer = std::shared_ptr<const CacheData>;

  /// `shapes`: those of another cache that shows the same file by the same kernel in this room; 0: none.
  explicit Cache(const PartRoom& room, std::uint64_t shapes = 0)
      : room_(room), shapes_(shapes > 0 ? shapes : room.table->add_file()) {}
  Cache(const Cache&) = delete;
  Cache& operator=(const Cache&) = delete;
  ~Cache() { room_.table->clear(room_.file); }

  [[nodiscard]] const MemoryShare& share() const { return *room_.share; }

  /// Names the shapes that it holds.
  [[nodiscard]] std::uint64_t shapes() const { return shapes_; }

  /// Returns the part, or null if it is not held.
  [[nodiscard]] Pointer find(const CacheKey& key) { return room_.table->find<CacheData>(part_of(key)); }

  /// Adds a part, with the reservation for its bytes. Returns it, or the held part if there is one of this key.
  Pointer insert(const CacheKey& key, CacheData data, Reservation reservation) {
    return room_.table->insert(part_of(key), std::move(data), std::move(reservation));
  }

  /// Reserves bytes, and drops parts as needed. Returns nullopt if even this does not suffice.
  [[nodiscard]] std::optional<Reservation> reserve(std::uint64_t bytes) { return room_.share->reserve(bytes); }

  /// Makes a reservation at least this large. Returns false, and gives it back, if the bytes do not fit.
  [[nodiscard]] bool extend(Reservation& reservation, std::uint64_t bytes);

  /// Reserves bytes without dropping parts. Returns nullopt if they do not fit.
  [[nodiscard]] std::optional<Reservation> reserve_spare(std::uint64_t bytes) {
    return room_.share->reserve_free(bytes);
  }

  /// Forgets all parts: the next ones are of another file.
  void clear();

 private:
  [[nodiscard]] PartKey part_of(const CacheKey& key) const;

  PartRoom room_;
  std::uint64_t shapes_;
};

}  // namespace splatvol
