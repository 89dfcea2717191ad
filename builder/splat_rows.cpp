#include "builder/splat_rows.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace splatvol {
namespace {

// Nor need means be finer than this share of the attribute's range: no transfer function shows it.
constexpr double error_per_range = 0x1p-20;

constexpr double infinity = std::numeric_limits<double>::infinity();

template <class T>
void append_part(std::vector<T>& all, const std::vector<T>& items, std::size_t begin, std::size_t end) {
  if (items.empty()) return;
  const auto at = [&](std::size_t i) { return items.begin() + static_cast<std::ptrdiff_t>(i); };
  all.insert(all.end(), at(begin), at(end));
}

// The rows that one chunk holds.
class ChunkPacker {
 public:
  ChunkPacker(const SplatRows& rows, const std::vector<format::Attribute>& attributes)
      : rows_(rows), attributes_(attributes), count_(rows.size()) {}

  format::PackedChunk pack(const format::Column& column) const {
    const auto a = static_cast<std::size_t>(std::max(column.attribute, 0));
    switch (column.kind) {
      case format::ColumnKind::position:
        return pack_positions();
      case format::ColumnKind::octant:
        return pack_octants();
      case format::ColumnKind::centroid:
        return pack_centroids();
      case format::ColumnKind::moments:
        return pack_shapes();
      case format::ColumnKind::value_moments:
        return pack_value_moments(a);
      case format::ColumnKind::gradient:
        return format::pack_gradients(rows_.gradients[a]);
      default:
        return format::pack_values(rows_.values[a], format::bins_of(attributes_[a]));
    }
  }

 private:
  format::PackedChunk pack_positions() const {
    std::vector<dvec3> positions;
    positions.reserve(count_);
    double error = infinity;
    for (const PlacedPoint& point : rows_.points) {
      positions.push_back(point.position);
      error = std::min(error, point.error);
    }
    return format::pack_positions(positions, error);
  }

  format::PackedChunk pack_octants() const {
    std::vector<std::uint8_t> depths, counts;
    depths.reserve(count_);
    counts.reserve(count_);
    for (const SplatRow& splat : rows_.splats) {
      depths.push_back(splat.depth);
      counts.push_back(splat.count);
    }
    return format::pack_octants(depths, counts);
  }

  format::PackedChunk pack_centroids() const {
    std::vector<dvec3> centroids;
    centroids.reserve(count_);
    double error = infinity;
    for (const SplatRow& splat : rows_.splats) {
      centroids.push_back(splat.centroid);
      error = std::min(error, splat.error);
    }
    return format::pack_positions(centroids, error);
  }

  format::PackedChunk pack_shapes() const {
    std::vector<format::SplatShape> shapes;
    shapes.reserve(count_);
    for (const SplatRow& splat : rows_.splats) shapes.push_back(splat.shape);
    return format::pack_moments(shapes);
  }

  format::PackedChunk pack_value_moments(std::size_t attribute) const {
    const format::ValueBins bins = format::bins_of(attributes_[attribute]);
    std::vector<format::SplatValue> values;
    values.reserve(count_);
    format::ValueSummary summary;
    double smallest = infinity;
    for (const ValueRow& row : rows_.value_rows[attribute]) {
      values.push_back(row.value);
      summary.include(summarize_range(row.min, row.max, bins));
      if (row.value.deviation > 0) smallest = std::min(smallest, row.value.deviation);
    }
    const double range = bins.max > bins.min ? bins.max - bins.min : 0;
    const double error =
        std::max(range * error_per_range, std::isfinite(smallest) ? smallest * error_per_deviation : 0);
    return format::pack_value_moments(values, error, summary);
  }

  const SplatRows& rows_;
  const std::vector<format::Attribute>& attributes_;
  std::size_t count_;
};

}  // namespace

void SplatRows::append(const SplatRows& other, std::size_t begin, std::size_t end) {
  append_part(splats, other.splats, begin, end);
  append_part(points, other.points, begin, end);
  for (std::size_t a = 0; a < values.size(); ++a) {
    append_part(value_rows[a], other.value_rows[a], begin, end);
    append_part(values[a], other.values[a], begin, end);
    append_part(gradients[a], other.gradients[a], begin, end);
  }
}

double shortest_deviation(const format::SplatShape& shape) {
  int shortest = 2;
  while (shortest > 0 && !(shape.deviations[shortest] > 0)) --shortest;
  return shape.deviations[shortest];
}

SplatRow make_splat_row(const dvec3& position, double point_error, const SpatialMoments& moments,
                        const BoundaryPlane& plane) {
  SplatRow row;
  row.shape = shape_of(moments);
  row.shape.boundary = boundary_foot(plane, moments, row.shape);
  row.centroid = position + moments.centroid;
  const double shortest = shortest_deviation(row.shape);
  row.error = shortest > 0 ? shortest * error_per_deviation : point_error;
  return row;
}

ValueRow make_value_row(const ValueMoments& moments, const format::SplatShape& shape, double offset) {
  ValueRow row{value_of(moments, shape), std::numeric_limits<float>::infinity(),
               -std::numeric_limits<float>::infinity()};
  row.value.mean -= offset;
  if (moments.mass > 0) {
    row.min = static_cast<float>(moments.min - offset);
    row.max = static_cast<float>(moments.max - offset);
  }
  return row;
}

format::ValueSummary summarize_range(float low, float high, const format::ValueBins& bins) {
  if (!(low <= high)) return {};
  const std::uint64_t all = ~std::uint64_t{0};
  return {low, high, all << bins.bin(low) & all >> (63 - bins.bin(high))};
}

std::vector<format::PackedChunk> pack_rows(const SplatRows& rows, const std::vector<format::Column>& columns,
                                           const std::vector<format::Attribute>& attributes) {
  const ChunkPacker packer(rows, attributes);
  std::vector<format::PackedChunk> chunks;
  for (const format::Column& column : columns) chunks.push_back(packer.pack(column));
  return chunks;
}

}  // namespace splatvol
