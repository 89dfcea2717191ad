#include "builder/pipeline/describe.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "base/json.h"
#include "builder/reduction/clusters.h"

namespace splatvol {
namespace {

// A unit of "U" holds for "U[0]" too, unless this has one of its own.
void set_units(const std::vector<std::pair<std::string, std::string>>& units,
               std::vector<format::Attribute>& attributes) {
  for (const bool own : {false, true})
    for (const auto& [name, unit] : units)
      for (format::Attribute& attribute : attributes)
        if (own ? attribute.name == name : attribute.name.starts_with(name + "[")) attribute.unit = unit;
}

}  // namespace

format::VolumeInfo describe_volume(const BuildOptions& options, const Cube& cube,
                                   std::vector<format::Attribute> attributes) {
  using format::ColumnKind;
  using format::ColumnScope;
  format::VolumeInfo info;
  info.cube = cube;
  info.reduction_method = reduction_name(options.reduction);
  info.leaf_points = options.leaf_points;
  info.up = options.up;
  info.size_bounds = {"octant", "moments"};  // as IndexStream has them
  info.columns = {{ColumnKind::position, ColumnScope::segment, -1},
                  {ColumnKind::octant, ColumnScope::resolution, -1},
                  {ColumnKind::centroid, ColumnScope::resolution, -1},
                  {ColumnKind::moments, ColumnScope::resolution, -1}};
  for (std::size_t a = 0; a < attributes.size(); ++a) {
    info.columns.push_back({ColumnKind::value, ColumnScope::segment, static_cast<int>(a)});
    info.columns.push_back({ColumnKind::value_moments, ColumnScope::resolution, static_cast<int>(a)});
    if (options.gradients) info.columns.push_back({ColumnKind::gradient, ColumnScope::segment, static_cast<int>(a)});
  }
  info.attributes = std::move(attributes);
  set_units(options.units, info.attributes);
  return info;
}

std::string describe_provenance(const BuildOptions& options, const BuildReport& report) {
  using nlohmann::json;
  const PointCensus& census = report.points;
  const CellCensus& cells = report.cells;
  const json provenance = {{"builder", options.builder},
                           {"inputs", options.inputs},
                           {"connectivity", connectivity_name(report.connectivity)},
                           {"points",
                            {{"read", census.read},
                             {"not_finite", census.not_finite},
                             {"merged", census.merged},
                             {"coincident", census.coincident},
                             {"in_no_cell", census.in_no_cell},
                             {"left_out", census.left_out},
                             {"uncertain", report.uncertain}}},
                           {"cells",
                            {{"types", cells.cells},
                             {"tetrahedra", cells.tetrahedra},
                             {"inverted", cells.inverted},
                             {"flat", cells.flat},
                             {"without_volume", cells.without_volume},
                             {"hidden", cells.hidden},
                             {"hidden_points", cells.hidden_points},
                             {"more_nodes", cells.more_nodes},
                             {"left_out_flat", cells.left_out_flat},
                             {"non_finite", cells.non_finite},
                             {"not_star_shaped", cells.not_star_shaped}}}};
  return json_text(provenance);
}

std::string describe_step_provenance(const std::string& builder, const std::string& input) {
  return json_text(nlohmann::json{{"builder", builder}, {"inputs", {input}}});
}

}  // namespace splatvol
