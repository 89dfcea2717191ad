#include "builder/points/piece_reader.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

constexpr std::size_t points_at_once = 1 << 14;  // records that a task makes

bool is_finite(const dvec3& p) { return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z); }

// A value that single precision cannot hold is taken for some program's fill value, and so for missing.
double present_or_nan(double value) {
  return std::abs(value) <= std::numeric_limits<float>::max() ? value : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace

Status PieceReader::run(const std::function<void(double)>& progress,
                        const std::function<Status(std::span<const std::byte>)>& visit) {
  for (std::size_t pieces = 0;; ++pieces) {
    progress(static_cast<double>(pieces) / static_cast<double>(std::max(source_.piece_count(), pieces + 1)));
    SPLATVOL_TRY_ASSIGN(piece, source_.next());
    if (!piece) break;
    SPLATVOL_TRY(read(*piece));
    SPLATVOL_TRY(visit(records_));
  }
  if (!(box().low.x <= box().high.x)) return fail(ErrorCode::invalid_data, "no point with finite coordinates");
  return {};
}

InputSummary PieceReader::summary() const {
  InputSummary summary;
  summary.box = ranges_.box;
  const std::vector<std::string> units = source_.units();
  for (std::size_t a = 0; a < layout_.attributes(); ++a) {
    summary.attributes.push_back(describe_attribute(source_.attributes()[a], ranges_.low[a], ranges_.high[a]));
    summary.attributes.back().unit = units[a];
  }
  summary.cells = cells_;
  summary.census = census_;
  summary.has_material = has_material_;
  if (cells_.tetrahedra == 0) summary.census.in_no_cell = 0;
  return summary;
}

Status PieceReader::read(const Piece& piece) {
  if (piece.tetrahedra.size() > std::numeric_limits<std::uint32_t>::max())
    return fail(ErrorCode::unsupported, "a piece has {} tetrahedra, which is too many: split it",
                piece.tetrahedra.size());
  const std::vector<std::size_t> kept = find_finite(piece);
  census_.read += piece.points.size();
  census_.not_finite += piece.points.size() - kept.size();
  cells_ += piece.census;
  make_records(piece, kept);
  return add_material(piece, kept);
}

// Indices of the points that are kept.
std::vector<std::size_t> PieceReader::find_finite(const Piece& piece) {
  std::vector<std::size_t> kept(piece.points.size());
  std::size_t count = 0;
  for (std::size_t i = 0; i < piece.points.size(); ++i) {
    kept[count] = i;
    count += is_finite(piece.points[i]) ? 1 : 0;
  }
  kept.resize(count);
  return kept;
}

// Makes the records without material, and finds the ranges.
void PieceReader::make_records(const Piece& piece, std::span<const std::size_t> kept) {
  const std::size_t count = kept.size();
  records_.resize(count * layout_.bytes());
  std::vector<PointRanges> ranges((count + points_at_once - 1) / points_at_once, PointRanges(layout_.attributes()));
  tbb::parallel_for(std::size_t{0}, ranges.size(), [&](std::size_t r) {
    const std::size_t first = r * points_at_once;
    const auto part = kept.subspan(first, std::min(points_at_once, count - first));
    make_part(piece, part, record_of(first));
    find_ranges(piece, part, ranges[r]);
  });
  for (const PointRanges& range : ranges) ranges_.include(range);  // in order, as 0 and -0 are equal
}

void PieceReader::make_part(const Piece& piece, std::span<const std::size_t> kept, std::byte* record) const {
  if (layout_.has_material()) std::memset(record, 0, kept.size() * layout_.bytes());
  for (const std::size_t i : kept) {
    layout_.set_position(record, piece.points[i]);
    for (std::size_t a = 0; a < layout_.attributes(); ++a)
      layout_.set_value(record, a, present_or_nan(piece.values[a][i]));
    record += layout_.bytes();
  }
}

void PieceReader::find_ranges(const Piece& piece, std::span<const std::size_t> kept, PointRanges& ranges) const {
  for (const std::size_t i : kept) ranges.box.include(piece.points[i]);
  for (std::size_t a = 0; a < layout_.attributes(); ++a) {
    double low = infinity, high = -infinity;
    for (const std::size_t i : kept) {
      const double value = present_or_nan(piece.values[a][i]);
      low = value < low ? value : low;
      high = value > high ? value : high;
    }
    ranges.low[a] = low;
    ranges.high[a] = high;
  }
}

Status PieceReader::add_material(const Piece& piece, std::span<const std::size_t> kept) {
  if (layout_.has_material() && piece.material) {
    add_known_material(*piece.material, kept);
    return {};
  }
  if (layout_.has_material() && piece.cells) return add_whole_cells(piece, kept);
  if (layout_.has_material() && !piece.tetrahedra.empty()) return add_cell_material(piece, kept);
  census_.in_no_cell += kept.size();
  return {};
}

void PieceReader::add_known_material(const PointMaterial& material, std::span<const std::size_t> kept) {
  has_material_ = true;
  tbb::parallel_for(std::size_t{0}, kept.size(), [&](std::size_t k) {
    layout_.set_vertex(record_of(k), {1.0, material.moments[kept[k]]});
    for (std::size_t a = 0; a < layout_.attributes(); ++a)
      layout_.set_value_part(record_of(k), a, {material.value_moments[a][kept[k]], material.gradients[a][kept[k]]});
    if (!material.planes.empty()) layout_.set_plane(record_of(k), material.planes[kept[k]]);
  });
}

// Each point has a whole cell, and one value in it.
Status PieceReader::add_whole_cells(const Piece& piece, std::span<const std::size_t> kept) {
  has_material_ = has_material_ || !piece.points.empty();
  tbb::parallel_for(std::size_t{0}, kept.size(), [&](std::size_t k) {
    const SpatialMoments& moments = piece.cells->moments[kept[k]];
    layout_.set_vertex(record_of(k), {1.0, moments});
    for (std::size_t a = 0; a < layout_.attributes(); ++a) {
      const double value = present_or_nan(piece.values[a][kept[k]]);
      if (std::isnan(value)) continue;
      PointRecords::ValuePart part;
      part.moments.mass = moments.mass;
      part.moments.centroid = moments.centroid;
      part.moments.mean = part.moments.min = part.moments.max = value;
      layout_.set_value_part(record_of(k), a, part);
    }
  });
  return faces_.add_cells(piece, kept, records_);
}

Status PieceReader::add_cell_material(const Piece& piece, std::span<const std::size_t> kept) {
  has_material_ = true;
  std::vector<bool> used(piece.points.size());
  for (const auto& corners : piece.tetrahedra)
    for (const std::uint32_t corner : corners) used[corner] = true;
  for (const std::size_t i : kept) census_.in_no_cell += used[i] ? 0 : 1;

  std::vector<std::vector<double>> values = piece.values;
  for (std::vector<double>& of_attribute : values)
    std::ranges::transform(of_attribute, of_attribute.begin(), present_or_nan);
  const VertexMaterial mesh(piece.points, piece.tetrahedra);
  tbb::parallel_for(std::size_t{0}, kept.size(), [&](std::size_t k) {
    layout_.set_vertex(record_of(k), {used[kept[k]] ? 1.0 : 0.0, mesh.moments(kept[k])});
    for (std::size_t a = 0; a < layout_.attributes(); ++a)
      layout_.set_value_part(record_of(k), a,
                             {mesh.value_moments(kept[k], values[a]), mesh.gradient(kept[k], values[a])});
  });
  return faces_.add(piece, kept, records_);
}

}  // namespace splatvol
