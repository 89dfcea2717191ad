#include "builder/build.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "builder/index_builder.h"
#include "builder/reduction.h"
#include "format/volume_writer.h"

namespace splatvol {
namespace {

using nlohmann::json;

constexpr std::size_t rows_in_flight = 64;  // packed in parallel, then appended in order

// A position may move by this share of the local spacing: a splat's smallest principal deviation is about a quarter of
// the cells' height, and the error is to stay under 1/64 of it.
constexpr double error_per_spacing = 1.0 / 256;

// Single precision loses the detail of a narrow range far from zero (pressures round 101325 Pa); an offset keeps it.
double choose_offset(double low, double high) {
  const double largest = std::max(std::abs(low), std::abs(high));
  const bool fine = largest * std::exp2(-24) <= (high - low) * std::exp2(-16);
  return largest == 0 || fine ? 0.0 : low + (high - low) / 2;
}

// What single precision cannot hold is taken for the fill value of a program, that is for missing.
bool is_present(double value) { return std::abs(value) <= std::numeric_limits<float>::max(); }

StoredAttribute store_attribute(const std::string& name, const std::vector<double>& values) {
  StoredAttribute stored;
  format::Attribute& description = stored.description;
  description.name = name;
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const double value : values) {
    if (!is_present(value)) continue;
    low = std::min(low, value);
    high = std::max(high, value);
  }
  const bool any = low <= high;
  if (any) description.offset = choose_offset(low, high);

  const auto store = [&](double value) { return static_cast<float>(value - description.offset); };
  stored.values.reserve(values.size());
  for (const double value : values) {
    stored.values.push_back(is_present(value) ? store(value) : std::numeric_limits<float>::quiet_NaN());
    if (!is_present(value)) ++description.missing;
  }
  // Of the values as they are stored, so that bins and ranges agree with them to the last bit.
  if (any) {
    description.min = description.offset + store(low);
    description.max = description.offset + store(high);
  }
  return stored;
}

format::Histograms count_values(const std::vector<StoredAttribute>& attributes,
                                std::span<const format::ValueBins> bins) {
  format::Histograms histograms(attributes.size());
  for (std::size_t a = 0; a < attributes.size(); ++a)
    for (const float value : attributes[a].values)
      if (!std::isnan(value)) ++histograms[a][static_cast<std::size_t>(bins[a].bin(value))];
  return histograms;
}

json provenance(const BuildOptions& options, const PointSet& points) {
  const PointCensus& census = points.census;
  const CellCensus& cells = points.cells;
  return {{"builder", options.builder},
          {"inputs", options.inputs},
          {"points",
           {{"read", census.read},
            {"not_finite", census.not_finite},
            {"merged", census.merged},
            {"coincident", census.coincident},
            {"in_no_cell", census.in_no_cell}}},
          {"cells",
           {{"types", cells.cells},
            {"tetrahedra", cells.tetrahedra},
            {"inverted", cells.inverted},
            {"flat", cells.flat},
            {"without_volume", cells.without_volume},
            {"hidden", cells.hidden},
            {"non_finite", cells.non_finite},
            {"not_star_shaped", cells.not_star_shaped}}}};
}

format::VolumeInfo describe(const BuildOptions& options, const PointSet& points,
                            const std::vector<Resolution>& resolutions,
                            const std::vector<StoredAttribute>& attributes) {
  using format::ColumnKind;
  using format::ColumnScope;
  format::VolumeInfo info;
  info.cube = points.cube;
  for (const Resolution& resolution : resolutions) info.resolution_counts.push_back(resolution.size());
  info.points_per_chunk = options.points_per_chunk;
  info.leaf_points = options.leaf_points;
  info.columns = {{ColumnKind::position, ColumnScope::segment, -1}, {ColumnKind::octant, ColumnScope::resolution, -1}};
  for (std::size_t a = 0; a < attributes.size(); ++a) {
    info.attributes.push_back(attributes[a].description);
    info.columns.push_back({ColumnKind::value, ColumnScope::segment, static_cast<int>(a)});
  }
  info.provenance = provenance(options, points).dump(-1, ' ', false, json::error_handler_t::replace);
  return info;
}

// Largest error that a position may have, from the cells at the point, or from the nearest neighbours in Morton order
// where there are none. Coincident points set no bound.
std::vector<float> position_errors(const PointSet& points, const Resolution& finest) {
  std::vector<float> errors(points.size());
  const auto distance = [&](std::size_t i, std::size_t j) {
    const auto length = static_cast<float>(glm::length(points.positions[i] - points.positions[j]));
    return length > 0 ? length : std::numeric_limits<float>::infinity();
  };
  tbb::parallel_for(std::size_t{0}, points.size(), [&](std::size_t i) {
    float spacing = points.spacings[i];
    if (!std::isfinite(spacing)) {
      spacing = static_cast<float>(std::ldexp(points.cube.edge, -finest.depths[i]) / std::cbrt(finest.counts[i]));
      if (i > 0) spacing = std::min(spacing, distance(i, i - 1));
      if (i + 1 < points.size()) spacing = std::min(spacing, distance(i, i + 1));
    }
    errors[i] = static_cast<float>(spacing * error_per_spacing);
  });
  return errors;
}

// Turns a reduced point set into rows of chunks.
class RowPacker {
 public:
  RowPacker(const PointSet& points, const std::vector<Resolution>& resolutions,
            const std::vector<std::uint8_t>& segments, const std::vector<StoredAttribute>& attributes,
            std::span<const format::ValueBins> bins, const format::VolumeInfo& info)
      : points_(points),
        resolutions_(resolutions),
        segments_(segments),
        attributes_(attributes),
        bins_(bins),
        info_(info),
        rows_(info),
        errors_(position_errors(points, resolutions.back())),
        order_(points.size()),
        depths_(points.size()),
        counts_(points.size()) {
    std::vector<std::uint64_t> next = segment_begins();
    for (std::size_t i = 0; i < points.size(); ++i) order_[next[segments[i]]++] = i;
  }

