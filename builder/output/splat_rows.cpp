#include "builder/output/splat_rows.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace splatvol {
namespace {

// Nor need means be finer than this share of the attribute's range: no transfer function shows it.
constexpr double error_per_range = 0x1p-20;

constexpr double infinity = std::numeric_limits<double>::infinity();

// Calls visit(a, b) for each pair of arrays.
template <class A, class B, class Visit>
void for_each_array(A& a, B& b, const Visit& visit) {
  visit(a.splats.centroids, b.splats.centroids);
  visit(a.splats.errors, b.splats.errors);
  visit(a.splats.shapes, b.splats.shapes);
  visit(a.splats.numbers, b.splats.numbers);
  visit(a.splats.depths, b.splats.depths);
  visit(a.splats.counts, b.splats.counts);
  visit(a.points.positions, b.points.positions);
  visit(a.points.errors, b.points.errors);
  for (std::size_t i = 0; i < a.splat_values.size(); ++i) {
    visit(a.splat_values[i].moments, b.splat_values[i].moments);
    visit(a.splat_values[i].min, b.splat_values[i].min);
    visit(a.splat_values[i].max, b.splat_values[i].max);
    visit(a.point_values[i].values, b.point_values[i].values);
    visit(a.point_values[i].gradients, b.point_values[i].gradients);
  }
}

// Fetches where the next row will be: other chunks get theirs before, too many for the processor to see it coming.
template <class T>
void prefetch_end(const std::vector<T>& items) {
  prefetch_lines(items.data() + items.size(), sizeof(T) + 1);
}

// The rows that one chunk holds.
class ChunkPacker {
 public:
  ChunkPacker(const SplatRows& rows, const std::vector<format::Attribute>& attributes)
      : rows_(rows), attributes_(attributes) {}

  format::PackedChunk pack(const format::Column& column) const {
    const auto a = static_cast<std::size_t>(std::max(column.attribute, 0));
    switch (column.kind) {
      case format::ColumnKind::position:
        return format::pack_positions(rows_.points.positions, std::ranges::min(rows_.points.errors));
      case format::ColumnKind::octant:
        return format::pack_octants(rows_.splats.depths, rows_.splats.counts);
      case format::ColumnKind::centroid:
        return format::pack_positions(rows_.splats.centroids, std::ranges::min(rows_.splats.errors));
      case format::ColumnKind::moments:
        return format::pack_moments(rows_.splats.shapes);
      case format::ColumnKind::value_moments:
        return pack_value_moments(a);
      case format::ColumnKind::gradient:
        return format::pack_gradients(rows_.point_values[a].gradients);
      default:
        return format::pack_values(rows_.point_values[a].values, format::bins_of(attributes_[a]));
    }
  }

 private:
  format::PackedChunk pack_value_moments(std::size_t attribute) const {
    const format::ValueBins bins = format::bins_of(attributes_[attribute]);
    const SplatRows::SplatValues& values = rows_.splat_values[attribute];
    format::ValueSummary summary;
    double smallest = infinity;
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      summary.include(summarize_range(values.min[i], values.max[i], bins));
      const double deviation = values.moments[i].deviation;
      if (deviation > 0) smallest = std::min(smallest, deviation);
    }
    const double range = bins.max > bins.min ? bins.max - bins.min : 0;
    const double error =
        std::max(range * error_per_range, std::isfinite(smallest) ? smallest * error_per_deviation : 0);
    return format::pack_value_moments(values.moments, error, summary);
  }

  const SplatRows& rows_;
  const std::vector<format::Attribute>& attributes_;
};

}  // namespace

void SplatRows::reserve(std::size_t rows) {
  for_each_array(*this, *this, [&](auto& items, const auto&) { items.reserve(rows); });
}

void SplatRows::add_splat(const SplatRow& splat, std::span<const ValueRow> values) {
  splats.centroids.push_back(splat.centroid);
  splats.errors.push_back(splat.error);
  splats.shapes.push_back(splat.shape);
  splats.numbers.push_back(splat.number);
  splats.depths.push_back(splat.depth);
  splats.counts.push_back(splat.count);
  for (std::size_t a = 0; a < values.size(); ++a) {
    splat_values[a].moments.push_back(values[a].value);
    splat_values[a].min.push_back(values[a].min);
    splat_values[a].max.push_back(values[a].max);
    prefetch_end(splat_values[a].moments);
  }
  prefetch_end(splats.centroids);
  prefetch_end(splats.shapes);
}

void SplatRows::add_point(const PlacedPoint& point) {
  points.positions.push_back(point.position);
  points.errors.push_back(point.error);
}

void SplatRows::add_point_value(std::size_t attribute, float value, const vec3& gradient) {
  point_values[attribute].values.push_back(value);
  point_values[attribute].gradients.push_back(gradient);
}

void SplatRows::append(const SplatRows& other, std::size_t begin, std::size_t end) {
  for_each_array(*this, other, [&](auto& all, const auto& items) {
    const auto at = [&](std::size_t i) { return items.begin() + static_cast<std::ptrdiff_t>(i); };
    if (!items.empty()) all.insert(all.end(), at(begin), at(end));
  });
}

void SplatRows::clear() {
  for_each_array(*this, *this, [](auto& items, const auto&) { items.clear(); });
}

SplatRow make_splat_row(const dvec3& position, double point_error, const SpatialMoments& moments,
                        const format::SplatShape& shape, const BoundaryPlane& plane) {
  const double shortest = shortest_deviation(shape);
  SplatRow row{.centroid = position + moments.centroid,
               .error = shortest > 0 ? shortest * error_per_deviation : point_error,
               .shape = shape};
  if (plane.area != dvec3(0)) row.shape.boundary = boundary_foot(plane, moments, shape);
  return row;
}

format::SplatValue stored_value(const ValueMoments& moments, const format::SplatShape& shape, double offset) {
  format::SplatValue value = value_of(moments, shape);
  value.mean -= offset;
  return value;
}

ValueRow make_value_row(const ValueMoments& moments, const format::SplatShape& shape, double offset) {
  const auto [low, high] = stored_range(moments, offset);
  return {stored_value(moments, shape, offset), low, high};
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
