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

NextPoints stream_with_material(PointBatch points, AddMaterial add_material) {
  constexpr std::size_t most = 512;
  struct Held {
    PointBatch points;
    AddMaterial add_material;
    std::size_t next = 0;
  };
  return [held = std::make_shared<Held>(Held{std::move(points), std::move(add_material)})](
             PointBatch& batch) -> Result<bool> {
    const PointBatch& all = held->points;
    const std::size_t begin = held->next, end = std::min(begin + most, all.size());
    if (begin == end) return false;
    const auto append = [&](const auto& from, auto& to) {
      to.insert(to.end(), from.begin() + static_cast<std::ptrdiff_t>(begin),
                from.begin() + static_cast<std::ptrdiff_t>(end));
    };
    append(all.keys, batch.keys);
    append(all.positions, batch.positions);
    for (std::size_t a = 0; a < all.values.size(); ++a) append(all.values[a], batch.values[a]);
    held->add_material(all, begin, end, batch);
    held->next = end;
    return true;
  };
}

}  // namespace splatvol
