#include "builder/describe.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "builder/reduction/clusters.h"

namespace splatvol {

format::VolumeInfo describe_volume(const BuildOptions& options, const Cube& cube,
                                   std::vector<format::Attribute> attributes) {
  using format::ColumnKind;
  using format::ColumnScope;
  format::VolumeInfo info;
  info.cube = cube;
  info.points_per_chunk = options.points_per_chunk;
  info.reduction_method = reduction_name(options.reduction);
  info.leaf_points = options.leaf_points;
  info.size_bounds = {"octant", "moments"};  // as IndexStream has them
  info.columns = {{ColumnKind::position, ColumnScope::segment, -1},
                  {ColumnKind::octant, ColumnScope::resolution, -1},
                  {ColumnKind::centroid, ColumnScope::resolution, -1},
                  {ColumnKind::moments, ColumnScope::resolution, -1}};
  for (std::size_t a = 0; a < attributes.size(); ++a) {
    info.columns.push_back({ColumnKind::value, ColumnScope::segment, static_cast<int>(a)});
    info.columns.push_back({ColumnKind::value_moments, ColumnScope::resolution, static_cast<int>(a)});
    info.columns.push_back({ColumnKind::gradient, ColumnScope::segment, static_cast<int>(a)});
  }
  info.attributes = std::move(attributes);
  return info;
}

std::string describe_provenance(const BuildOptions& options, const BuildReport& report) {
  using nlohmann::json;
  const PointCensus& census = report.points;
  const CellCensus& cells = report.cells;
  json provenance = {{"builder", options.builder},
                     {"inputs", options.inputs},
                     {"connectivity", connectivity_name(report.connectivity)},
                     {"points",
                      {{"read", census.read},
                       {"not_finite", census.not_finite},
                       {"merged", census.merged},
                       {"coincident", census.coincident},
                       {"in_no_cell", census.in_no_cell},
                       {"uncertain", report.uncertain}}},
                     {"cells",
                      {{"types", cells.cells},
                       {"tetrahedra", cells.tetrahedra},
                       {"inverted", cells.inverted},
                       {"flat", cells.flat},
                       {"without_volume", cells.without_volume},
                       {"hidden", cells.hidden},
                       {"non_finite", cells.non_finite},
                       {"not_star_shaped", cells.not_star_shaped}}}};
  if (cells.left_out_flat > 0) provenance["cells"]["left_out_flat"] = cells.left_out_flat;
  return provenance.dump(-1, ' ', false, json::error_handler_t::replace);
}

}  // namespace splatvol
