#include "builder/output/splat_columns.h"

#include "builder/output/prefetch.h"

namespace splatvol {
namespace {

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

// Fetches the memory of the next element. Many other columns get theirs before, too many for the processor to foresee
// it.
template <class T>
void prefetch_end(const std::vector<T>& items) {
  prefetch_lines(items.data() + items.size(), sizeof(T) + 1);
}

}  // namespace

void SplatColumns::reserve(std::size_t size) {
  for_each_array(*this, *this, [&](auto& items, const auto&) { items.reserve(size); });
}

void SplatColumns::add_splat(const StoredSplat& splat, std::span<const StoredValue> values) {
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

void SplatColumns::add_point(const PointPosition& point) {
  points.positions.push_back(point.position);
  points.errors.push_back(point.error);
}

void SplatColumns::add_point_value(std::size_t attribute, float value, const vec3& gradient) {
  point_values[attribute].values.push_back(value);
  point_values[attribute].gradients.push_back(gradient);
}

void SplatColumns::append(const SplatColumns& other, std::size_t begin, std::size_t end) {
  for_each_array(*this, other, [&](auto& all, const auto& items) {
    const auto at = [&](std::size_t i) { return items.begin() + static_cast<std::ptrdiff_t>(i); };
    if (!items.empty()) all.insert(all.end(), at(begin), at(end));
  });
}

void SplatColumns::clear() {
  for_each_array(*this, *this, [](auto& items, const auto&) { items.clear(); });
}

}  // namespace splatvol
