#include "streamer/cache.h"

#include <utility>

namespace splatvol {

bool Cache::extend(Reservation& reservation, std::uint64_t bytes) {
  if (bytes <= reservation.bytes()) return true;
  if (reservation.bytes() > 0 && reservation.resize(bytes)) return true;
  reservation = Reservation();
  auto larger = reserve(bytes);
  if (larger) reservation = std::move(*larger);
  return larger.has_value();
}

void Cache::clear() {
  room_.table->clear(room_.file);
  room_.file = room_.table->add_file();
  shapes_ = room_.table->add_file();
}

PartKey Cache::part_of(const CacheKey& key) const {
  constexpr int first_kind = 100;  // format::PartKind has others
  const std::uint64_t file = key.kind == CacheKey::Kind::shapes ? shapes_ : room_.file;
  return {file, first_kind + static_cast<int>(key.kind), key.number, key.column, key.step};
}

}  // namespace splatvol
