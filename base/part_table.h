// Decoded parts of files that several threads use.
#pragma once

#include <atomic>
#include <compare>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <utility>

#include "base/error.h"
#include "base/memory_budget.h"

namespace splatvol {

/// Names a part of a file. Parts of one kind have one type.
struct PartKey {
  std::uint64_t file;
  int kind;
  std::uint64_t number;
  std::int64_t column = -1;
  std::uint64_t step = 0;

  [[nodiscard]] auto operator<=>(const PartKey&) const = default;
};

/// Holds parts in a budget, each with a reservation for what it takes in memory. A part that somebody holds stays, and
/// counts for its share. Others are spare: those that were let go of longest ago go first, whatever their share. Each
/// part is read once while it is there, whoever asks for it first. Thread-safe.
class PartTable {
 public:
  /// The budget must outlive the table, and the table the parts that it has given. A budget has one table.
  explicit PartTable(MemoryBudget& budget);
  PartTable(const PartTable&) = delete;
  PartTable& operator=(const PartTable&) = delete;
  ~PartTable();

  /// Returns the part; null if it is not there, or its share has no room for it.
  template <class Part>
  [[nodiscard]] std::shared_ptr<const Part> find(const PartKey& key) {
    return std::static_pointer_cast<const Part>(find_any(key));
  }

  /// Whether the part is there.
  [[nodiscard]] bool holds(const PartKey& key) const;

  /// Adds a part, with the reservation for its bytes. Returns it, or the part of this key that is there.
  template <class Part>
  std::shared_ptr<const Part> insert(const PartKey& key, Part part, Reservation reservation) {
    return std::static_pointer_cast<const Part>(
        insert_any(key, std::make_shared<const Part>(std::move(part)), std::move(reservation)));
  }

  /// Returns a part that is there, or reads it: read() returns Result<Part>, and bytes_of(part) the bytes that it
  /// takes. `bytes`: what these are about. Other threads wait for a part that is being read. Without room in the share
  /// the part is the caller's alone, and not held.
  template <class Part, class Read, class BytesOf>
  [[nodiscard]] Result<std::shared_ptr<const Part>> get(const PartKey& key, MemoryShare& share, std::uint64_t bytes,
                                                        const Read& read, const BytesOf& bytes_of) {
    if (auto part = find<Part>(key)) return part;
    const Turn turn(*this, key);
    if (auto part = find<Part>(key)) return part;
    auto reservation = share.reserve(bytes);
    SPLATVOL_TRY_ASSIGN(part, read());
    const std::uint64_t taken = bytes_of(part);
    if (reservation && !reservation->resize(taken)) reservation.reset();
    if (!reservation) return std::make_shared<const Part>(std::move(part));
    return insert(key, std::move(part), std::move(*reservation));
  }

  /// Returns a number that names one file, or one of several ways to decode it.
  [[nodiscard]] std::uint64_t add_file() { return ++files_; }

  /// Drops the parts of a file that nobody holds.
  void clear(std::uint64_t file);

 private:
  struct Slot {
    std::shared_ptr<const void> part;
    Reservation reservation;
    std::uint64_t holders = 0;
    std::list<PartKey>::iterator place = {};  // in held_ or spare_
  };
  // Holds a part. Made before the lock is taken, as memory may fail.
  struct Holder {
    PartTable& table;
    Slot* slot = nullptr;

    explicit Holder(PartTable& of) : table(of) {}
    Holder(const Holder&) = delete;
    Holder& operator=(const Holder&) = delete;
    ~Holder() {
      if (slot) table.let_go(*slot);
    }
  };
  // While it lives, other threads wait for their turn with the part.
  class Turn {
   public:
    Turn(PartTable& table, const PartKey& key);
    Turn(const Turn&) = delete;
    Turn& operator=(const Turn&) = delete;
    ~Turn();

   private:
    PartTable& table_;
    const PartKey& key_;
    std::shared_ptr<std::mutex> mutex_;
    std::unique_lock<std::mutex> lock_;
  };
  [[nodiscard]] std::shared_ptr<const void> find_any(const PartKey& key);
  std::shared_ptr<const void> insert_any(const PartKey& key, std::shared_ptr<const void> part, Reservation reservation);
  [[nodiscard]] std::shared_ptr<const void> hold(Slot& slot, std::shared_ptr<Holder> holder);
  void let_go(Slot& slot);
  [[nodiscard]] bool drop_oldest();

  MemoryBudget& budget_;
  std::atomic<std::uint64_t> files_ = 0;
  mutable std::mutex mutex_;
  std::list<PartKey> held_, spare_;  // spare: parts that nobody holds, last used first
  std::map<PartKey, Slot> slots_;
  std::map<PartKey, std::shared_ptr<std::mutex>> turns_;
};

/// Where the parts of a file are held. The last copy drops them.
struct PartRoom {
  PartTable* table;
  MemoryShare* share;
  std::uint64_t file;
  std::shared_ptr<const void> owner;

  /// The same file, in another share of the table's budget.
  [[nodiscard]] PartRoom in(MemoryShare& other) const { return {table, &other, file, owner}; }

  /// As those of the table.
  template <class Part>
  [[nodiscard]] std::shared_ptr<const Part> find(const PartKey& key) const {
    return table->find<Part>(key);
  }
  [[nodiscard]] bool holds(const PartKey& key) const { return table->holds(key); }
  template <class Part>
  std::shared_ptr<const Part> insert(const PartKey& key, Part part, Reservation reservation) const {
    return table->insert(key, std::move(part), std::move(reservation));
  }
};

/// Returns a room for another file. The table must outlive its copies.
[[nodiscard]] PartRoom room_in(PartTable& table, MemoryShare& share);

/// Returns a room in a table of its own, which lives as long as copies of the room do.
[[nodiscard]] PartRoom own_room(std::uint64_t memory);

}  // namespace splatvol
