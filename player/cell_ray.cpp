#include "player/cell_ray.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace splatvol {
namespace {

constexpr double none = std::numeric_limits<double>::quiet_NaN();

// Returns the distances between which a ray is in the clip region and near cells.
VisibleDepths visible_part(const KeptCells& cells, const ClipRegion& clip, const Ray& ray) {
  Box box;
  for (const auto& page : cells.reader().pages()) box.include(box_of_cells(page));
  const double reach = cells.cells().reach();
  const VisibleDepths near = clipped_depths(view_along(ray, {Box{box.low - reach, box.high + reach}, {}}), 0, 0);
  const VisibleDepths shown = clipped_depths(view_along(ray, clip), 0, 0);
  return {std::max(near.from, shown.from), std::min(near.to, shown.to)};
}

}  // namespace

Result<CellRay> CellRay::follow(const KeptCells& cells, const Scene& scene, const ClipRegion& clip, const Ray& ray) {
  const auto [from, to] = visible_part(cells, clip, ray);
  const double reach = cells.cells().reach();
  if (!(from < to) || ray.at(from) == ray.at(to)) return CellRay(scene, {}, 0, reach);
  const auto read = [&](const format::CellChunkEntry& entry, Tetrahedra& scratch) {
    return cells.read(entry, scratch);
  };
  SPLATVOL_TRY_ASSIGN(rows, follow_line(cells.cells(), ray.at(from), ray.at(to), read));
  return CellRay(scene, std::move(rows), from, reach);
}

CellRay::CellRay(const Scene& scene, LineRows rows, double start, double reach)
    : attribute_(scene.attribute),
      contours_(contours_of(scene)),
      function_(scene.transfer_function),
      rows_(std::move(rows)),
      start_(start),
      reach_(reach) {
  if (scene.opacity) opacity_.emplace(scene.opacity->function);
  RayLight light;
  for (std::size_t row = 0; row < rows_.arc_lengths.size(); ++row) {
    if (row > 0) add_stretch(row - 1, rows_.arc_lengths[row], light);
    depths_.push_back(light.depth);
  }
}

// Adds the part from a row to an arc length that is not beyond the next row.
void CellRay::add_stretch(std::size_t row, double end, RayLight& light) const {
  const double begin = rows_.arc_lengths[row], whole = rows_.arc_lengths[row + 1] - begin, length = end - begin;
  if (!(length > 0)) return;
  const auto ends_of = [&](std::size_t attribute) {
    const double front = rows_.values[attribute][row], back = rows_.values[attribute][row + 1];
    return Ends{front, front + length / whole * (back - front)};
  };
  const Ends values = ends_of(0);
  if (std::isnan(values.front + values.back)) return;
  if (!opacity_) return function_.add(values, length, light);
  const Ends factors = ends_of(1);
  if (!std::isnan(factors.front + factors.back)) function_.add(values, *opacity_, factors, length, light);
}

// Without the parts in front of all cells and behind them.
std::vector<Pick::Row> CellRay::rows() const {
  if (rows_.arc_lengths.empty()) return {};
  const std::vector<double>& values = rows_.values[0];
  const auto is_one = [](double value) { return !std::isnan(value); };
  const auto first = static_cast<std::size_t>(std::ranges::find_if(values, is_one) - values.begin());
  std::size_t end = values.size();
  while (end > first && !is_one(values[end - 1])) --end;
  std::vector<Pick::Row> rows;
  for (std::size_t row = first; row < end; ++row)
    rows.push_back({start_ + rows_.arc_lengths[row], values[row], -std::expm1(-depths_[row])});
  return rows;
}

double CellRay::opacity_up_to(double distance) const {
  if (rows_.arc_lengths.empty()) return 0;
  const double arc_length = distance - start_;
  const auto behind = std::ranges::upper_bound(rows_.arc_lengths, arc_length);
  if (behind == rows_.arc_lengths.begin()) return 0;
  RayLight light;
  const auto row = static_cast<std::size_t>(behind - rows_.arc_lengths.begin()) - 1;
  if (behind != rows_.arc_lengths.end()) add_stretch(row, arc_length, light);
  return -std::expm1(-depths_[row] - light.depth);
}

// What is beside all cells by rounding has the value at their border.
PickedValue CellRay::value_at(double distance) const {
  PickedValue found{attribute_, none};
  if (rows_.arc_lengths.empty()) return found;
  const double last = rows_.arc_lengths.back();
  for (const double aside : {0.0, reach_, -reach_}) {
    const double arc_length = distance - start_ + aside;
    if (arc_length < -reach_ || arc_length > last + reach_) continue;
    found.value = value_on_line(rows_, 0, std::clamp(arc_length, 0.0, last));
    if (!std::isnan(found.value)) break;
  }
  return found;
}

// A contour is met where one end of a part has its value or more, and the other one has less.
std::vector<PickLayer> CellRay::layers_of_contours() const {
  std::vector<PickLayer> layers;
  for (std::size_t row = 0; row + 1 < rows_.arc_lengths.size() && !contours_.surfaces.empty(); ++row) {
    const double begin = rows_.arc_lengths[row], end = rows_.arc_lengths[row + 1];
    const double front = rows_.values[0][row], back = rows_.values[0][row + 1];
    if (!(begin < end) || std::isnan(front + back)) continue;
    for (const Contour& contour : contours_.surfaces) {
      if ((front >= contour.value) == (back >= contour.value)) continue;
      const double share = (contour.value - front) / (back - front);
      PickLayer layer{Pick::Kind::contour,
                      "contour",
                      start_ + begin + share * (end - begin),
                      contour.opacity,
                      {{attribute_, contour.value}}};
      if (contour.is_colored) {
        const std::vector<double>& colors = rows_.values.back();
        const double color = colors[row] + share * (colors[row + 1] - colors[row]);
        if (std::isnan(color)) continue;
        layer.values.push_back({contours_.attribute, color});
      }
      layers.push_back(std::move(layer));
    }
  }
  return layers;
}

Result<std::optional<Pick>> pick_cells(const KeptCells& cells, const Scene& scene, std::span<const Surface> surfaces,
                                       const Ray& ray) {
  const ClipRegion clip = clip_region_of(scene);
  SPLATVOL_TRY_ASSIGN(on_ray, CellRay::follow(cells, scene, clip, ray));
  return pick(ray, on_ray, on_ray.layers_of_contours(), scene, surfaces, clip);
}

}  // namespace splatvol
