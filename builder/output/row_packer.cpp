#include "builder/output/row_packer.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <limits>
#include <span>
#include <utility>

#include "base/selection.h"

namespace splatvol {
namespace {

// A value may move by this share of the smallest deviation of its chunk's splats. Positions may move by less of theirs:
// values have more noise.
constexpr double value_error_per_deviation = 1.0 / 16;

// Least steps of means, for material whose values hardly vary: shares of the median deviation, and of the smallest mean
// of material whose values do not vary.
constexpr double step_per_median_deviation = 0x1p-12;
constexpr double step_per_mean = 0x1p-16;

constexpr double infinity = std::numeric_limits<double>::infinity();

}  // namespace

// Packs columns of a row.
class RowPacker::ChunkPacker {
 public:
  ChunkPacker(const SplatColumns& splats, const RowPacker& packer) : splats_(splats), packer_(packer) {
    row_.values.resize(packer.attributes_.size());
  }

  format::PackedChunk pack(const format::Column& column) {
    const auto a = static_cast<std::size_t>(std::max(column.attribute, 0));
    switch (column.kind) {
      case format::ColumnKind::position:
        return format::pack_positions(splats_.points.positions, position_error(), &row_.position_error);
      case format::ColumnKind::octant:
        return format::pack_octants(splats_.splats.depths, splats_.splats.counts);
      case format::ColumnKind::centroid:
        return format::pack_centroids(splats_.splats.centroids, splats_.splats.least_error, packer_.cube_);
      case format::ColumnKind::moments:
        return format::pack_moments(splats_.splats.shapes, packer_.cube_.edge);
      case format::ColumnKind::value_moments:
        return pack_value_moments(a);
      case format::ColumnKind::gradient:
        return format::pack_gradients(splats_.point_values[a].gradients);
      default:
        return format::pack_values(splats_.point_values[a].values, value_error(a),
                                   format::bins_of(packer_.attributes_[a]), &row_.values[a]);
    }
  }

  // Facts about the points of the chunks so far.
  [[nodiscard]] const StoredSummary& row() const { return row_; }

 private:
  format::PackedChunk pack_value_moments(std::size_t attribute) const {
    const format::ValueBins bins = format::bins_of(packer_.attributes_[attribute]);
    const std::vector<StoredValue>& values = splats_.splat_values[attribute];
    format::ValueSummary summary;
    for (const StoredValue& value : values) summary.include(summarize_range(value.min, value.max, bins));
    return format::pack_value_moments(values, least_step(values), summary);
  }

  // Depends on no value that is far from the others, such as a number that stands for no value.
  static double least_step(std::span<const StoredValue> values) {
    std::vector<float> deviations;
    deviations.reserve(values.size());
    double smallest_mean = infinity;
    for (const StoredValue& value : values) {
      if (value.deviation > 0) deviations.push_back(value.deviation);
      if (value.coverage > 0 && value.deviation == 0 && value.mean != 0)
        smallest_mean = std::min<double>(smallest_mean, std::abs(value.mean));
    }
    if (deviations.empty()) return 0;
    const std::size_t middle = deviations.size() / 2;
    select_nth(std::span(deviations), middle, std::less());
    return std::min(step_per_median_deviation * double{deviations[middle]}, step_per_mean * smallest_mean);
  }

  double position_error() const { return packer_.exact_.positions ? 0 : splats_.points.least_error; }

  double value_error(std::size_t attribute) const {
    if (packer_.exact_.values) return 0;
    double smallest = infinity;
    for (const StoredValue& value : splats_.splat_values[attribute])
      if (value.deviation > 0) smallest = std::min(smallest, double{value.deviation});
    return std::isfinite(smallest) ? smallest * value_error_per_deviation : 0;
  }

  const SplatColumns& splats_;
  const RowPacker& packer_;
  StoredSummary row_;
};

RowPacker::RowPacker(const format::VolumeInfo& info, ExactColumns exact)
    : cube_(info.cube), exact_(exact), attributes_(info.attributes), all_columns_(info.columns) {
  summary_.values.resize(attributes_.size());
  std::ranges::copy_if(all_columns_, std::back_inserter(resolution_columns_),
                       [](const format::Column& column) { return column.scope == format::ColumnScope::resolution; });
}

format::Histograms StoredSummary::histograms() const {
  format::Histograms histograms;
  for (const format::StoredValues& of_attribute : values) histograms.push_back(of_attribute.histogram);
  return histograms;
}

StoredSummary RowPacker::summary() const {
  const std::scoped_lock lock(mutex_);
  return summary_;
}

void StoredSummary::include(const StoredSummary& other) {
  position_error = std::max(position_error, other.position_error);
  for (std::size_t a = 0; a < other.values.size(); ++a) {
    format::StoredValues& all = values[a];
    const format::StoredValues& more = other.values[a];
    for (std::size_t bin = 0; bin < all.histogram.size(); ++bin) all.histogram[bin] += more.histogram[bin];
    all.missing += more.missing;
    all.error = std::max(all.error, more.error);
  }
}

void RowPacker::include(const StoredSummary& row) const {
  const std::scoped_lock lock(mutex_);
  summary_.include(row);
}

PackedRow RowPacker::pack(const SplatColumns& splats) const {
  ChunkPacker packer(splats, *this);
  PackedRow row;
  for (const format::Column& column : splats.points.positions.empty() ? resolution_columns_ : all_columns_)
    row.push_back(packer.pack(column));
  if (!splats.points.positions.empty()) include(packer.row());
  return row;
}

Status RowPacker::pack(PendingRow& row) const {
  if (!row.splats) return {};
  SPLATVOL_TRY(read_written(row));
  row.packed = pack(*row.splats);
  return {};
}

Status read_written(PendingRow& row) {
  if (row.written.empty()) return {};
  auto whole = std::make_unique<SplatColumns>(row.splats->splat_values.size());
  for (const FilePart& part : row.written) {
    format::Bytes bytes(part.bytes);
    SPLATVOL_TRY(row.spool->read(part.offset, bytes));
    if (format::hash_bytes(bytes) != part.hash) return fail_changed_temporary();
    whole->append_from(bytes);
  }
  whole->append(*row.splats);
  row.splats = std::move(whole);
  row.written.clear();
  row.written_splats = 0;
  return {};
}

}  // namespace splatvol
