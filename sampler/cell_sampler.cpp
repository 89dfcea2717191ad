#include "sampler/cell_sampler.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>

#include "sampler/box_tree.h"
#include "sampler/tetrahedron.h"

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

// Values at positions, from the cells that were looked at so far.
class Samples {
 public:
  Samples(const CellTetrahedra& cells, std::span<const dvec3> positions, double reach)
      : cells_(cells),
        reach_(reach),
        positions_(positions),
        tree_(positions),
        values_(positions.size(), std::numeric_limits<double>::quiet_NaN()),
        distances_(positions.size(), infinity) {}

  // The value of a position in a chunk of cells.
  struct Found {
    std::uint32_t position;
    double value = 0, distance = infinity;  // from the cell
  };

  // Whether positions that no cell before has are in a box, or so near.
  [[nodiscard]] bool has_any_in(Box box, double reach) const {
    widen(box, reach);
    bool has_any = false;
    tree_.visit_near(box, [&](std::uint32_t i) { has_any = has_any || is_open_in(box, i); });
    return has_any;
  }

  // Finds such positions in the tetrahedra of a chunk, or those on which they come to lie `with_reach`. Thread-safe.
  [[nodiscard]] std::vector<Found> find(Box box, const Tetrahedra& tetrahedra, bool with_reach) const {
    widen(box, with_reach ? std::max(cells_.reach(), reach_) : 0);
    std::vector<Found> all;
    tree_.visit_near(box, [&](std::uint32_t i) {
      if (is_open_in(box, i)) all.push_back({i});
    });
    visit_cells(tetrahedra, with_reach, all);
    std::erase_if(all, [](const Found& found) { return found.distance == infinity; });
    return all;
  }

  // Takes what was found in a chunk, chunk by chunk.
  void take(std::span<const Found> all) {
    for (const Found& found : all) {
      if (!(found.distance < distances_[found.position])) continue;
      distances_[found.position] = found.distance;
      values_[found.position] = found.value;
    }
  }

  [[nodiscard]] std::vector<double> values() && { return std::move(values_); }

 private:
  static void widen(Box& box, double reach) {
    box.low -= reach;
    box.high += reach;
  }
  static bool is_in(const Box& box, const dvec3& position) { return squared_distance(box, position) == 0; }
  [[nodiscard]] bool is_open_in(const Box& box, std::uint32_t position) const {
    return distances_[position] > 0 && is_in(box, positions_[position]);
  }

  void visit_cells(const Tetrahedra& tetrahedra, bool with_reach, std::vector<Found>& all) const {
    std::vector<dvec3> positions;
    for (const Found& found : all) positions.push_back(positions_[found.position]);
    const BoxTree tree(positions);
    for (std::size_t t = 0; t < tetrahedra.size() && !tree.empty(); ++t) {
      const std::array<double, 4> values = tetrahedra.values_of(t, 0);
      if (std::isnan(values[0] + values[1] + values[2] + values[3])) continue;
      const TetrahedronCorners corners = tetrahedra.corners_of(t);
      Box around;
      for (const dvec3& corner : corners) around.include(corner);
      const double reach = with_reach ? std::max(cells_.reach(around), reach_) : 0;
      widen(around, reach);
      tree.visit_near(around, [&](std::uint32_t i) {
        if (!(all[i].distance > 0) || !is_in(around, positions[i])) return;
        if (with_reach)
          take_nearest(nearest_on(corners, positions[i], reach), values, all[i]);
        else if (const auto weights = weights_in(corners, positions[i]))
          all[i] = {all[i].position, value_at(values, *weights), 0};
      });
    }
  }

  static void take_nearest(const std::optional<SurfacePoint>& nearest, const std::array<double, 4>& values,
                           Found& found) {
    if (nearest && nearest->distance < found.distance)
      found = {found.position, value_at(values, nearest->weights), nearest->distance};
  }

  const CellTetrahedra& cells_;
  double reach_;  // at least
  std::span<const dvec3> positions_;
  BoxTree tree_;
  std::vector<double> values_;     // [position]
  std::vector<double> distances_;  // [position]: from the cell that has the value; infinity: none
};

}  // namespace

Result<std::vector<double>> sample_cells(const CellTetrahedra& cells, std::span<const dvec3> positions, double reach) {
  Samples samples(cells, positions, reach);
  // Mostly, all positions are in cells, or far from all. Those that rounding may have moved out of cells are left for
  // another pass, which reads the chunks round them.
  using Part = std::vector<Samples::Found>;
  for (const bool with_reach : {false, true}) {
    const double beside = with_reach ? std::max(cells.reach(), reach) : 0;
    SPLATVOL_TRY_ASSIGN(chunks, cells.chunks([&](const Box& box) { return samples.has_any_in(box, beside); }));
    SPLATVOL_TRY(cells.for_each<Part>(
        chunks,
        [&](const format::CellChunkEntry& entry, const Tetrahedra& tetrahedra, Part& part) -> Status {
          part = samples.find(box_of_cells(entry), tetrahedra, with_reach);
          return {};
        },
        [&](const format::CellChunkEntry& /*entry*/, const Part& part) -> Status {
          samples.take(part);
          return {};
        }));
  }
  return std::move(samples).values();
}

}  // namespace splatvol
