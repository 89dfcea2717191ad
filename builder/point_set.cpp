#include "builder/point_set.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>

namespace splatvol {
namespace {

constexpr float no_spacing = std::numeric_limits<float>::infinity();

bool is_finite(const dvec3& p) { return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z); }

// Shortest edge at each point of a piece, over its tetrahedra. Edges of no length say nothing of the spacing.
std::vector<float> shortest_edges(const Piece& piece) {
  std::vector<float> shortest(piece.points.size(), no_spacing);
  for (const auto& corners : piece.tetrahedra)
    for (int a = 0; a < 4; ++a)
      for (int b = a + 1; b < 4; ++b) {
        const std::uint32_t i = corners[static_cast<std::size_t>(a)], j = corners[static_cast<std::size_t>(b)];
        const auto length = static_cast<float>(glm::length(piece.points[i] - piece.points[j]));
        if (!(length > 0)) continue;
        shortest[i] = std::min(shortest[i], length);
        shortest[j] = std::min(shortest[j], length);
      }
  return shortest;
}

// Points in input order, before sorting.
struct Gathered {
  PointSet points;
  std::vector<bool> in_cell;
};

void append_piece(const Piece& piece, Gathered& all) {
  PointSet& points = all.points;
  std::vector<bool> used(piece.points.size());
  for (const auto& corners : piece.tetrahedra)
    for (const std::uint32_t corner : corners) used[corner] = true;
  const std::vector<float> shortest = shortest_edges(piece);
  for (std::size_t i = 0; i < piece.points.size(); ++i) {
    ++points.census.read;
    if (!is_finite(piece.points[i])) {
      ++points.census.not_finite;
      continue;
    }
    points.positions.push_back(piece.points[i]);
    points.spacings.push_back(shortest[i]);
    for (std::size_t a = 0; a < points.values.size(); ++a) points.values[a].push_back(piece.values[a][i]);
    all.in_cell.push_back(used[i]);
  }
  points.cells += piece.census;
}

// The smallest cube round the points; of edge 1 where they all coincide, as a size must come from somewhere.
Result<Cube> bounding_cube(const std::vector<dvec3>& positions) {
  dvec3 low = positions.front(), high = low;
  for (const dvec3& p : positions) {
    low = glm::min(low, p);
    high = glm::max(high, p);
  }
  const dvec3 extent = high - low;
  const double edge = std::max({extent.x, extent.y, extent.z});
  if (!std::isfinite(edge)) return fail(ErrorCode::invalid_data, "the points lie too far apart for double precision");
  return Cube{low, edge > std::numeric_limits<double>::min() ? edge : 1.0};
}

bool same_sample(const PointSet& points, std::size_t i, std::size_t j) {
  if (points.positions[i] != points.positions[j]) return false;
  return std::ranges::all_of(points.values, [&](const std::vector<double>& values) {
    return std::bit_cast<std::uint64_t>(values[i]) == std::bit_cast<std::uint64_t>(values[j]);
  });
}

// An order that puts equal samples side by side, the first in the input in front.
bool sample_before(const PointSet& points, std::size_t i, std::size_t j) {
  const dvec3 &p = points.positions[i], &q = points.positions[j];
  if (p != q) return std::tie(p.x, p.y, p.z) < std::tie(q.x, q.y, q.z);
  for (const std::vector<double>& values : points.values) {
    const auto a = std::bit_cast<std::uint64_t>(values[i]), b = std::bit_cast<std::uint64_t>(values[j]);
    if (a != b) return a < b;
  }
  return i < j;
}

// Neighbouring pieces of a mesh repeat their common vertices. Within a run of equal keys, keeps the first of equal
// samples that belong to cells; points of no cell are samples of their own, however often they come.
void merge_run(Gathered& all, std::vector<std::uint64_t>& run, std::vector<bool>& dropped) {
  PointSet& points = all.points;
  std::ranges::sort(run, [&](std::uint64_t i, std::uint64_t j) { return sample_before(points, i, j); });
  std::uint64_t kept = run[0];
  for (std::size_t k = 1; k < run.size(); ++k) {
    const std::uint64_t next = run[k];
    const bool coincident = points.positions[next] == points.positions[run[k - 1]];
    if (same_sample(points, kept, next) && all.in_cell[kept] && all.in_cell[next]) {
      points.spacings[kept] = std::min(points.spacings[kept], points.spacings[next]);
      dropped[next] = true;
      ++points.census.merged;
      continue;
    }
    if (coincident) ++points.census.coincident;
    kept = next;
  }
}

void merge_equal_samples(Gathered& all, const std::vector<MortonKey>& keys, std::vector<std::uint64_t>& order) {
  std::vector<bool> dropped(order.size());
  std::vector<std::uint64_t> run;
  for (std::size_t begin = 0; begin < order.size();) {
    std::size_t end = begin + 1;
    while (end < order.size() && keys[order[end]] == keys[order[begin]]) ++end;
    if (end - begin > 1) {
      run.assign(order.begin() + static_cast<std::ptrdiff_t>(begin), order.begin() + static_cast<std::ptrdiff_t>(end));
      merge_run(all, run, dropped);
    }
    begin = end;
  }
  std::erase_if(order, [&](std::uint64_t i) { return dropped[i]; });
}

template <class T>
void reorder(std::vector<T>& items, const std::vector<std::uint64_t>& order) {
  std::vector<T> sorted(order.size());
  tbb::parallel_for(std::size_t{0}, order.size(), [&](std::size_t i) { sorted[i] = items[order[i]]; });
  items = std::move(sorted);
}

}  // namespace

Result<PointSet> gather_points(Source& source, const std::function<void(double)>& progress) {
  Gathered all;
  PointSet& points = all.points;
  points.attributes = source.attributes();
  points.values.resize(points.attributes.size());
  for (std::size_t pieces = 0;; ++pieces) {
    progress(static_cast<double>(pieces) / static_cast<double>(std::max(source.piece_count(), pieces + 1)));
    SPLATVOL_TRY_ASSIGN(piece, source.next());
    if (!piece) break;
    append_piece(*piece, all);
  }
  if (points.positions.empty()) return fail(ErrorCode::invalid_data, "no point with finite coordinates");
  SPLATVOL_TRY_ASSIGN(cube, bounding_cube(points.positions));
  points.cube = cube;
  if (points.cells.tetrahedra > 0)
    points.census.in_no_cell = static_cast<std::uint64_t>(std::ranges::count(all.in_cell, false));

  points.keys.resize(points.size());
  tbb::parallel_for(std::size_t{0}, points.size(),
                    [&](std::size_t i) { points.keys[i] = morton_key(points.positions[i], cube); });
  std::vector<std::uint64_t> order(points.size());
  std::iota(order.begin(), order.end(), std::uint64_t{0});
  tbb::parallel_sort(order.begin(), order.end(), [&](std::uint64_t i, std::uint64_t j) {
    return points.keys[i] != points.keys[j] ? points.keys[i] < points.keys[j] : i < j;
  });
  merge_equal_samples(all, points.keys, order);

  reorder(points.positions, order);
  reorder(points.keys, order);
  reorder(points.spacings, order);
  for (std::vector<double>& values : points.values) reorder(values, order);
  return std::move(points);
}

}  // namespace splatvol
