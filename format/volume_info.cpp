#include "format/volume_info.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>
#include <stdexcept>
#include <utility>

#include "base/json.h"
#include "base/names.h"
#include "base/nesting.h"
#include "format/layout.h"

namespace splatvol::format {
namespace {

using nlohmann::json;

constexpr std::uint64_t max_points = (std::uint64_t{1} << 48) - 1;
constexpr int max_nesting = 32;

constexpr std::array<std::pair<ColumnKind, const char*>, 7> column_names = {{
    {ColumnKind::position, "position"},
    {ColumnKind::value, "value"},
    {ColumnKind::octant, "octant"},
    {ColumnKind::centroid, "centroid"},
    {ColumnKind::moments, "moments"},
    {ColumnKind::value_moments, "value_moments"},
    {ColumnKind::gradient, "gradient"},
}};

json number_or_null(double number) { return std::isfinite(number) ? json(number) : json(nullptr); }

// Thrown and caught within this file, like the exceptions of the JSON library.
struct RuleBroken : std::runtime_error {
  using std::runtime_error::runtime_error;
};

void require(bool condition, const std::string& what) {
  if (!condition) throw RuleBroken(what);
}

// Every value is read by one of these functions: the library converts numbers silently, and treats text as a list of
// one.

const json& member(const json& object, const char* key) {
  require(object.is_object() && object.contains(key), fmt::format("'{}' is missing", key));
  return object.at(key);
}

const json& list(const json& object, const char* key) {
  const json& node = member(object, key);
  require(node.is_array(), fmt::format("'{}' is not a list", key));
  return node;
}

std::string text(const json& object, const char* key) {
  const json& node = member(object, key);
  require(node.is_string(), fmt::format("'{}' is not text", key));
  return node.get<std::string>();
}

double finite(const json& node, const char* key) {
  require(node.is_number() && std::isfinite(node.get<double>()), fmt::format("'{}' is not a finite number", key));
  return node.get<double>();
}

double bounded(const json& node, const char* key, double largest) {
  const double number = finite(node, key);
  require(std::abs(number) <= largest, fmt::format("'{}' is beyond {:g}", key, largest));
  return number;
}

std::uint64_t whole(const json& node, const char* key, std::uint64_t least, std::uint64_t most) {
  const bool valid =
      node.is_number_unsigned() && node.get<std::uint64_t>() >= least && node.get<std::uint64_t>() <= most;
  require(valid, fmt::format("'{}' is not a whole number from {} to {}", key, least, most));
  return node.get<std::uint64_t>();
}

std::uint64_t whole_member(const json& object, const char* key, std::uint64_t least, std::uint64_t most) {
  return whole(member(object, key), key, least, most);
}

double finite_or_null(const json& object, const char* key) {
  const json& node = member(object, key);
  return node.is_null() ? std::numeric_limits<double>::quiet_NaN() : finite(node, key);
}

dvec3 read_origin(const json& node, double largest) {
  const json& list_of_three = list(node, "origin");
  require(list_of_three.size() == 3, "'origin' is not a list of three numbers");
  dvec3 origin;
  for (int axis = 0; axis < 3; ++axis)
    origin[axis] = bounded(list_of_three[static_cast<std::size_t>(axis)], "origin", largest);
  return origin;
}

Cube read_cube(const json& node) {
  Cube cube;
  cube.origin = read_origin(node, largest_length);
  cube.edge = bounded(member(node, "edge"), "edge", largest_length);
  require(cube.edge >= least_length, fmt::format("'edge' is below {:g}", least_length));
  return cube;
}

Attribute read_attribute(const json& node) {
  Attribute attribute;
  attribute.name = text(node, "name");
  attribute.unit = text(node, "unit");
  attribute.offset = bounded(member(node, "offset"), "offset", largest_value);
  attribute.scale = bounded(member(node, "scale"), "scale", largest_value);
  require(attribute.scale > 0, "'scale' is not above 0");
  attribute.min = finite_or_null(node, "min");
  attribute.max = finite_or_null(node, "max");
  attribute.missing = whole_member(node, "missing", 0, max_points);
  attribute.error = finite(member(node, "error"), "error");
  require(attribute.error >= 0, "'error' is below 0");
  const bool none = std::isnan(attribute.min) && std::isnan(attribute.max);
  require(none || attribute.min <= attribute.max, "'min' and 'max' disagree");
  const ValueBins bins = bins_of(attribute);
  require(none || (is_range(attribute.min, attribute.max) && std::abs(bins.min) <= double{largest_stored_value} &&
                   std::abs(bins.max) <= double{largest_stored_value}),
          "'min' and 'max' are out of range");
  return attribute;
}

Column read_column(const json& node, std::size_t attributes) {
  Column column;
  const std::string name = text(node, "kind");
  for (const auto& [kind, known] : column_names)
    if (name == known) column.kind = kind;
  const std::string scope = text(node, "scope");
  require(scope == "segment" || scope == "resolution", fmt::format("column scope '{}' is unknown", scope));
  column.scope = scope == "segment" ? ColumnScope::segment : ColumnScope::resolution;
  if (node.contains("attribute") && attributes > 0)
    column.attribute = static_cast<int>(whole_member(node, "attribute", 0, attributes - 1));
  require(member(node, "critical").is_boolean(), "'critical' is neither true nor false");
  if (column.kind == ColumnKind::unknown) {
    require(!node.at("critical").get<bool>(), fmt::format("column kind '{}' is unknown and critical", name));
    return column;
  }
  const bool of_attribute = column.kind == ColumnKind::value || column.kind == ColumnKind::value_moments ||
                            column.kind == ColumnKind::gradient;
  const bool of_segment =
      column.kind == ColumnKind::position || column.kind == ColumnKind::value || column.kind == ColumnKind::gradient;
  require(of_attribute == (column.attribute >= 0), fmt::format("column '{}' has the wrong attribute", name));
  require(of_segment == (column.scope == ColumnScope::segment), fmt::format("column '{}' has the wrong scope", name));
  return column;
}

std::vector<Column> read_columns(const json& nodes, std::size_t attributes) {
  std::vector<Column> columns;
  std::set<std::pair<ColumnKind, int>> seen;
  for (const json& node : nodes) {
    const Column column = read_column(node, attributes);
    require(column.kind == ColumnKind::unknown || seen.insert({column.kind, column.attribute}).second,
            "a column appears twice");
    columns.push_back(column);
  }
  return columns;
}

std::vector<Attribute> read_attributes(const json& nodes, std::uint64_t points) {
  std::vector<Attribute> attributes;
  std::vector<std::string> names;
  for (const json& node : nodes) {
    attributes.push_back(read_attribute(node));
    names.push_back(attributes.back().name);
    require(attributes.back().missing <= points, "'missing' is above the number of points");
  }
  if (const auto duplicate = find_duplicate(std::move(names)))
    throw RuleBroken(fmt::format("attribute '{}' appears twice", *duplicate));
  require(attributes.size() <= max_attributes, fmt::format("more than {} attributes", max_attributes));
  return attributes;
}

// Reads other names of attributes. All names together are unique.
std::vector<Alias> read_aliases(const json& nodes, const std::vector<Attribute>& attributes) {
  std::vector<Alias> aliases;
  std::vector<std::string> names;
  for (const Attribute& attribute : attributes) names.push_back(attribute.name);
  require(attributes.empty() ? nodes.empty() : nodes.size() <= max_attributes, "'aliases' is too long");
  for (const json& node : nodes) {
    const std::uint64_t attribute = whole_member(node, "attribute", 0, attributes.size() - 1);
    aliases.push_back({text(node, "name"), static_cast<int>(attribute)});
    names.push_back(aliases.back().name);
  }
  if (const auto duplicate = find_duplicate(std::move(names)))
    throw RuleBroken(fmt::format("alias '{}': the name appears twice", *duplicate));
  return aliases;
}

std::vector<SeriesAttribute> read_series(const json& nodes) {
  std::vector<SeriesAttribute> attributes;
  std::vector<std::string> names;
  for (const json& node : nodes) {
    attributes.push_back({text(node, "name"), text(node, "unit")});
    names.push_back(attributes.back().name);
  }
  require(!attributes.empty() && attributes.size() <= max_attributes,
          fmt::format("'series' has not 1 to {} attributes", max_attributes));
  if (const auto duplicate = find_duplicate(std::move(names)))
    throw RuleBroken(fmt::format("attribute '{}' appears twice", *duplicate));
  return attributes;
}

std::vector<std::uint64_t> read_counts(const json& nodes) {
  std::vector<std::uint64_t> counts;
  require(!nodes.empty() && nodes.size() <= max_resolutions,
          fmt::format("'resolution_counts' has not 1 to {} entries", max_resolutions));
  for (const json& node : nodes) {
    const std::uint64_t least = counts.empty() ? 1 : counts.back() + 1;
    counts.push_back(whole(node, "resolution_counts", least, max_points));
  }
  return counts;
}

std::vector<std::uint32_t> read_points_per_chunk(const json& nodes, std::size_t segments) {
  require(nodes.size() == segments,
          fmt::format("'points_per_chunk' has {} entries for {} segments", nodes.size(), segments));
  std::vector<std::uint32_t> points;
  for (const json& node : nodes)
    points.push_back(
        static_cast<std::uint32_t>(whole(node, "points_per_chunk", min_points_per_chunk, max_points_per_chunk)));
  return points;
}

// Positions beyond this magnitude are no positions of a mesh (is_usable_position).
constexpr double largest_position = 1e50;

PatchInfo read_patch(const json& node) {
  constexpr std::uint64_t most = std::numeric_limits<std::uint32_t>::max() / patch_element_bytes;
  PatchInfo patch{text(node, "name"), whole_member(node, "points", 0, most), whole_member(node, "triangles", 0, most)};
  require(patch.points <= 3 * patch.triangles && patch.points + patch.triangles <= most,
          fmt::format("patch '{}' has too many points", patch.name));
  return patch;
}

BoundaryInfo read_boundary(const json& node) {
  BoundaryInfo boundary;
  boundary.origin = read_origin(node, largest_position);
  boundary.quantisation_step = bounded(member(node, "quantisation_step"), "quantisation_step", largest_position);
  boundary.error = bounded(member(node, "error"), "error", largest_length);
  require(boundary.quantisation_step >= 0 && boundary.error >= 0, "'boundary' has a number below 0");
  const json& patches = list(node, "patches");
  require(!patches.empty() && patches.size() <= max_patches,
          fmt::format("'patches' has not 1 to {} entries", max_patches));
  std::vector<std::string> names;
  for (const json& patch : patches) {
    boundary.patches.push_back(read_patch(patch));
    names.push_back(boundary.patches.back().name);
  }
  if (const auto duplicate = find_duplicate(std::move(names)))
    throw RuleBroken(fmt::format("patch '{}' appears twice", *duplicate));
  return boundary;
}

int read_axis(const std::string& name) {
  require(name == "x" || name == "y" || name == "z", "'up' is none of x, y, z");
  return name[0] - 'x';
}

VolumeInfo read_info(const json& root) {
  VolumeInfo info;
  info.cube = read_cube(member(root, "cube"));
  info.resolution_counts = read_counts(list(root, "resolution_counts"));
  info.points_per_chunk = read_points_per_chunk(list(root, "points_per_chunk"), info.resolutions());
  info.rows_per_directory_page = static_cast<std::uint32_t>(whole_member(root, "rows_per_directory_page", 1, 1u << 24));
  const json& reduction = member(root, "reduction");
  info.reduction_method = text(reduction, "method");
  info.leaf_points =
      static_cast<std::uint32_t>(whole_member(reduction, "leaf_points", 1, std::numeric_limits<std::uint32_t>::max()));

  info.attributes = read_attributes(list(root, "attributes"), info.point_count());
  if (root.contains("aliases")) info.aliases = read_aliases(list(root, "aliases"), info.attributes);
  info.columns = read_columns(list(root, "columns"), info.attributes.size());
  info.position_error = finite(member(root, "position_error"), "position_error");
  require(info.position_error >= 0, "'position_error' is below 0");
  require(info.find_column(ColumnKind::position) >= 0, "'columns' has no position");
  if (root.contains("series")) {
    info.series = read_series(list(root, "series"));
    require(info.attributes.empty(), "a series has attributes besides those of its steps");
  }

  info.size_bounds.clear();
  for (const json& node : list(root, "size_bounds")) {
    require(node.is_string(), "'size_bounds' is not a list of names");
    info.size_bounds.push_back(node.get<std::string>());
  }
  require(info.size_bounds.size() <= max_size_bounds, fmt::format("more than {} size bounds", max_size_bounds));
  require(member(root, "provenance").is_object(), "'provenance' is not an object");
  info.provenance = json_text(root.at("provenance"));
  if (root.contains("boundary")) info.boundary = read_boundary(root.at("boundary"));
  if (root.contains("up")) info.up = read_axis(text(root, "up"));
  return info;
}

// (The library's own hook for such checks takes time in proportion to the square of a list's length.)
json parse_shallow(const std::string& text) {
  require(!is_nested_deeper(text, max_nesting), fmt::format("nested deeper than {} levels", max_nesting));
  return parse_json(text);
}

json to_json(const Attribute& attribute) {
  return {{"name", attribute.name},
          {"unit", attribute.unit},
          {"offset", attribute.offset},
          {"scale", attribute.scale},
          {"min", number_or_null(attribute.min)},
          {"max", number_or_null(attribute.max)},
          {"missing", attribute.missing},
          {"error", attribute.error}};
}

json to_json(const Column& column) {
  require(column.kind != ColumnKind::unknown, "a column of unknown kind cannot be written");
  json node = {{"kind", column_kind_name(column.kind)},
               {"scope", column.scope == ColumnScope::segment ? "segment" : "resolution"},
               {"critical", column.kind == ColumnKind::position}};
  if (column.attribute >= 0) node["attribute"] = column.attribute;
  return node;
}

json to_json(const BoundaryInfo& boundary) {
  json root = {{"origin", {boundary.origin.x, boundary.origin.y, boundary.origin.z}},
               {"quantisation_step", boundary.quantisation_step},
               {"error", boundary.error},
               {"patches", json::array()}};
  for (const PatchInfo& patch : boundary.patches)
    root["patches"].push_back({{"name", patch.name}, {"points", patch.points}, {"triangles", patch.triangles}});
  return root;
}

json to_json(const StepInfo& step) {
  json root = {{"time", step.time},
               {"attributes", json::array()},
               {"columns", json::array()},
               {"rows_per_directory_page", step.rows_per_directory_page},
               {"provenance", parse_shallow(step.provenance)}};
  for (const Attribute& attribute : step.attributes) root["attributes"].push_back(to_json(attribute));
  for (const Column& column : step.columns) root["columns"].push_back(to_json(column));
  return root;
}

StepInfo read_step(const json& root, const VolumeInfo& info) {
  StepInfo step;
  step.time = bounded(member(root, "time"), "time", largest_time);
  step.attributes = read_attributes(list(root, "attributes"), info.point_count());
  require(info.series.has_value() && std::ranges::equal(step.attributes, *info.series,
                                                        [](const Attribute& a, const SeriesAttribute& b) {
                                                          return a.name == b.name && a.unit == b.unit;
                                                        }),
          "the attributes are not those of the series");
  step.columns = read_columns(list(root, "columns"), step.attributes.size());
  for (const Column& column : step.columns)
    require(column.kind == ColumnKind::unknown || column.attribute >= 0, "a step has a column without an attribute");
  step.rows_per_directory_page = static_cast<std::uint32_t>(whole_member(root, "rows_per_directory_page", 1, 1u << 24));
  require(member(root, "provenance").is_object(), "'provenance' is not an object");
  step.provenance = json_text(root.at("provenance"));
  return step;
}

json to_json(const VolumeInfo& info) {
  json root;
  root["cube"] = {{"origin", {info.cube.origin.x, info.cube.origin.y, info.cube.origin.z}}, {"edge", info.cube.edge}};
  root["resolution_counts"] = info.resolution_counts;
  root["points_per_chunk"] = info.points_per_chunk;
  root["rows_per_directory_page"] = info.rows_per_directory_page;
  root["reduction"] = {{"method", info.reduction_method}, {"leaf_points", info.leaf_points}};
  root["position_error"] = info.position_error;
  root["attributes"] = json::array();
  for (const Attribute& attribute : info.attributes) root["attributes"].push_back(to_json(attribute));
  for (const Alias& alias : info.aliases)
    root["aliases"].push_back({{"name", alias.name}, {"attribute", alias.attribute}});
  root["columns"] = json::array();
  for (const Column& column : info.columns) root["columns"].push_back(to_json(column));
  root["size_bounds"] = info.size_bounds;
  root["provenance"] = parse_shallow(info.provenance);
  if (info.boundary) root["boundary"] = to_json(*info.boundary);
  require(info.up >= -1 && info.up < 3, "'up' is no axis");
  if (info.up >= 0) root["up"] = std::string(1, "xyz"[info.up]);
  if (!info.series) return root;
  root["series"] = json::array();
  for (const SeriesAttribute& attribute : *info.series)
    root["series"].push_back({{"name", attribute.name}, {"unit", attribute.unit}});
  return root;
}

tl::unexpected<Error> bad_metadata(ErrorCode code, const std::exception& error) {
  return fail(code, "metadata: {} [R9]", error.what());
}

}  // namespace

const char* column_kind_name(ColumnKind kind) {
  const auto found = std::ranges::find(column_names, kind, &std::pair<ColumnKind, const char*>::first);
  return found == column_names.end() ? "unknown" : found->second;
}

int VolumeInfo::find_column(ColumnKind kind, int attribute) const {
  const auto found =
      std::ranges::find_if(columns, [&](const Column& c) { return c.kind == kind && c.attribute == attribute; });
  return found == columns.end() ? -1 : static_cast<int>(found - columns.begin());
}

int VolumeInfo::find_attribute(const std::string& name) const {
  const auto found = std::ranges::find(attributes, name, &Attribute::name);
  if (found != attributes.end()) return static_cast<int>(found - attributes.begin());
  const auto alias = std::ranges::find(aliases, name, &Alias::name);
  return alias == aliases.end() ? -1 : alias->attribute;
}

std::uint64_t VolumeInfo::largest_group() const {
  std::uint64_t largest = 0, begin = 0;
  for (std::size_t s = 0; s < resolutions(); begin = resolution_counts[s++])
    largest = std::max(largest, std::min<std::uint64_t>(points_per_chunk[s], resolution_counts[s] - begin));
  return largest;
}

Result<int> find_attribute(const VolumeInfo& info, const std::string& name, const std::string& file_name) {
  const int index = info.find_attribute(name);
  if (index >= 0) return index;
  std::vector<std::string> names;
  for (const Attribute& attribute : info.attributes) names.push_back(attribute.name);
  for (const Alias& alias : info.aliases) names.push_back(alias.name);
  return fail_no_attribute(file_name, name, names);
}

Result<std::string> metadata_to_json(const VolumeInfo& info) {
  try {
    // Names come from input files and may not be UTF-8.
    std::string text = json_text(to_json(info));
    read_info(parse_shallow(text));
    return text;
  } catch (const std::exception& error) {
    return bad_metadata(ErrorCode::invalid_argument, error);
  }
}

Result<VolumeInfo> metadata_from_json(const std::string& text) {
  try {
    return read_info(parse_shallow(text));
  } catch (const std::exception& error) {
    return bad_metadata(ErrorCode::invalid_data, error);
  }
}

Result<std::string> step_to_json(const StepInfo& step, const VolumeInfo& info) {
  try {
    std::string text = json_text(to_json(step));
    read_step(parse_shallow(text), info);
    return text;
  } catch (const std::exception& error) {
    return bad_metadata(ErrorCode::invalid_argument, error);
  }
}

Result<StepInfo> step_from_json(const std::string& text, const VolumeInfo& info) {
  try {
    return read_step(parse_shallow(text), info);
  } catch (const std::exception& error) {
    return bad_metadata(ErrorCode::invalid_data, error);
  }
}

VolumeInfo at_step(VolumeInfo info, const StepInfo& step) {
  info.attributes = step.attributes;
  info.columns.insert(info.columns.end(), step.columns.begin(), step.columns.end());
  return info;
}

RowLayout::RowLayout(const VolumeInfo& info, const StepInfo& step)
    : RowLayout([&] {
        VolumeInfo of_step = info;
        of_step.columns = step.columns;
        of_step.rows_per_directory_page = step.rows_per_directory_page;
        return of_step;
      }()) {}

RowLayout::RowLayout(const VolumeInfo& info)
    : counts_(info.resolution_counts),
      points_per_chunk_(info.points_per_chunk),
      rows_per_page_(info.rows_per_directory_page),
      first_group_{0},
      first_row_{0} {
  std::uint64_t begin = 0;
  for (std::size_t s = 0; s < counts_.size(); ++s) {
    const std::uint64_t points = points_per_chunk_[s];
    first_group_.push_back(first_group_.back() + (counts_[s] - begin + points - 1) / points);
    first_row_.push_back(first_row_.back() + first_group_.back());
    begin = counts_[s];
  }
  for (int c = 0; c < static_cast<int>(info.columns.size()); ++c) {
    all_columns_.push_back(c);
    if (info.columns[static_cast<std::size_t>(c)].scope == ColumnScope::resolution) resolution_columns_.push_back(c);
  }
}

Group RowLayout::group(std::uint64_t index) const {
  const auto next = std::ranges::upper_bound(first_group_, index);
  const auto segment = static_cast<std::size_t>(next - first_group_.begin()) - 1;
  const std::uint64_t segment_begin = segment == 0 ? 0 : counts_[segment - 1];
  const std::uint64_t begin = segment_begin + (index - first_group_[segment]) * points_per_chunk_[segment];
  return {segment, begin,
          static_cast<std::uint32_t>(std::min<std::uint64_t>(points_per_chunk_[segment], counts_[segment] - begin))};
}

std::size_t RowLayout::resolution_of_row(std::uint64_t row) const {
  return static_cast<std::size_t>(std::ranges::upper_bound(first_row_, row) - first_row_.begin()) - 1;
}

const std::vector<int>& RowLayout::columns_of_row(std::uint64_t row) const {
  const std::size_t resolution = resolution_of_row(row);
  return row - first_row_[resolution] >= first_group_[resolution] ? all_columns_ : resolution_columns_;
}

std::uint64_t RowLayout::chunks_before(std::uint64_t row) const {
  if (row == 0) return 0;
  // In a resolution, the groups of coarser segments come first; their rows have fewer columns.
  std::uint64_t chunks = 0;
  for (std::size_t r = 0; r < counts_.size() && row > first_row_[r]; ++r) {
    const std::uint64_t rows = std::min(row, first_row_[r + 1]) - first_row_[r];
    const std::uint64_t of_coarser = std::min(rows, first_group_[r]);
    chunks += of_coarser * resolution_columns_.size() + (rows - of_coarser) * all_columns_.size();
  }
  return chunks;
}

std::uint64_t RowLayout::directory_page_count() const { return (row_count() + rows_per_page_ - 1) / rows_per_page_; }

std::uint64_t RowLayout::chunks_of_directory_page(std::uint64_t page) const {
  const std::uint64_t first = first_row_of_directory_page(page);
  return chunks_before(std::min(row_count(), first + rows_per_page_)) - chunks_before(first);
}

}  // namespace splatvol::format
