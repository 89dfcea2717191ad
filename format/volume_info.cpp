#include "format/volume_info.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <iterator>
#include <new>
#include <nlohmann/json.hpp>
#include <numeric>
#include <set>
#include <system_error>
#include <utility>

#include "base/json.h"
#include "base/names.h"
#include "format/layout.h"

namespace splatvol::format {
namespace {

using nlohmann::json;

constexpr std::uint64_t max_points = (std::uint64_t{1} << 48) - 1;
constexpr int max_nesting = 32;
constexpr const char* cells_key = "cells";

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

Result<double> not_negative(const JsonField& field, double largest = std::numeric_limits<double>::infinity()) {
  SPLATVOL_TRY_ASSIGN(number, field.number(largest));
  if (number < 0) return field.wrong("below 0");
  return number;
}

Result<dvec3> read_origin(const JsonField& field, double largest) {
  SPLATVOL_TRY_ASSIGN(origin, field.numbers(3, largest));
  return dvec3(origin[0], origin[1], origin[2]);
}

Result<Cube> read_cube(const JsonField& node) {
  Cube cube;
  SPLATVOL_TRY_SET(cube.origin, read_origin(node.member("origin"), largest_length));
  SPLATVOL_TRY_SET(cube.edge, node.member("edge").number(largest_length));
  if (!(cube.edge >= least_length)) return node.member("edge").wrong("below {}", least_length);
  return cube;
}

Result<Attribute> read_attribute(const JsonField& node, std::uint64_t points) {
  Attribute attribute;
  SPLATVOL_TRY_SET(attribute.name, node.member("name").text());
  SPLATVOL_TRY_SET(attribute.unit, node.member("unit").text());
  SPLATVOL_TRY_SET(attribute.offset, node.member("offset").number(largest_value));
  SPLATVOL_TRY_SET(attribute.scale, node.member("scale").number(largest_value));
  if (!(attribute.scale > 0)) return node.member("scale").wrong("not above 0");
  SPLATVOL_TRY_SET(attribute.min, node.member("min").number_or_nan());
  SPLATVOL_TRY_SET(attribute.max, node.member("max").number_or_nan());
  SPLATVOL_TRY_SET(attribute.missing, node.member("missing").whole(std::uint64_t{0}, points));
  SPLATVOL_TRY_SET(attribute.error, not_negative(node.member("error")));
  if (std::isnan(attribute.min) && std::isnan(attribute.max)) return attribute;
  if (!(attribute.min <= attribute.max)) return node.wrong("min and max disagree");
  const ValueBins bins = bins_of(attribute);
  if (!is_range(attribute.min, attribute.max) || !(std::abs(bins.min) <= double{largest_stored_value}) ||
      !(std::abs(bins.max) <= double{largest_stored_value}))
    return node.wrong("min and max are out of range");
  return attribute;
}

Result<Column> read_column(const JsonField& node, std::size_t attributes) {
  Column column;
  SPLATVOL_TRY_ASSIGN(name, node.member("kind").text());
  for (const auto& [kind, known] : column_names)
    if (name == known) column.kind = kind;
  SPLATVOL_TRY_ASSIGN(scope, node.member("scope").text());
  if (scope != "segment" && scope != "resolution") return node.member("scope").wrong("'{}' is unknown", scope);
  column.scope = scope == "segment" ? ColumnScope::segment : ColumnScope::resolution;
  if (node.has("attribute") && attributes > 0)
    SPLATVOL_TRY_SET(column.attribute, node.member("attribute").whole(0, static_cast<int>(attributes - 1)));
  SPLATVOL_TRY_ASSIGN(critical, node.member("critical").truth());
  if (column.kind == ColumnKind::unknown) {
    if (critical) return node.member("kind").wrong("'{}' is unknown and critical", name);
    return column;
  }
  const bool of_attribute = column.kind == ColumnKind::value || column.kind == ColumnKind::value_moments ||
                            column.kind == ColumnKind::gradient;
  const bool of_segment =
      column.kind == ColumnKind::position || column.kind == ColumnKind::value || column.kind == ColumnKind::gradient;
  if (of_attribute != (column.attribute >= 0)) return node.wrong("'{}' has the wrong attribute", name);
  if (of_segment != (column.scope == ColumnScope::segment)) return node.wrong("'{}' has the wrong scope", name);
  return column;
}

Result<std::vector<Column>> read_columns(const JsonField& nodes, std::size_t attributes) {
  SPLATVOL_TRY_ASSIGN(columns, nodes.each([&](const JsonField& node) { return read_column(node, attributes); }));
  std::set<std::pair<ColumnKind, int>> seen;
  for (std::size_t i = 0; i < columns.size(); ++i)
    if (columns[i].kind != ColumnKind::unknown && !seen.insert({columns[i].kind, columns[i].attribute}).second)
      return nodes.element(i).wrong("a column appears twice");
  return columns;
}

template <class... Named>
Status check_names_differ(const JsonField& nodes, const std::vector<Named>&... named) {
  std::vector<std::string> names;
  (std::ranges::transform(named, std::back_inserter(names), &Named::name), ...);
  if (const auto duplicate = find_duplicate(std::move(names))) return nodes.wrong("'{}' appears twice", *duplicate);
  return {};
}

// Reads a list whose elements have different names.
template <class Read>
auto read_named(const JsonField& nodes, std::size_t least, std::size_t most, const Read& read)
    -> decltype(nodes.each(read)) {
  if (nodes.size() < least || nodes.size() > most) return nodes.wrong("not a list of {} to {} entries", least, most);
  SPLATVOL_TRY_ASSIGN(all, nodes.each(read));
  SPLATVOL_TRY(check_names_differ(nodes, all));
  return all;
}

Result<std::vector<Attribute>> read_attributes(const JsonField& nodes, std::uint64_t points) {
  return read_named(nodes, 0, max_attributes, [&](const JsonField& node) { return read_attribute(node, points); });
}

// Reads other names of attributes. All names together are unique.
Result<std::vector<Alias>> read_aliases(const JsonField& nodes, const std::vector<Attribute>& attributes) {
  if (nodes.size() > (attributes.empty() ? 0 : max_attributes)) return nodes.wrong("too long");
  SPLATVOL_TRY_ASSIGN(aliases, nodes.each([&](const JsonField& node) -> Result<Alias> {
    Alias alias;
    SPLATVOL_TRY_SET(alias.attribute, node.member("attribute").whole(0, static_cast<int>(attributes.size() - 1)));
    SPLATVOL_TRY_SET(alias.name, node.member("name").text());
    return alias;
  }));
  SPLATVOL_TRY(check_names_differ(nodes, attributes, aliases));
  return aliases;
}

Result<SeriesAttribute> read_series_attribute(const JsonField& node) {
  SeriesAttribute attribute;
  SPLATVOL_TRY_SET(attribute.name, node.member("name").text());
  SPLATVOL_TRY_SET(attribute.unit, node.member("unit").text());
  return attribute;
}

Result<std::vector<std::uint64_t>> read_counts(const JsonField& nodes) {
  if (nodes.size() < 1 || nodes.size() > max_resolutions) return nodes.wrong("not a list of 1 to {}", max_resolutions);
  std::uint64_t last = 0;
  return nodes.each([&](const JsonField& node) {
    auto count = node.whole(last + 1, max_points);
    last = count.value_or(0);
    return count;
  });
}

Result<std::vector<std::uint32_t>> read_points_per_chunk(const JsonField& nodes, std::size_t segments) {
  if (nodes.size() != segments) return nodes.wrong("{} entries for {} segments", nodes.size(), segments);
  return nodes.each([](const JsonField& node) { return node.whole(min_points_per_chunk, max_points_per_chunk); });
}

// Positions beyond this magnitude are no positions of a mesh (is_usable_position).
constexpr double largest_position = 1e50;

Result<PatchInfo> read_patch(const JsonField& node) {
  constexpr std::uint64_t most = std::numeric_limits<std::uint32_t>::max() / patch_element_bytes;
  PatchInfo patch;
  SPLATVOL_TRY_SET(patch.name, node.member("name").text());
  SPLATVOL_TRY_SET(patch.points, node.member("points").whole(std::uint64_t{0}, most));
  SPLATVOL_TRY_SET(patch.triangles, node.member("triangles").whole(std::uint64_t{0}, most));
  if (patch.points > 3 * patch.triangles || patch.points + patch.triangles > most)
    return node.wrong("'{}' has too many points", patch.name);
  if (node.has("two_sided"))
    SPLATVOL_TRY_SET(patch.two_sided, node.member("two_sided").whole(std::uint64_t{0}, patch.triangles));
  return patch;
}

Result<BoundaryInfo> read_boundary(const JsonField& node) {
  BoundaryInfo boundary;
  SPLATVOL_TRY_SET(boundary.origin, read_origin(node.member("origin"), largest_position));
  SPLATVOL_TRY_SET(boundary.quantisation_step, not_negative(node.member("quantisation_step"), largest_position));
  SPLATVOL_TRY_SET(boundary.error, not_negative(node.member("error"), largest_length));
  SPLATVOL_TRY_SET(boundary.patches, read_named(node.member("patches"), 1, max_patches, read_patch));
  return boundary;
}

Result<CellsInfo> read_cells(const JsonField& node, bool is_series) {
  const JsonField field = node.member("hash");
  SPLATVOL_TRY_ASSIGN(text, field.text());
  CellsInfo cells;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), cells.hash, 16);
  if (text.size() != 16 || error != std::errc{} || end != text.data() + text.size())
    return field.wrong("not 16 hexadecimal digits");
  if (!node.has("copies")) return cells;
  const JsonField copies = node.member("copies");
  if (!is_series) return copies.wrong("only a series has it");
  SPLATVOL_TRY_ASSIGN(rule, copies.text());
  if (rule != "block") return copies.wrong("'{}' is unknown", rule);
  cells.blocks_apart = true;
  return cells;
}

