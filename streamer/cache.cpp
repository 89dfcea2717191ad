#include "streamer/cache.h"

#include <ranges>
#include <utility>
#include <vector>

namespace splatvol {

Cache::Pointer Cache::find(const CacheKey& key) {
  const auto found = slots_.find(key);
  if (found == slots_.end()) return nullptr;
  uses_.splice(uses_.begin(), uses_, found->second.use);
  return data_of(found->second.entry);
}

Cache::Pointer Cache::insert(const CacheKey& key, CacheData data, Reservation reservation) {
  if (Pointer held = find(key)) return held;
  auto entry = std::make_shared<const Entry>(std::move(data), std::move(reservation));
  uses_.push_front(key);
  slots_.emplace(key, Slot{entry, uses_.begin()});
  return data_of(entry);
}

std::optional<Reservation> Cache::reserve(std::uint64_t bytes) {
  if (bytes > budget_.capacity()) return std::nullopt;
  for (;;) {
    if (auto reservation = budget_.reserve(bytes)) return reservation;
    if (!drop_oldest()) return std::nullopt;
  }
}

bool Cache::extend(Reservation& reservation, std::uint64_t bytes) {
  if (bytes <= reservation.bytes()) return true;
  reservation = Reservation();
  auto larger = reserve(bytes);
  if (!larger) return false;
  reservation = std::move(*larger);
  return true;
}

void Cache::clear() {
  while (drop_oldest()) {
  }
}

void Cache::add_shapes_of(const Cache& other) {
  std::vector<std::pair<CacheKey, Reservation>> taken;
  for (const CacheKey& key : other.uses_) {
    if (key.kind != CacheKey::Kind::shapes || slots_.contains(key)) continue;
    auto room = reserve_spare(other.slots_.at(key).entry->reservation.bytes());
    if (!room) break;
    taken.emplace_back(key, std::move(*room));
  }
  // The last one that is added counts as used last.
  for (auto& [key, room] : std::views::reverse(taken)) insert(key, other.slots_.at(key).entry->data, std::move(room));
}

bool Cache::drop_oldest() {
  for (auto use = uses_.end(); use != uses_.begin();) {
    --use;
    const auto slot = slots_.find(*use);
    if (slot->second.entry.use_count() > 1) continue;
    slots_.erase(slot);
    uses_.erase(use);
    return true;
  }
  return false;
}

}  // namespace splatvol
