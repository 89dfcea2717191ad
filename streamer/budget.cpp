#include "streamer/budget.h"

#include <utility>

namespace splatvol {

Reservation::Reservation(Reservation&& other) noexcept
    : budget_(std::exchange(other.budget_, nullptr)), bytes_(std::exchange(other.bytes_, 0)) {}

Reservation& Reservation::operator=(Reservation&& other) noexcept {
  std::swap(budget_, other.budget_);
  std::swap(bytes_, other.bytes_);
  return *this;
}

Reservation::~Reservation() {
  if (budget_ != nullptr) budget_->used_ -= bytes_;
}

std::optional<Reservation> MemoryBudget::reserve(std::uint64_t bytes) {
  std::uint64_t used = used_;
  do {
    if (bytes > capacity_ - used) return std::nullopt;
  } while (!used_.compare_exchange_weak(used, used + bytes));
  for (std::uint64_t peak = peak_; peak < used + bytes && !peak_.compare_exchange_weak(peak, used + bytes);) {
  }
  return Reservation(this, bytes);
}

}  // namespace splatvol