Result<int> read_up(const JsonField& field) {
  SPLATVOL_TRY_ASSIGN(name, field.text());
  if (name != "x" && name != "y" && name != "z") return field.wrong("none of x, y, z");
  return name[0] - 'x';
}

Result<std::uint32_t> read_rows_per_page(const JsonField& root) {
  return root.member("rows_per_directory_page").whole(std::uint32_t{1}, std::uint32_t{1} << 24);
}

Result<std::string> read_provenance(const JsonField& root) {
  const JsonField provenance = root.member("provenance");
  if (!provenance.is_object()) return provenance.wrong("not an object");
  return provenance.json();
}

Result<VolumeInfo> read_info(const JsonField& root) {
  VolumeInfo info;
  SPLATVOL_TRY_SET(info.cube, read_cube(root.member("cube")));
  SPLATVOL_TRY_SET(info.resolution_counts, read_counts(root.member("resolution_counts")));
  SPLATVOL_TRY_SET(info.points_per_chunk, read_points_per_chunk(root.member("points_per_chunk"), info.resolutions()));
  SPLATVOL_TRY_SET(info.rows_per_directory_page, read_rows_per_page(root));
  const JsonField reduction = root.member("reduction");
  SPLATVOL_TRY_SET(info.reduction_method, reduction.member("method").text());
  SPLATVOL_TRY_SET(info.leaf_points, reduction.member("leaf_points").whole(std::uint32_t{1}, ~std::uint32_t{0}));

  SPLATVOL_TRY_SET(info.attributes, read_attributes(root.member("attributes"), info.point_count()));
  if (root.has("aliases")) SPLATVOL_TRY_SET(info.aliases, read_aliases(root.member("aliases"), info.attributes));
  SPLATVOL_TRY_SET(info.columns, read_columns(root.member("columns"), info.attributes.size()));
  SPLATVOL_TRY_SET(info.position_error, not_negative(root.member("position_error")));
  if (info.find_column(ColumnKind::position) < 0) return root.member("columns").wrong("no position");
  if (const JsonField series = root.member("series"); series.exists()) {
    SPLATVOL_TRY_SET(info.series, read_named(series, 1, max_attributes, read_series_attribute));
    if (!info.attributes.empty()) return root.member("attributes").wrong("a series has those of its steps only");
  }

  const JsonField size_bounds = root.member("size_bounds");
  if (size_bounds.size() > max_size_bounds) return size_bounds.wrong("more than {} names", max_size_bounds);
  SPLATVOL_TRY_SET(info.size_bounds, size_bounds.each(&JsonField::text));
  SPLATVOL_TRY_SET(info.provenance, read_provenance(root));
  if (root.has("boundary")) SPLATVOL_TRY_SET(info.boundary, read_boundary(root.member("boundary")));
  if (root.has(cells_key)) SPLATVOL_TRY_SET(info.cells, read_cells(root.member(cells_key), info.series.has_value()));
  if (root.has("up")) SPLATVOL_TRY_SET(info.up, read_up(root.member("up")));
  return info;
}

