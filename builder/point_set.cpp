#include "builder/point_set.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>

namespace splatvol {
namespace {

bool is_finite(const dvec3& p) { return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z); }

// What single precision cannot hold is taken for the fill value of a program, that is for missing.
bool is_present(double value) { return std::abs(value) <= std::numeric_limits<float>::max(); }

// Points in input order, before sorting.
struct Gathered {
  PointSet points;
  std::vector<bool> in_cell;
  std::vector<OuterFace> faces;            // of the pieces, by indices of these points
  std::vector<std::uint64_t> merged_into;  // [point]: that of the same sample which is kept
};

template <class T>
void append(std::vector<T>& all, const std::vector<T>& items, const std::vector<std::size_t>& kept) {
  if (all.empty()) all.reserve(kept.size());
  for (const std::size_t i : kept) all.push_back(items[i]);
}

void resize_material(PointSet& points, std::size_t size) {
  points.material.moments.resize(size);
  for (auto& moments : points.material.value_moments) moments.resize(size);
  for (auto& gradients : points.gradients) gradients.resize(size);
}

// Tetrahedra use points with a finite position only: those that are kept, and numbered from `begin` on.
void append_faces(const Piece& piece, const std::vector<std::size_t>& kept, std::size_t begin,
                  std::vector<OuterFace>& faces) {
  std::vector<std::uint64_t> places(piece.points.size());
  for (std::size_t k = 0; k < kept.size(); ++k) places[kept[k]] = begin + k;
  for (OuterFace face : find_outer_faces(piece.points, piece.tetrahedra)) {
    for (std::uint64_t& corner : face.corners) corner = places[corner];
    faces.push_back(face);
  }
}

// The faces between pieces vanish where their vertices have been merged. `order`: point of each final place.
void find_planes(Gathered& all, const std::vector<std::uint64_t>& order) {
  if (all.points.material.moments.empty()) return;
  std::vector<std::uint64_t> places(all.merged_into.size());
  for (std::size_t i = 0; i < order.size(); ++i) places[order[i]] = i;
  for (std::size_t i = 0; i < places.size(); ++i) places[i] = places[all.merged_into[i]];
  join_outer_faces(all.faces, places);
  all.points.material.planes = boundary_planes(all.points.positions, all.faces);
}

Status append_piece(Piece& piece, bool use_cells, Gathered& all) {
  if (piece.tetrahedra.size() > std::numeric_limits<std::uint32_t>::max())
    return fail(ErrorCode::unsupported, "a piece has {} tetrahedra, which is too many: split it",
                piece.tetrahedra.size());
  for (std::vector<double>& values : piece.values)
    std::ranges::replace_if(values, std::not_fn(is_present), std::numeric_limits<double>::quiet_NaN());
  std::vector<bool> used(piece.points.size());
  for (const auto& corners : piece.tetrahedra)
    for (const std::uint32_t corner : corners) used[corner] = true;
  std::vector<std::size_t> kept;
  for (std::size_t i = 0; i < piece.points.size(); ++i)
    if (is_finite(piece.points[i])) kept.push_back(i);

  PointSet& points = all.points;
  points.census.read += piece.points.size();
  points.census.not_finite += piece.points.size() - kept.size();
  append(points.positions, piece.points, kept);
  for (std::size_t a = 0; a < points.values.size(); ++a) append(points.values[a], piece.values[a], kept);
  for (const std::size_t i : kept) all.in_cell.push_back(used[i]);
  if (use_cells && !piece.tetrahedra.empty()) {
    resize_material(points, points.size() - kept.size());  // pieces without cells gave none
    append_material(VertexMaterial(piece.points, piece.tetrahedra), piece.values, kept, points);
    append_faces(piece, kept, points.size() - kept.size(), all.faces);
  }
  points.cells += piece.census;
  return {};
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

// Two copies of a vertex own what each piece gives them.
void merge_material(PointSet& points, std::size_t kept, std::size_t next) {
  if (points.material.moments.empty()) return;
  merge(points.material.moments[kept], points.material.moments[next], dvec3(0));
  for (auto& moments : points.material.value_moments) merge(moments[kept], moments[next], dvec3(0));
  for (auto& gradients : points.gradients) gradients[kept] += gradients[next];
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
      merge_material(points, kept, next);
      dropped[next] = true;
      all.merged_into[next] = kept;
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
  if (items.empty()) return;
  std::vector<T> sorted(order.size());
  tbb::parallel_for(std::size_t{0}, order.size(), [&](std::size_t i) { sorted[i] = items[order[i]]; });
  items = std::move(sorted);
}

}  // namespace

void append_material(const VertexMaterial& mesh, const std::vector<std::vector<double>>& values,
                     std::span<const std::size_t> vertices, PointSet& points) {
  const std::size_t begin = points.material.moments.size(), end = begin + vertices.size();
  resize_material(points, end);
  tbb::parallel_for(begin, end, [&](std::size_t i) {
    const std::size_t vertex = vertices[i - begin];
    points.material.moments[i] = mesh.moments(vertex);
    for (std::size_t a = 0; a < values.size(); ++a) {
      points.material.value_moments[a][i] = mesh.value_moments(vertex, values[a]);
      points.gradients[a][i] = mesh.gradient(vertex, values[a]);
    }
  });
}

Result<PointSet> gather_points(Source& source, bool use_cells, const std::function<void(double)>& progress) {
  Gathered all;
  PointSet& points = all.points;
  points.attributes = source.attributes();
  points.values.resize(points.attributes.size());
  points.material.value_moments.resize(points.attributes.size());
  points.gradients.resize(points.attributes.size());
  for (std::size_t pieces = 0;; ++pieces) {
    progress(static_cast<double>(pieces) / static_cast<double>(std::max(source.piece_count(), pieces + 1)));
    SPLATVOL_TRY_ASSIGN(piece, source.next());
    if (!piece) break;
    SPLATVOL_TRY(append_piece(*piece, use_cells, all));
  }
  if (points.positions.empty()) return fail(ErrorCode::invalid_data, "no point with finite coordinates");
  if (!points.material.moments.empty()) resize_material(points, points.size());
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
  all.merged_into.resize(points.size());
  std::iota(all.merged_into.begin(), all.merged_into.end(), std::uint64_t{0});
  merge_equal_samples(all, points.keys, order);

  reorder(points.positions, order);
  reorder(points.keys, order);
  for (std::vector<double>& values : points.values) reorder(values, order);
  reorder(points.material.moments, order);
  for (auto& moments : points.material.value_moments) reorder(moments, order);
  for (auto& gradients : points.gradients) reorder(gradients, order);
  find_planes(all, order);
  return std::move(points);
}

}  // namespace splatvol
