#include "base/memory_budget.h"

#include <algorithm>
#include <utility>

namespace splatvol {

std::uint64_t MemoryShare::used() const {
  const std::scoped_lock lock(budget_.mutex_);
  return used_;
}

bool MemoryShare::has_room(std::uint64_t bytes) const {
  const std::scoped_lock lock(budget_.mutex_);
  return bytes <= capacity_ - used_;
}

Reservation::Reservation(Reservation&& other) noexcept
    : share_(std::exchange(other.share_, nullptr)),
      bytes_(std::exchange(other.bytes_, 0)),
      is_spare_(std::exchange(other.is_spare_, false)) {}

Reservation& Reservation::operator=(Reservation&& other) noexcept {
  std::swap(share_, other.share_);
  std::swap(bytes_, other.bytes_);
  std::swap(is_spare_, other.is_spare_);
  return *this;
}

Reservation::~Reservation() {
  if (share_ != nullptr) give_back(bytes_);
}

void Reservation::give_back(std::uint64_t bytes) {
  MemoryBudget& budget = share_->budget_;
  const std::scoped_lock lock(budget.mutex_);
  budget.used_ -= bytes;
  if (!is_spare_) share_->used_ -= bytes;
  bytes_ -= bytes;
}

bool Reservation::resize(std::uint64_t bytes) {
  if (bytes > bytes_) {
    auto more = share_->reserve(bytes - bytes_);
    if (!more) return false;
    bytes_ += std::exchange(more->bytes_, 0);
  } else {
    give_back(bytes_ - bytes);
  }
  return true;
}

void Reservation::loosen() {
  if (share_ == nullptr || is_spare_) return;
  const std::scoped_lock lock(share_->budget_.mutex_);
  share_->used_ -= bytes_;
  is_spare_ = true;
}

bool Reservation::fasten() {
  if (share_ == nullptr || !is_spare_) return true;
  const std::scoped_lock lock(share_->budget_.mutex_);
  if (bytes_ > share_->capacity_ - share_->used_) return false;
  share_->used_ += bytes_;
  is_spare_ = false;
  return true;
}

// All shares have at most the budget's bytes, so whatever is in the way is spare. Another thread may be giving it up:
// then there is room after the last call.
std::optional<Reservation> MemoryBudget::reserve(MemoryShare& share, std::uint64_t bytes) {
  for (;;) {
    if (auto reservation = reserve_free(share, bytes)) return reservation;
    if (!share.has_room(bytes)) return std::nullopt;
    if (!yield_ || !yield_()) return reserve_free(share, bytes);
  }
}

std::optional<Reservation> MemoryBudget::reserve_free(MemoryShare& share, std::uint64_t bytes) {
  const std::scoped_lock lock(mutex_);
  if (bytes > share.capacity_ - share.used_ || bytes > capacity_ - used_) return std::nullopt;
  used_ += bytes;
  share.used_ += bytes;
  peak_ = std::max(peak_, used_);
  return Reservation(&share, bytes);
}

std::uint64_t MemoryBudget::used() const {
  const std::scoped_lock lock(mutex_);
  return used_;
}

std::uint64_t MemoryBudget::peak() const {
  const std::scoped_lock lock(mutex_);
  return peak_;
}

}  // namespace splatvol