template <class Read>
auto read_metadata(const std::string& text, const Read& read) -> std::invoke_result_t<Read, JsonField> try {
  auto info = read_json(text, read, max_nesting);
  if (!info) return fail(info.error().code, "metadata: {} [R9]", info.error().message);
  return info;
} catch (const std::bad_alloc&) {
  return fail(ErrorCode::out_of_budget, "metadata: no memory for them");
}

// Writes a text that `read` takes. Names come from input files and may not be UTF-8.
template <class Read>
Result<std::string> write_metadata(const json& root, const Read& read) {
  std::string text = json_text(root);
  if (const auto info = read_metadata(text, read); !info)
    return fail(ErrorCode::invalid_argument, "{}", info.error().message);
  return text;
}

// Returns null, which no reader takes, for what is no JSON.
json provenance_to_json(const std::string& text) {
  const auto document = parse_shallow_json(text, max_nesting);
  return document ? **document : json();
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
  // No reader takes unknown columns that are critical: they cannot be written.
  json node = {{"kind", column_kind_name(column.kind)},
               {"scope", column.scope == ColumnScope::segment ? "segment" : "resolution"},
               {"critical", column.kind == ColumnKind::position || column.kind == ColumnKind::unknown}};
  if (column.attribute >= 0) node["attribute"] = column.attribute;
  return node;
}

