#include "builder/points/held_points.h"

#include <algorithm>
#include <memory>
#include <utility>

namespace splatvol {

Result<PointBatch> hold_all(const NextPoints& next, std::size_t attributes, std::size_t enough) {
  PointBatch all;
  all.resize_attributes(attributes);
  for (bool ended = false; !ended && all.size() <= enough;) {
    SPLATVOL_TRY_ASSIGN(more, next(all));
    ended = !more;
  }
  return all;
}

NextPoints stream_of(PointBatch points, AddMaterial add_material) {
  struct Held {
    PointBatch points;
    AddMaterial add_material;
    std::size_t next = 0;
  };
  return [held = std::make_shared<Held>(Held{std::move(points), std::move(add_material)})](
             PointBatch& batch) -> Result<bool> {
    const PointBatch& all = held->points;
    const std::size_t begin = held->next, end = std::min(begin + points_at_once, all.size());
    if (begin == end) return false;
    append_points(all, begin, end, batch);
    if (held->add_material) held->add_material(all, begin, end, batch);
    held->next = end;
    return true;
  };
}

}  // namespace splatvol
