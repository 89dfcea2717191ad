#include "streamer/cells/point_gradients.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>
#include <utility>

#include "format/part_kinds.h"

namespace splatvol {
namespace {

// The points of tetrahedra that a contour cuts.
std::vector<std::uint8_t> points_at(const Tetrahedra& cells, std::span<const double> contours) {
  std::vector<std::uint8_t> points(cells.points.size());
  const std::vector<double>& values = cells.values.front();
  for (const std::array<std::uint32_t, 4>& corners : cells.corners) {
    const auto& [a, b, c, d] = corners;
    const auto [low, high] = std::minmax({values[a], values[b], values[c], values[d]});
    const auto above = std::ranges::upper_bound(contours, low);
    if (above == contours.end() || !(*above <= high)) continue;
    for (const std::uint32_t corner : corners) points[corner] = 1;
  }
  return points;
}

std::uint64_t hash_of(std::span<const double> values) {
  std::uint64_t hash = 0;
  for (const double value : values) hash = (hash ^ std::bit_cast<std::uint64_t>(value)) * 0x9e3779b97f4a7c15u;
  return hash;
}

// Sums at points of a chunk, from the tetrahedra of several chunks. Keeps its memory from one to the next.
class SumsAtPoints {
 public:
  // `ranks`: of the points, ascending. `is_meant`: [point]; others have no sum.
  SumsAtPoints(std::span<const std::uint64_t> ranks, std::span<const std::uint8_t> is_meant)
      : ranks_(ranks), is_meant_(is_meant), sums_(ranks.size() + 1) {}

  void add(const Tetrahedra& source) {
    if (!find_places(source.ranks)) return;
    round_points_.clear();
    const auto none = static_cast<std::uint32_t>(ranks_.size());
    for (const std::array<std::uint32_t, 4>& corners : source.corners)
      if (std::ranges::any_of(corners, [&](std::uint32_t corner) { return places_[corner] != none; }))
        round_points_.push_back(corners);
    add_gradients(source.points, round_points_, source.values.front(), places_, sums_);
  }

  [[nodiscard]] std::vector<dvec3> means() const { return means_of(std::span(sums_).first(ranks_.size())); }

 private:
  // Returns whether the source has one of the points.
  bool find_places(const std::vector<std::uint64_t>& others) {
    places_.assign(others.size(), static_cast<std::uint32_t>(ranks_.size()));
    bool has_one = false;
    for (std::size_t i = 0, j = 0; i < ranks_.size() && j < others.size();) {
      const std::uint64_t rank = ranks_[i], other = others[j];
      if (rank == other && is_meant_[i] != 0) places_[j] = static_cast<std::uint32_t>(i), has_one = true;
      i += rank <= other ? 1 : 0;
      j += other <= rank ? 1 : 0;
    }
    return has_one;
  }

  std::span<const std::uint64_t> ranks_;
  std::span<const std::uint8_t> is_meant_;
  std::vector<GradientSum> sums_;
  std::vector<std::uint32_t> places_;                       // [point of the source]: as add_gradients has them
  std::vector<std::array<std::uint32_t, 4>> round_points_;  // tetrahedra of the source
};

}  // namespace

PartKey PointGradients::key_of(const format::CellChunkEntry& entry, std::uint64_t hash) const {
  const std::array attribute{static_cast<int>(cells_.attributes().front())};
  const auto column = static_cast<std::int64_t>((hash >> 21) << 20);  // not negative
  return {room_.file, hash == 0 ? format::cell_gradients : format::contour_gradients, entry.offset,
          column | format::columns_key(attribute), cells_.reader().volume().step_key()};
}

Result<PointGradients::Gradients> PointGradients::at_all(const format::CellChunkEntry& entry,
                                                         const Tetrahedra& cells) const {
  return room_.table->get<std::vector<dvec3>>(
      key_of(entry, 0), *room_.share, 0, [&] { return find(entry, cells, Points(cells.points.size(), 1)); },
      [](const std::vector<dvec3>& gradients) { return gradients.capacity() * sizeof(dvec3); });
}

Result<PointGradients::Gradients> PointGradients::at_contours(const format::CellChunkEntry& entry,
                                                              const Tetrahedra& cells,
                                                              std::span<const double> contours) const {
  if (auto all = room_.find<std::vector<dvec3>>(key_of(entry, 0))) return all;
  Points points = points_at(cells, contours);
  SPLATVOL_TRY_ASSIGN(
      known, room_.table->get<Known>(
                 key_of(entry, hash_of(contours) | 1), *room_.share, 0,
                 [&] {
                   return find(entry, cells, points).map([&](std::vector<dvec3> gradients) {
                     return Known{points, std::move(gradients)};
                   });
                 },
                 [](const Known& part) { return part.points.capacity() + part.gradients.capacity() * sizeof(dvec3); }));
  // Values may have the hash of others.
  if (known->points != points) {
    SPLATVOL_TRY_ASSIGN(gradients, find(entry, cells, points));
    return std::make_shared<const std::vector<dvec3>>(std::move(gradients));
  }
  return Gradients(known, &known->gradients);
}

Result<std::vector<format::CellChunkEntry>> PointGradients::sources_at_contours(
    const format::CellChunkEntry& entry, const Tetrahedra& cells, std::span<const double> contours) const {
  if (room_.holds(key_of(entry, 0)) || room_.holds(key_of(entry, hash_of(contours) | 1)))
    return std::vector<format::CellChunkEntry>();
  SPLATVOL_TRY_ASSIGN(sources, sources_of(entry, cells, points_at(cells, contours)));
  std::erase_if(sources, [&](const format::CellChunkEntry& source) { return source.offset == entry.offset; });
  return sources;
}

// In the order of the file.
Result<std::vector<format::CellChunkEntry>> PointGradients::sources_of(const format::CellChunkEntry& entry,
                                                                       const Tetrahedra& cells,
                                                                       const Points& points) const {
  Box box;
  std::vector<dvec3> positions;
  for (std::size_t i = 0; i < points.size(); ++i)
    if (points[i] != 0) box.include(positions.emplace_back(cells.points[i]));
  if (positions.empty()) return std::vector<format::CellChunkEntry>();
  SPLATVOL_TRY_ASSIGN(sources, cells_.chunks([&](const Box& other) { return squared_distance(box, other) == 0; }));
  std::erase_if(sources, [&](const format::CellChunkEntry& source) {
    const Box other = box_of_cells(source);
    return source.field == format::CellField::constant ||
           (source.offset != entry.offset && std::ranges::none_of(positions, [&](const dvec3& position) {
              return squared_distance(other, position) == 0;
            }));
  });
  return sources;
}

// Chunks are added in the order of the file, so that all chunks with a point get the same bits.
Result<std::vector<dvec3>> PointGradients::find(const format::CellChunkEntry& entry, const Tetrahedra& cells,
                                                const Points& points) const {
  SPLATVOL_TRY_ASSIGN(sources, sources_of(entry, cells, points));
  SumsAtPoints sums(cells.ranks, points);
  Tetrahedra scratch;
  for (const format::CellChunkEntry& source : sources) {
    SPLATVOL_TRY(check_interruption());
    const Tetrahedra* read = &cells;
    if (source.offset != entry.offset) SPLATVOL_TRY_SET(read, read_(source, scratch));
    sums.add(*read);
  }
  return sums.means();
}

}  // namespace splatvol
