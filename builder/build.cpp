#include "builder/build.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>

#include "builder/index_builder.h"
#include "builder/material.h"
#include "builder/reduction.h"
#include "format/volume_writer.h"

namespace splatvol {
namespace {

using nlohmann::json;

constexpr std::size_t rows_in_flight = 64;  // packed in parallel, then appended in order

// Positions and means may move by this share of a splat's smallest deviation; a deviation is about a quarter of the
// spacing of points.
constexpr double error_per_deviation = 1.0 / 64;
constexpr double error_per_spacing = error_per_deviation / 4;

// Nor need means be finer than this share of the attribute's range: no transfer function shows it.
constexpr double error_per_range = 0x1p-20;

// Single precision loses the detail of a narrow range far from zero (pressures round 101325 Pa); an offset keeps it.
double choose_offset(double low, double high) {
  const double largest = std::max(std::abs(low), std::abs(high));
  const bool fine = largest * std::exp2(-24) <= (high - low) * std::exp2(-16);
  return largest == 0 || fine ? 0.0 : low + (high - low) / 2;
}

StoredAttribute store_attribute(const std::string& name, const std::vector<double>& values) {
  StoredAttribute stored;
  format::Attribute& description = stored.description;
  description.name = name;
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const double value : values) {
    if (std::isnan(value)) continue;
    low = std::min(low, value);
    high = std::max(high, value);
  }
  const bool any = low <= high;
  if (any) description.offset = choose_offset(low, high);

