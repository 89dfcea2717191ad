#include "builder/points/held_points.h"

#include <memory>
#include <utility>

namespace splatvol {

Result<PointBatch> hold_all(const NextPoints& next, std::size_t attributes) {
  PointBatch all;
  all.resize_attributes(attributes);
  for (bool ended = false; !ended;) {
    SPLATVOL_TRY_ASSIGN(more, next(all));
    ended = !more;
  }
  return all;
}

NextPoints stream_of(PointBatch points) {
  return [held = std::make_shared<PointBatch>(std::move(points))](PointBatch& batch) -> Result<bool> {
    if (held->size() == 0) return false;
    for_each_array(*held, batch, [](auto& from, auto& to) {
      if (to.empty())
        to.swap(from);
      else
        to.insert(to.end(), from.begin(), from.end());
      from = {};
    });
    return true;
  };
}

}  // namespace splatvol
