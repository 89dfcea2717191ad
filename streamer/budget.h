// A budget of memory. Whoever holds memory has a reservation for it.
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>

namespace splatvol {

class MemoryBudget;

/// Bytes of a budget. The destructor gives them back. Must not outlive its budget.
class Reservation {
 public:
  Reservation() = default;
  Reservation(Reservation&& other) noexcept;
  Reservation& operator=(Reservation&& other) noexcept;
  ~Reservation();

  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }

 private:
  friend class MemoryBudget;
  Reservation(MemoryBudget* budget, std::uint64_t bytes) : budget_(budget), bytes_(bytes) {}

  MemoryBudget* budget_ = nullptr;
  std::uint64_t bytes_ = 0;
};

/// A number of bytes that reservations never exceed. Thread-safe.
class MemoryBudget {
 public:
  explicit MemoryBudget(std::uint64_t capacity) : capacity_(capacity) {}
  MemoryBudget(const MemoryBudget&) = delete;
  MemoryBudget& operator=(const MemoryBudget&) = delete;

  /// Reserves bytes. Returns nullopt, and reserves nothing, if they do not fit.
  [[nodiscard]] std::optional<Reservation> reserve(std::uint64_t bytes);

  [[nodiscard]] std::uint64_t capacity() const { return capacity_; }
  [[nodiscard]] std::uint64_t used() const { return used_; }

  /// The most bytes that were ever in use at once.
  [[nodiscard]] std::uint64_t peak() const { return peak_; }

 private:
  friend class Reservation;

  const std::uint64_t capacity_;
  std::atomic<std::uint64_t> used_ = 0;
  std::atomic<std::uint64_t> peak_ = 0;
};

}  // namespace splatvol