  const auto store = [&](double value) { return static_cast<float>(value - description.offset); };
  stored.values.reserve(values.size());
  for (const double value : values) {
    stored.values.push_back(store(value));
    if (std::isnan(value)) ++description.missing;
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

json provenance(const BuildOptions& options, Connectivity connectivity, const PointSet& points) {
  const PointCensus& census = points.census;
  const CellCensus& cells = points.cells;
  return {{"builder", options.builder},
          {"inputs", options.inputs},
          {"connectivity", connectivity_name(connectivity)},
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

format::VolumeInfo describe(const BuildOptions& options, Connectivity connectivity, const PointSet& points,
                            const std::vector<Resolution>& resolutions,
                            const std::vector<StoredAttribute>& attributes) {
  using format::ColumnKind;
  using format::ColumnScope;
  format::VolumeInfo info;
  info.cube = points.cube;
  for (const Resolution& resolution : resolutions) info.resolution_counts.push_back(resolution.size());
  info.points_per_chunk = options.points_per_chunk;
  info.leaf_points = options.leaf_points;
  info.size_bounds = {"octant", "moments"};  // as build_index has them
  info.columns = {{ColumnKind::position, ColumnScope::segment, -1},
                  {ColumnKind::octant, ColumnScope::resolution, -1},
                  {ColumnKind::centroid, ColumnScope::resolution, -1},
                  {ColumnKind::moments, ColumnScope::resolution, -1}};
  for (std::size_t a = 0; a < attributes.size(); ++a) {
    info.attributes.push_back(attributes[a].description);
    info.columns.push_back({ColumnKind::value, ColumnScope::segment, static_cast<int>(a)});
    info.columns.push_back({ColumnKind::value_moments, ColumnScope::resolution, static_cast<int>(a)});
    info.columns.push_back({ColumnKind::gradient, ColumnScope::segment, static_cast<int>(a)});
  }
  info.provenance = provenance(options, connectivity, points).dump(-1, ' ', false, json::error_handler_t::replace);
  return info;
}

Status use_estimate(PointSet& points) {
  SPLATVOL_TRY_ASSIGN(material, ScatteredEstimate::create(points.positions));
  points.material.moments = material.spatial();
  for (std::size_t a = 0; a < points.values.size(); ++a) {
    points.material.value_moments[a] = material.values(points.values[a]);
    const std::vector<vec3> gradients = material.gradients(points.values[a]);
    points.gradients[a].assign(gradients.begin(), gradients.end());
  }
  return {};
}

// Largest error that a position may have, from the point's own material, or from the nearest neighbours in Morton order
// where there is none. Coincident points set no bound.
std::vector<double> position_errors(const PointSet& points, const Resolution& finest, const Material& material) {
  std::vector<double> errors(points.size());
  const auto distance = [&](std::size_t i, std::size_t j) {
    const double length = glm::length(points.positions[i] - points.positions[j]);
    return length > 0 ? length : std::numeric_limits<double>::infinity();
  };
  tbb::parallel_for(std::size_t{0}, points.size(), [&](std::size_t i) {
    if (material.extents[i].shortest > 0) {
      errors[i] = material.extents[i].shortest * error_per_deviation;
      return;
    }
    double spacing = std::ldexp(points.cube.edge, -finest.depths[i]) / std::cbrt(finest.counts[i]);
    if (i > 0) spacing = std::min(spacing, distance(i, i - 1));
    if (i + 1 < points.size()) spacing = std::min(spacing, distance(i, i + 1));
    errors[i] = spacing * error_per_spacing;
  });
  return errors;
}

// Unit vector; 0 for 0.
vec3 direction(const dvec3& gradient) {
  const double largest = std::max({std::abs(gradient.x), std::abs(gradient.y), std::abs(gradient.z)});
  return largest > 0 && std::isfinite(largest) ? vec3(glm::normalize(gradient / largest)) : vec3(0);
}

// What the file is made from. Index [resolution], or [point] in Morton order.
struct Reduced {
  PointSet points;
  std::vector<Resolution> resolutions;
  std::vector<Material> materials;
  std::vector<std::uint8_t> segments;
  std::vector<StoredAttribute> attributes;
  std::vector<format::ValueBins> bins;  // [attribute]
};

// Turns it into rows of chunks.
class RowPacker {
 public:
  RowPacker(const Reduced& data, const format::VolumeInfo& info)
      : data_(data),
        info_(info),
        rows_(info),
        errors_(position_errors(data.points, data.resolutions.back(), data.materials.back())),
        order_(data.points.size()),
        members_(data.points.size()) {
    std::vector<std::uint64_t> next = segment_begins();
    for (std::size_t i = 0; i < order_.size(); ++i) order_[next[data.segments[i]]++] = i;
  }

  // Puts the members of a resolution into file order; the rows of that resolution can then be packed.
  void select(std::size_t resolution) {
    leaves_ = &data_.resolutions[resolution];
    material_ = &data_.materials[resolution];
    std::vector<std::uint64_t> next = segment_begins();
    for (std::size_t m = 0; m < leaves_->size(); ++m) members_[next[data_.segments[leaves_->members[m]]]++] = m;
  }

  // Thread-safe.
  std::vector<format::PackedChunk> pack(std::uint64_t row) const {
    const format::Group group = rows_.group(rows_.group_of_row(row));
    const Part part{std::span(order_).subspan(group.begin, group.count),
                    std::span(members_).subspan(group.begin, group.count)};
    std::vector<format::SplatShape> shapes;
    for (const std::uint64_t m : part.members) shapes.push_back(material_->shape(m));
    std::vector<format::PackedChunk> chunks;
    for (const int column : rows_.columns_of_row(row))
      chunks.push_back(pack_column(info_.columns[static_cast<std::size_t>(column)], part, shapes));
    return chunks;
  }

 private:
  // A group, as indices of its points and of them among the members of the selected resolution.
  struct Part {
    std::span<const std::uint64_t> points;
    std::span<const std::uint64_t> members;
  };

  std::vector<std::uint64_t> segment_begins() const {
    std::vector<std::uint64_t> begins = {0};
    for (const Resolution& resolution : data_.resolutions) begins.push_back(resolution.size());
    return begins;
  }

  format::PackedChunk pack_column(const format::Column& column, const Part& part,
                                  std::span<const format::SplatShape> shapes) const {
    const auto a = static_cast<std::size_t>(std::max(column.attribute, 0));
    switch (column.kind) {
      case format::ColumnKind::position:
        return pack_positions(part);
      case format::ColumnKind::octant:
        return pack_octants(part);
      case format::ColumnKind::centroid:
        return pack_centroids(part);
      case format::ColumnKind::moments:
        return format::pack_moments(shapes);
      case format::ColumnKind::value_moments:
        return pack_value_moments(a, part, shapes);
      case format::ColumnKind::gradient:
        return pack_gradients(a, part);
      default:
        return pack_values(a, part);
    }
  }

  format::PackedChunk pack_positions(const Part& part) const {
    std::vector<dvec3> positions;
    double error = std::numeric_limits<double>::infinity();
    for (const std::uint64_t i : part.points) {
      positions.push_back(data_.points.positions[i]);
      error = std::min(error, errors_[i]);
    }
    return format::pack_positions(positions, error);
  }

  format::PackedChunk pack_octants(const Part& part) const {
    std::vector<std::uint8_t> depths, counts;
    for (const std::uint64_t m : part.members) {
      depths.push_back(leaves_->depths[m]);
      counts.push_back(leaves_->counts[m]);
    }
    return format::pack_octants(depths, counts);
  }

  format::PackedChunk pack_centroids(const Part& part) const {
    std::vector<dvec3> centroids;
    double error = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < part.points.size(); ++k) {
      const std::uint64_t i = part.points[k], m = part.members[k];
      centroids.push_back(data_.points.positions[i] + material_->moments[m].centroid);
      const double shortest = material_->extents[m].shortest;
      error = std::min(error, shortest > 0 ? shortest * error_per_deviation : errors_[i]);
    }
    return format::pack_positions(centroids, error);
  }

  format::PackedChunk pack_values(std::size_t attribute, const Part& part) const {
    std::vector<float> values;
    for (const std::uint64_t i : part.points) values.push_back(data_.attributes[attribute].values[i]);
    return format::pack_values(values, data_.bins[attribute]);
  }

  format::PackedChunk pack_value_moments(std::size_t attribute, const Part& part,
                                         std::span<const format::SplatShape> shapes) const {
    const double offset = data_.attributes[attribute].description.offset;
    const format::ValueBins& bins = data_.bins[attribute];
    std::vector<format::SplatValue> values;
    format::ValueSummary summary;
    double smallest = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < shapes.size(); ++k) {
      const ValueMoments& moments = material_->value_moments[attribute][part.members[k]];
      values.push_back(value_of(moments, shapes[k]));
      values.back().mean -= offset;
      summary.include(summarize(moments, offset, bins));
      if (values.back().deviation > 0) smallest = std::min(smallest, values.back().deviation);
    }
    const double range = bins.max > bins.min ? bins.max - bins.min : 0;
    const double error =
        std::max(range * error_per_range, std::isfinite(smallest) ? smallest * error_per_deviation : 0);
    return format::pack_value_moments(values, error, summary);
  }

  format::PackedChunk pack_gradients(std::size_t attribute, const Part& part) const {
    std::vector<vec3> directions;
    for (const std::uint64_t i : part.points) directions.push_back(direction(data_.points.gradients[attribute][i]));
    return format::pack_gradients(directions);
  }

  const Reduced& data_;
  const format::VolumeInfo& info_;
  format::RowLayout rows_;
  std::vector<double> errors_;          // [point]
  std::vector<std::uint64_t> order_;    // [place in the file]: point
  std::vector<std::uint64_t> members_;  // [place in the file]: member of the selected resolution
  const Resolution* leaves_ = nullptr;  // of the selected resolution
  const Material* material_ = nullptr;
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

// Finds what each point stands for, and says from what. `points` come with the material of their cells where `wanted`
// allows it and there are some.
Result<Connectivity> connect(PointSet& points, Connectivity wanted) {
  const bool automatic = wanted == Connectivity::automatic;
  if (!points.material.moments.empty()) return Connectivity::mesh;
  if (wanted == Connectivity::mesh)
    return fail(ErrorCode::invalid_data, "no cells that fill a volume: the connectivity 'mesh' needs some");
  if (wanted == Connectivity::delaunay || automatic) {
    SPLATVOL_TRY_ASSIGN(tetrahedra, delaunay_tetrahedra(points.positions));
    if (!tetrahedra.empty() || !automatic) {
      std::vector<std::size_t> vertices(points.size());
      std::iota(vertices.begin(), vertices.end(), std::size_t{0});
      append_material(VertexMaterial(points.positions, tetrahedra), points.values, vertices, points);
      points.material.planes = boundary_planes(points.positions, find_outer_faces(points.positions, tetrahedra));
      return Connectivity::delaunay;
    }
  }
  SPLATVOL_TRY(use_estimate(points));
  return Connectivity::none;
}

Reduced reduce(PointSet points, std::uint32_t leaf_points) {
  Reduced data;
  data.points = std::move(points);
  PointSet& all = data.points;
  data.resolutions = reduce_by_octree(all.keys, all.positions, all.cube, leaf_points);
  data.segments = find_segments(data.resolutions);
  data.materials = merge_clusters(all.keys, all.positions, data.resolutions, std::move(all.material));
  data.attributes.resize(all.attributes.size());
  tbb::parallel_for(std::size_t{0}, data.attributes.size(), [&](std::size_t a) {
    data.attributes[a] = store_attribute(all.attributes[a], all.values[a]);
    all.values[a] = {};
  });
  for (const StoredAttribute& attribute : data.attributes) data.bins.push_back(format::bins_of(attribute.description));
  return data;
}

}  // namespace

const char* connectivity_name(Connectivity connectivity) {
  switch (connectivity) {
    case Connectivity::mesh:
      return "mesh";
    case Connectivity::delaunay:
      return "delaunay";
    case Connectivity::none:
      return "none";
    default:
      return "auto";
  }
}

Result<BuildReport> build_volume(Source& source, const std::string& output, const BuildOptions& options,
                                 const BuildProgress& progress) {
  if (options.leaf_points < 8)
    return fail(ErrorCode::invalid_argument,
                "a leaf must be allowed 8 points or more: with {}, a cell could be split without losing any",
                options.leaf_points);
  const bool use_cells = options.connectivity == Connectivity::automatic || options.connectivity == Connectivity::mesh;
  SPLATVOL_TRY_ASSIGN(points,
                      gather_points(source, use_cells, [&](double fraction) { progress("reading", fraction); }));
  progress("connecting", 0);
  SPLATVOL_TRY_ASSIGN(connectivity, connect(points, options.connectivity));

  progress("reducing", 0);
  const Reduced data = reduce(std::move(points), options.leaf_points);
  const format::VolumeInfo info = describe(options, connectivity, data.points, data.resolutions, data.attributes);

  progress("indexing", 0);
  const format::NodeArrays tree = build_index({data.points.cube, data.points.keys, data.points.positions, data.segments,
                                               data.resolutions, data.materials, data.attributes, data.bins},
                                              options.index_leaf_points);

  SPLATVOL_TRY_ASSIGN(writer, format::VolumeWriter::create(output, info, tree));
  RowPacker packer(data, info);
  SPLATVOL_TRY(write_rows(packer, *writer, progress));
  SPLATVOL_TRY(writer->finish(count_values(data.attributes, data.bins)));

  BuildReport report{info.resolution_counts, writer->file_bytes(), connectivity,
                     data.points.census,     data.points.cells,    {}};
  for (const format::Attribute& attribute : info.attributes)
    report.missing.emplace_back(attribute.name, attribute.missing);
  return report;
}

}  // namespace splatvol
