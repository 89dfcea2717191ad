#include "builder/points/batches.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace splatvol {
namespace {

constexpr std::size_t batch_points = std::size_t{1} << 12;

// Of the cells whose material is estimated by itself: the more, the less there is of borders.
constexpr std::size_t block_points = 4096;

void resize_attributes(PointBatch& batch, std::size_t attributes) {
  batch.values.resize(attributes);
  batch.value_moments.resize(attributes);
  batch.gradients.resize(attributes);
}

void resize_material(PointBatch& batch) {
  batch.moments.resize(batch.size());
  for (auto& moments : batch.value_moments) moments.resize(batch.size());
  for (auto& gradients : batch.gradients) gradients.resize(batch.size());
}

Box cell_box(const dvec3& position, const Cube& cube, int depth) {
  const dvec3 center = node_center(position, cube, depth);
  const double half = node_edge(cube, depth) / 2;
  return {center - half, center + half};
}

void estimate_block(const Box& box, const Cube& cube, const NodePart& block, PointBatch& batch, BoxEstimate& estimate) {
  const std::size_t count = block.end - block.begin;
  const auto positions = std::span<const dvec3>(batch.positions).subspan(block.begin, count);
  Box bounds = cell_box(positions[0], cube, block.depth);
  bounds = {glm::max(bounds.low, box.low), glm::min(bounds.high, box.high)};
  // Rounding may have put points a little outside.
  for (const dvec3& p : positions) bounds.include({p, p});
  std::vector<std::span<const double>> values;
  for (const auto& all : batch.values) values.push_back(std::span(all).subspan(block.begin, count));
  EstimatedMaterial result{std::span(batch.moments).subspan(block.begin, count), {}, {}};
  for (auto& all : batch.value_moments) result.value_moments.push_back(std::span(all).subspan(block.begin, count));
  for (auto& all : batch.gradients) result.gradients.push_back(std::span(all).subspan(block.begin, count));
  estimate.estimate(positions, values, bounds, result);
}

// A cell that goes on has its first part's material only: its points are all in one place.
void clear_material(const NodePart& block, PointBatch& batch) {
  const auto clear = [&](auto& items) {
    std::fill(items.begin() + static_cast<std::ptrdiff_t>(block.begin),
              items.begin() + static_cast<std::ptrdiff_t>(block.end),
              typename std::decay_t<decltype(items)>::value_type{});
  };
  clear(batch.moments);
  for (auto& moments : batch.value_moments) clear(moments);
  for (auto& gradients : batch.gradients) clear(gradients);
}

}  // namespace

Batches::Batches(PointStream& stream, std::uint64_t cell_points)
    : stream_(stream),
      next_([&stream](PointBatch& batch) { return stream.next(batch); }),
      box_(stream.summary().box),
      cube_(stream.summary().cube),
      cell_points_(cell_points) {
  resize_attributes(held_, stream.summary().attributes.size());
}

Status Batches::hold_all(const std::function<Status(PointBatch&)>& work) {
  while (!ended_) SPLATVOL_TRY(fill(held_.size() + 1));
  return work(held_);
}

Status Batches::fill(std::size_t points) {
  while (!ended_ && held_.size() - begin_ < points) {
    SPLATVOL_TRY_ASSIGN(more, next_(held_));
    ended_ = !more;
  }
  return {};
}

// The largest cell that begins with a held point and has at most so many; or so many of one key. Requires that more
// are held, or all.
NodePart Batches::cell_at(std::size_t begin, std::size_t most) const {
  const std::vector<MortonKey>& keys = held_.keys;
  const std::size_t end = keys.size();
  const MortonKey& first = keys[begin];
  const int shared = begin > 0 ? common_depth(keys[begin - 1], first) : -1;
  const int depth = leaf_depth(shared, first, begin + most < end ? &keys[begin + most] : nullptr);
  const auto within = std::span(keys).subspan(begin, std::min(most, end - begin));
  const auto past =
      std::ranges::partition_point(within, [&](const MortonKey& key) { return common_depth(first, key) >= depth; });
  return {begin, begin + static_cast<std::size_t>(past - within.begin()), depth, 0,
          begin > 0 && keys[begin - 1] == first};
}

void Batches::take(std::size_t end, PointBatch& batch) const {
  resize_attributes(batch, held_.values.size());
  for_each_array(held_, batch, [&](const auto& from, auto& to) {
    if (from.empty()) return;  // there is none, or it will be estimated over that of the last points
    to.assign(from.begin() + static_cast<std::ptrdiff_t>(begin_), from.begin() + static_cast<std::ptrdiff_t>(end));
  });
  batch.before = begin_ > 0 ? std::optional(held_.positions[begin_ - 1]) : std::nullopt;
  batch.behind = end < held_.size() ? std::optional(held_.positions[end]) : std::nullopt;
}

void Batches::estimate(PointBatch& batch) {
  const std::vector<NodePart>& blocks = batch.blocks;
  if (blocks.empty()) return;
  resize_material(batch);
  tbb::parallel_for(std::size_t{0}, blocks.size(), [&](std::size_t b) {
    if (blocks[b].continued)
      clear_material(blocks[b], batch);
    else
      estimate_block(box_, cube_, blocks[b], batch, estimates_.local());
  });
}

Result<bool> Batches::next(PointBatch& batch) {
  const std::size_t most = std::max(block_points, cell_points_);
  SPLATVOL_TRY(fill(batch_points + most + 1));
  if (begin_ == held_.size()) return false;
  std::vector<NodePart>&blocks = batch.blocks, &cells = batch.cells;
  blocks.clear();
  cells.clear();
  std::size_t end = begin_;
  while (end < held_.size() && end - begin_ < batch_points) {
    blocks.push_back(cell_at(end, most));
    end = blocks.back().end;
  }
  for (std::size_t at = begin_; at < end; at = cells.back().end) {
    cells.push_back(cell_at(at, cell_points_));
    cells.back().end = std::min(cells.back().end, end);  // what goes on with the same key is a part as well
    if (!cells.back().continued) ++leaves_;
    cells.back().leaf = leaves_ - 1;
  }

  take(end, batch);
  for (auto* list : {&blocks, &cells})
    for (NodePart& cell : *list) cell.begin -= begin_, cell.end -= begin_;
  if (!estimates_material_) blocks.clear();
  batch.first = given_;
  given_ += batch.size();

  begin_ = end;
  if (begin_ > held_.size() / 2) {
    for_each_array(held_, held_, [&](auto& items, auto&) {
      items.erase(items.begin(), items.begin() + static_cast<std::ptrdiff_t>(std::min(begin_ - 1, items.size())));
    });
    begin_ = 1;
  }
  return true;
}

}  // namespace splatvol
