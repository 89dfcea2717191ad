#include "player/playing.h"

#include <algorithm>
#include <utility>

namespace splatvol {

void Playing::begin() {
  seconds_ = 0;
  awaited_.reset();
}

std::optional<std::size_t> Playing::next(std::size_t shown, std::size_t count) {
  const auto awaited = std::exchange(awaited_, {});
  const auto step = after(shown, count);
  if ((awaited && shown != *awaited) || !step) end();
  return is_begun() ? step : std::nullopt;
}

bool Playing::is_due(bool is_ready) {
  const double period = 1 / steps_per_second;
  if (*seconds_ < period || !is_ready) return false;
  seconds_ = std::min(*seconds_ - period, period);
  return true;
}

}  // namespace splatvol