json to_json(const BoundaryInfo& boundary) {
  json root = {{"origin", {boundary.origin.x, boundary.origin.y, boundary.origin.z}},
               {"quantisation_step", boundary.quantisation_step},
               {"error", boundary.error},
               {"patches", json::array()}};
  for (const PatchInfo& patch : boundary.patches) {
    json& node = root["patches"].emplace_back(
        json{{"name", patch.name}, {"points", patch.points}, {"triangles", patch.triangles}});
    if (patch.two_sided > 0) node["two_sided"] = patch.two_sided;
  }
  return root;
}

json to_json(const CellsInfo& cells) {
  json root = {{"hash", fmt::format("{:016x}", cells.hash)}};
  if (cells.blocks_apart) root["copies"] = "block";
  return root;
}

json to_json(const StepInfo& step) {
  json root = {{"time", step.time},
               {"attributes", json::array()},
               {"columns", json::array()},
               {"rows_per_directory_page", step.rows_per_directory_page},
               {"provenance", provenance_to_json(step.provenance)}};
  for (const Attribute& attribute : step.attributes) root["attributes"].push_back(to_json(attribute));
  for (const Column& column : step.columns) root["columns"].push_back(to_json(column));
  return root;
}

Result<StepInfo> read_step(const JsonField& root, const VolumeInfo& info) {
  StepInfo step;
  SPLATVOL_TRY_SET(step.time, root.member("time").number(largest_time));
  SPLATVOL_TRY_SET(step.attributes, read_attributes(root.member("attributes"), info.point_count()));
  const auto is_same = [](const Attribute& a, const SeriesAttribute& b) {
    return a.name == b.name && a.unit == b.unit;
  };
  if (!info.series || !std::ranges::equal(step.attributes, *info.series, is_same))
    return root.member("attributes").wrong("not those of the series");
  SPLATVOL_TRY_SET(step.columns, read_columns(root.member("columns"), step.attributes.size()));
  for (const Column& column : step.columns)
    if (column.kind != ColumnKind::unknown && column.attribute < 0)
      return root.member("columns").wrong("a step has a column without an attribute");
  SPLATVOL_TRY_SET(step.rows_per_directory_page, read_rows_per_page(root));
  SPLATVOL_TRY_SET(step.provenance, read_provenance(root));
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
  root["provenance"] = provenance_to_json(info.provenance);
  if (info.boundary) root["boundary"] = to_json(*info.boundary);
  if (info.cells) root[cells_key] = to_json(*info.cells);
  if (info.up != -1) root["up"] = info.up >= 0 && info.up < 3 ? std::string(1, "xyz"[info.up]) : "no axis";
  if (!info.series) return root;
  root["series"] = json::array();
  for (const SeriesAttribute& attribute : *info.series)
    root["series"].push_back({{"name", attribute.name}, {"unit", attribute.unit}});
  return root;
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

std::size_t VolumeInfo::finest_within(std::uint64_t most_points) const {
  const auto finer = std::ranges::upper_bound(resolution_counts, most_points);
  return finer == resolution_counts.begin() ? 0 : static_cast<std::size_t>(finer - resolution_counts.begin()) - 1;
}

std::vector<std::uint64_t> VolumeInfo::segment_counts() const {
  std::vector<std::uint64_t> counts = resolution_counts;
  std::adjacent_difference(counts.begin(), counts.end(), counts.begin());
  return counts;
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

Result<std::string> metadata_to_json(const VolumeInfo& info) { return write_metadata(to_json(info), read_info); }

Result<VolumeInfo> metadata_from_json(const std::string& text) { return read_metadata(text, read_info); }

Result<std::string> step_to_json(const StepInfo& step, const VolumeInfo& info) {
  return write_metadata(to_json(step), [&](const JsonField& root) { return read_step(root, info); });
}

Result<StepInfo> step_from_json(const std::string& text, const VolumeInfo& info) {
  return read_metadata(text, [&](const JsonField& root) { return read_step(root, info); });
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
