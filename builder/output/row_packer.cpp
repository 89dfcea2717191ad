#include "builder/output/row_packer.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <span>
#include <utility>

namespace splatvol {
namespace {

using format::Bytes;
using format::PackedChunk;

// Means need not be finer than this share of the attribute's range: no transfer function shows it.
constexpr double error_per_range = 0x1p-20;

constexpr double infinity = std::numeric_limits<double>::infinity();

// Packs columns of a row.
class ChunkPacker {
 public:
  ChunkPacker(const SplatColumns& splats, const std::vector<format::Attribute>& attributes)
      : splats_(splats), attributes_(attributes) {}

  format::PackedChunk pack(const format::Column& column) const {
    const auto a = static_cast<std::size_t>(std::max(column.attribute, 0));
    switch (column.kind) {
      case format::ColumnKind::position:
        return format::pack_positions(splats_.points.positions, std::ranges::min(splats_.points.errors));
      case format::ColumnKind::octant:
        return format::pack_octants(splats_.splats.depths, splats_.splats.counts);
      case format::ColumnKind::centroid:
        return format::pack_positions(splats_.splats.centroids, std::ranges::min(splats_.splats.errors));
      case format::ColumnKind::moments:
        return format::pack_moments(splats_.splats.shapes);
      case format::ColumnKind::value_moments:
        return pack_value_moments(a);
      case format::ColumnKind::gradient:
        return format::pack_gradients(splats_.point_values[a].gradients);
      default:
        return format::pack_values(splats_.point_values[a].values, format::bins_of(attributes_[a]));
    }
  }

 private:
  format::PackedChunk pack_value_moments(std::size_t attribute) const {
    const format::ValueBins bins = format::bins_of(attributes_[attribute]);
    const SplatColumns::SplatValues& values = splats_.splat_values[attribute];
    format::ValueSummary summary;
    double smallest = infinity;
    for (std::size_t i = 0; i < splats_.size(); ++i) {
      summary.include(summarize_range(values.min[i], values.max[i], bins));
      const double deviation = values.moments[i].deviation;
      if (deviation > 0) smallest = std::min(smallest, deviation);
    }
    const double range = bins.max > bins.min ? bins.max - bins.min : 0;
    const double error =
        std::max(range * error_per_range, std::isfinite(smallest) ? smallest * error_per_deviation : 0);
    return format::pack_value_moments(values.moments, error, summary);
  }

  const SplatColumns& splats_;
  const std::vector<format::Attribute>& attributes_;
};

PackedRow serialize(std::span<const PackedChunk> chunks) {
  PackedRow row;
  row.entry_bytes = chunks.size() * sizeof(format::ChunkEntry);
  std::size_t size = row.entry_bytes;
  for (const PackedChunk& chunk : chunks) size += chunk.bytes.size();
  Bytes& bytes = row.bytes;
  bytes.reserve(size);
  for (const PackedChunk& chunk : chunks) format::append_record(bytes, chunk.entry);
  for (const PackedChunk& chunk : chunks) bytes.insert(bytes.end(), chunk.bytes.begin(), chunk.bytes.end());
  return row;
}

}  // namespace

RowPacker::RowPacker(const format::VolumeInfo& info) : attributes_(info.attributes), all_columns_(info.columns) {
  std::ranges::copy_if(all_columns_, std::back_inserter(resolution_columns_),
                       [](const format::Column& column) { return column.scope == format::ColumnScope::resolution; });
}

PackedRow RowPacker::pack(const SplatColumns& splats) const {
  const ChunkPacker packer(splats, attributes_);
  std::vector<PackedChunk> chunks;
  for (const format::Column& column : splats.points.positions.empty() ? resolution_columns_ : all_columns_)
    chunks.push_back(packer.pack(column));
  return serialize(chunks);
}

void RowPacker::pack(PendingRow& row) const {
  if (!row.splats) return;
  if (row.chunks.empty()) {
    row.packed = pack(*row.splats);
    return;
  }
  const std::vector<format::Column>& columns = row.has_points ? all_columns_ : resolution_columns_;
  for (std::size_t c = 0; c < columns.size(); ++c)
    if (columns[c].kind == format::ColumnKind::moments)
      row.chunks[c] = ChunkPacker(*row.splats, attributes_).pack(columns[c]);
  row.packed = serialize(row.chunks);
  row.chunks = {};
}

void RowPacker::pack_early(PendingRow& row) const {
  SplatColumns& splats = *row.splats;
  const ChunkPacker packer(splats, attributes_);
  row.has_points = !splats.points.positions.empty();
  for (const format::Column& column : row.has_points ? all_columns_ : resolution_columns_)
    row.chunks.push_back(column.kind == format::ColumnKind::moments ? format::PackedChunk{} : packer.pack(column));
  SplatColumns rest(attributes_.size());
  rest.splats.shapes = std::move(splats.splats.shapes);
  rest.splats.numbers = std::move(splats.splats.numbers);
  splats = std::move(rest);
}

}  // namespace splatvol
