#include "builder/points/sample_merger.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <span>
#include <tuple>

namespace splatvol {
namespace {

std::tuple<double, double, double> position_of(const PointRecords& layout, const std::byte* record) {
  const dvec3 p = layout.position(record);
  return {p.x, p.y, p.z};
}

std::span<const std::byte> values_of(const PointRecords& layout, const std::byte* record) {
  return layout.sample(record).subspan(layout.position_bytes());
}

// Orders the samples of one position; those that are not told apart are equal. Vertices of cells stand together: a
// point of no cell between two copies would part them.
bool is_less(const PointRecords& layout, const std::byte* a, const std::byte* b) {
  if (layout.has_material()) {
    const std::uint64_t block = layout.block(a), other = layout.block(b);
    if ((block == 0) != (other == 0)) return other == 0;
    if (layout.copies() == VertexCopies::same_block && block != other) return block < other;
  }
  if (layout.copies() == VertexCopies::same_values)
    return std::ranges::lexicographical_compare(values_of(layout, a), values_of(layout, b));
  for (std::size_t i = 0; i < layout.attributes(); ++i) {
    const bool missing = std::isnan(layout.value(a, i)), other_missing = std::isnan(layout.value(b, i));
    if (missing != other_missing) return other_missing;
  }
  return false;
}

}  // namespace

SampleMerger::SampleMerger(const PointRecords& layout, bool has_material, std::span<const std::size_t> stored)
    : layout_(layout), has_material_(has_material) {
  for (std::size_t a = 0; a < stored.size(); ++a)
    if (stored[a] == taken_.size()) taken_.push_back(a);
}

std::span<const std::size_t> SampleMerger::append(const std::byte* records, std::size_t count, const MortonKey& key,
                                                  PointBatch& batch, PointCensus& census) {
  points_.assign(count, batch.size());
  if (count == 1) {
    count_if_repeated(records, records, key, census);
    append_point(records, key, batch);
    return points_;
  }
  const auto record = [&](std::size_t i) { return records + i * layout_.bytes(); };
  const std::vector<std::size_t> order = sort_samples(records, count);
  count_if_repeated(record(order.front()), record(order.back()), key, census);
  const std::vector<std::size_t> kept = find_kept(records, order, census);
  for (std::size_t i = 0; i < count; ++i) {
    if (kept[i] == i) {
      points_[i] = batch.size();
      append_point(record(i), key, batch);
    } else {
      points_[i] = points_[kept[i]];
      merge_into(points_[i], record(i), batch);
    }
  }
  return points_;
}

// Counts a run of records as coincident if it begins at the position where the last run ended.
void SampleMerger::count_if_repeated(const std::byte* first, const std::byte* last, const MortonKey& key,
                                     PointCensus& census) {
  if (last_key_ == key && last_position_ == layout_.position(first)) ++census.coincident;
  last_key_ = key;
  last_position_ = layout_.position(last);
}

// Returns the indices of the records, equal samples side by side, the first of the input in front.
std::vector<std::size_t> SampleMerger::sort_samples(const std::byte* records, std::size_t count) const {
  std::vector<std::size_t> order(count);
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, [&](std::size_t i, std::size_t j) {
    const std::byte *a = records + i * layout_.bytes(), *b = records + j * layout_.bytes();
    if (position_of(layout_, a) != position_of(layout_, b)) return position_of(layout_, a) < position_of(layout_, b);
    return is_less(layout_, a, b);
  });
  return order;
}

// Finds for each record the one that is kept of its sample.
std::vector<std::size_t> SampleMerger::find_kept(const std::byte* records, const std::vector<std::size_t>& order,
                                                 PointCensus& census) const {
  const auto record = [&](std::size_t i) { return records + i * layout_.bytes(); };
  const auto position = [&](std::size_t i) { return position_of(layout_, record(i)); };
  const auto is_in_cell = [&](std::size_t i) { return layout_.has_material() && layout_.block(record(i)) != 0; };
  const auto is_same_sample = [&](std::size_t i, std::size_t j) {
    return layout_.copies() != VertexCopies::none && position(i) == position(j) &&
           !is_less(layout_, record(i), record(j)) && !is_less(layout_, record(j), record(i));
  };
  std::vector<std::size_t> kept(order.size());
  std::size_t present = order[0];
  kept[present] = present;
  for (std::size_t k = 1; k < order.size(); ++k) {
    const std::size_t next = order[k];
    const bool coincident = position(next) == position(order[k - 1]);
    if (coincident && is_in_cell(present) && is_in_cell(next) && is_same_sample(present, next)) {
      kept[next] = present;
      ++census.merged;
      if (!std::ranges::equal(values_of(layout_, record(present)), values_of(layout_, record(next)))) ++census.unlike;
      continue;
    }
    if (coincident) ++census.coincident;
    kept[next] = present = next;
  }
  return kept;
}

void SampleMerger::append_point(const std::byte* record, const MortonKey& key, PointBatch& batch) const {
  batch.keys.push_back(key);
  batch.positions.push_back(layout_.position(record));
  for (std::size_t a = 0; a < taken_.size(); ++a) batch.values[a].push_back(layout_.value(record, taken_[a]));
  if (!has_material_) return;
  const PointRecords::VertexPart vertex = layout_.vertex(record);
  batch.moments.push_back(vertex.moments);
  batch.heights.push_back(vertex.height);
  for (std::size_t a = 0; a < taken_.size(); ++a) {
    const PointRecords::ValuePart part = layout_.value_part(record, taken_[a]);
    batch.value_moments[a].push_back(part.moments);
    if (layout_.has_gradients()) batch.gradients[a].push_back(part.gradient);
  }
  if (layout_.has_planes()) batch.planes.push_back(layout_.plane(record));
}

// Copies of a vertex own what each piece gives them.
void SampleMerger::merge_into(std::size_t point, const std::byte* record, PointBatch& batch) const {
  const PointRecords::VertexPart vertex = layout_.vertex(record);
  merge(batch.moments[point], vertex.moments, dvec3(0));
  batch.heights[point] = std::min(batch.heights[point], vertex.height);
  for (std::size_t a = 0; a < taken_.size(); ++a) {
    const PointRecords::ValuePart part = layout_.value_part(record, taken_[a]);
    merge(batch.value_moments[a][point], part.moments, dvec3(0));
    if (layout_.has_gradients()) batch.gradients[a][point] += part.gradient;
  }
}

}  // namespace splatvol