  // Puts the leaves of a resolution into file order; the rows of that resolution can then be packed.
  void select(std::size_t resolution) {
    const Resolution& leaves = resolutions_[resolution];
    std::vector<std::uint64_t> next = segment_begins();
    for (std::size_t m = 0; m < leaves.size(); ++m) {
      const std::uint64_t place = next[segments_[leaves.members[m]]]++;
      depths_[place] = leaves.depths[m];
      counts_[place] = leaves.counts[m];
    }
  }

  // Thread-safe.
  std::vector<format::PackedChunk> pack(std::uint64_t row) const {
    const format::Group group = rows_.group(rows_.group_of_row(row));
    std::vector<format::PackedChunk> chunks;
    for (const int column : rows_.columns_of_row(row))
      chunks.push_back(pack_column(info_.columns[static_cast<std::size_t>(column)], group));
    return chunks;
  }

 private:
  std::vector<std::uint64_t> segment_begins() const {
    std::vector<std::uint64_t> begins = {0};
    for (const Resolution& resolution : resolutions_) begins.push_back(resolution.size());
    return begins;
  }

  format::PackedChunk pack_column(const format::Column& column, const format::Group& group) const {
    const auto members = std::span(order_).subspan(group.begin, group.count);
    if (column.kind == format::ColumnKind::octant)
      return format::pack_octants(std::span(depths_).subspan(group.begin, group.count),
                                  std::span(counts_).subspan(group.begin, group.count));
    if (column.kind == format::ColumnKind::value) {
      const auto a = static_cast<std::size_t>(column.attribute);
      std::vector<float> values;
      for (const std::uint64_t i : members) values.push_back(attributes_[a].values[i]);
      return format::pack_values(values, bins_[a]);
    }
    std::vector<dvec3> positions;
    float error = std::numeric_limits<float>::infinity();
    for (const std::uint64_t i : members) {
      positions.push_back(points_.positions[i]);
      error = std::min(error, errors_[i]);
    }
    return format::pack_positions(positions, error);
  }

  const PointSet& points_;
  const std::vector<Resolution>& resolutions_;
  const std::vector<std::uint8_t>& segments_;
  const std::vector<StoredAttribute>& attributes_;
  std::span<const format::ValueBins> bins_;
  const format::VolumeInfo& info_;
  format::RowLayout rows_;
  std::vector<float> errors_;         // [point]
  std::vector<std::uint64_t> order_;  // [place in the file]: point
  std::vector<std::uint8_t> depths_;  // [place in the file], of the selected resolution
  std::vector<std::uint8_t> counts_;
};

Status write_rows(RowPacker& packer, format::VolumeWriter& writer, const BuildProgress& progress) {
  const format::RowLayout& rows = writer.rows();
  std::size_t selected = std::numeric_limits<std::size_t>::max();
  for (std::uint64_t row = 0; row < rows.row_count();) {
    const std::size_t resolution = rows.resolution_of_row(row);
    if (resolution != selected) packer.select(selected = resolution);
    const std::uint64_t end = std::min({row + rows_in_flight, rows.row_count(), rows.first_row(resolution + 1)});
    std::vector<std::vector<format::PackedChunk>> packed(end - row);
    tbb::parallel_for(row, end, [&](std::uint64_t r) { packed[r - row] = packer.pack(r); });
    for (const auto& chunks : packed) SPLATVOL_TRY(writer.append_row(chunks));
    row = end;
    progress("writing", static_cast<double>(row) / static_cast<double>(rows.row_count()));
  }
  return {};
}

}  // namespace

Result<BuildReport> build_volume(Source& source, const std::string& output, const BuildOptions& options,
                                 const BuildProgress& progress) {
  if (options.leaf_points < 8)
    return fail(ErrorCode::invalid_argument,
                "a leaf must be allowed 8 points or more: with {}, a cell could be split without losing any",
                options.leaf_points);
  SPLATVOL_TRY_ASSIGN(points, gather_points(source, [&](double fraction) { progress("reading", fraction); }));

  progress("reducing", 0);
  const std::vector<Resolution> resolutions =
      reduce_by_octree(points.keys, points.positions, points.cube, options.leaf_points);
  const std::vector<std::uint8_t> segments = find_segments(resolutions);

  std::vector<StoredAttribute> attributes(points.attributes.size());
  tbb::parallel_for(std::size_t{0}, attributes.size(), [&](std::size_t a) {
    attributes[a] = store_attribute(points.attributes[a], points.values[a]);
    points.values[a] = {};
  });
  const format::VolumeInfo info = describe(options, points, resolutions, attributes);
  std::vector<format::ValueBins> bins;
  for (const StoredAttribute& attribute : attributes) bins.push_back(format::bins_of(attribute.description));

  progress("indexing", 0);
  const format::NodeArrays tree =
      build_index({points.keys, segments, resolutions, attributes, bins}, options.index_leaf_points);

  SPLATVOL_TRY_ASSIGN(writer, format::VolumeWriter::create(output, info, tree));
  RowPacker packer(points, resolutions, segments, attributes, bins, info);
  SPLATVOL_TRY(write_rows(packer, *writer, progress));
  SPLATVOL_TRY(writer->finish(count_values(attributes, bins)));

  BuildReport report{info.resolution_counts, writer->file_bytes(), points.census, points.cells, {}};
  for (const format::Attribute& attribute : info.attributes)
    report.missing.emplace_back(attribute.name, attribute.missing);
  return report;
}

}  // namespace splatvol
