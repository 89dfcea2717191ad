#include "builder/mesh/cell_census.h"

namespace splatvol {

CellCensus& CellCensus::operator+=(const CellCensus& other) {
  for (const auto& [name, count] : other.cells) cells[name] += count;
  tetrahedra += other.tetrahedra;
  inverted += other.inverted;
  flat += other.flat;
  without_volume += other.without_volume;
  hidden += other.hidden;
  left_out_flat += other.left_out_flat;
  non_finite += other.non_finite;
  not_star_shaped += other.not_star_shaped;
  return *this;
}

}  // namespace splatvol
