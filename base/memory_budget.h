// A budget of memory, in shares. Whoever holds memory has a reservation for it.
#pragma once

#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>

namespace splatvol {

class MemoryBudget;
class Reservation;

/// The part of a budget that one user may always have. Whether a reservation succeeds depends on what the share's own
/// user needs, never on what others hold. Thread-safe.
class MemoryShare {
 public:
  /// The budget must outlive the share. Requires that all shares of a budget have at most its bytes.
  MemoryShare(MemoryBudget& budget, std::uint64_t bytes) : budget_(budget), capacity_(bytes) {}
  MemoryShare(const MemoryShare&) = delete;
  MemoryShare& operator=(const MemoryShare&) = delete;

  [[nodiscard]] std::uint64_t capacity() const { return capacity_; }

  /// Returns the bytes that are in use. Spare reservations are not.
  [[nodiscard]] std::uint64_t used() const;

  [[nodiscard]] const MemoryBudget& budget() const { return budget_; }

  /// Whether its user may have so many bytes more.
  [[nodiscard]] bool has_room(std::uint64_t bytes) const;

  /// As those of MemoryBudget.
  [[nodiscard]] std::optional<Reservation> reserve(std::uint64_t bytes);
  [[nodiscard]] std::optional<Reservation> reserve_free(std::uint64_t bytes);

 private:
  friend class MemoryBudget;
  friend class Reservation;

  MemoryBudget& budget_;
  const std::uint64_t capacity_;
  std::uint64_t used_ = 0;  // guarded by the budget
};

/// Bytes of a share. The destructor gives them back. Must not outlive the share.
///
/// A spare reservation is for something that its holder can give up. It does not count as its share's, so it may lie
/// in what other shares leave free.
class Reservation {
 public:
  Reservation() = default;
  Reservation(Reservation&& other) noexcept;
  Reservation& operator=(Reservation&& other) noexcept;
  ~Reservation();

  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }

  /// Makes it one of so many bytes. Returns false, and changes nothing, if the share has no room for them. Requires
  /// that it is of a share and not spare.
  [[nodiscard]] bool resize(std::uint64_t bytes);

  /// As resize, but never makes it smaller.
  [[nodiscard]] bool grow(std::uint64_t bytes) { return bytes <= bytes_ || resize(bytes); }

  /// Makes it spare.
  void loosen();

  /// Ends that it is spare. Returns false, and changes nothing, if the share has no room for its bytes.
  [[nodiscard]] bool fasten();

 private:
  friend class MemoryBudget;
  Reservation(MemoryShare* share, std::uint64_t bytes) : share_(share), bytes_(bytes) {}

  void give_back(std::uint64_t bytes);

  MemoryShare* share_ = nullptr;
  std::uint64_t bytes_ = 0;
  bool is_spare_ = false;
};

/// A number of bytes that reservations never exceed. Thread-safe.
class MemoryBudget {
 public:
  explicit MemoryBudget(std::uint64_t capacity) : capacity_(capacity) {}
  MemoryBudget(const MemoryBudget&) = delete;
  MemoryBudget& operator=(const MemoryBudget&) = delete;

  /// Reserves bytes of a share. Where spare reservations lie in them, asks for these. Returns nullopt, and reserves
  /// nothing, if the bytes do not fit.
  [[nodiscard]] std::optional<Reservation> reserve(MemoryShare& share, std::uint64_t bytes);

  /// The same without asking for spare ones.
  [[nodiscard]] std::optional<Reservation> reserve_free(MemoryShare& share, std::uint64_t bytes);

  /// Sets who gives up one spare reservation, and returns false if there is none. It is called by any thread that
  /// reserves.
  void set_yield(std::function<bool()> yield) { yield_ = std::move(yield); }

  [[nodiscard]] std::uint64_t capacity() const { return capacity_; }

  /// Returns the bytes of all reservations.
  [[nodiscard]] std::uint64_t used() const;

  /// The most bytes that were ever reserved at once.
  [[nodiscard]] std::uint64_t peak() const;

 private:
  friend class MemoryShare;
  friend class Reservation;

  const std::uint64_t capacity_;
  std::function<bool()> yield_;
  mutable std::mutex mutex_;
  std::uint64_t used_ = 0, peak_ = 0;
};

inline std::optional<Reservation> MemoryShare::reserve(std::uint64_t bytes) { return budget_.reserve(*this, bytes); }

inline std::optional<Reservation> MemoryShare::reserve_free(std::uint64_t bytes) {
  return budget_.reserve_free(*this, bytes);
}

}  // namespace splatvol
