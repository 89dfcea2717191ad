#include "builder/output/splat_columns.h"

#include <algorithm>
#include <cstring>

namespace splatvol {
namespace {

// Calls visit(a, b) for each pair of arrays.
template <class A, class B, class Visit>
void for_each_array(A& a, B& b, const Visit& visit) {
  visit(a.splats.centroids, b.splats.centroids);
  visit(a.splats.shapes, b.splats.shapes);
  visit(a.splats.depths, b.splats.depths);
  visit(a.splats.counts, b.splats.counts);
  visit(a.points.positions, b.points.positions);
  for (std::size_t i = 0; i < a.splat_values.size(); ++i) {
    visit(a.splat_values[i], b.splat_values[i]);
    visit(a.point_values[i].values, b.point_values[i].values);
    visit(a.point_values[i].gradients, b.point_values[i].gradients);
  }
}

}  // namespace

void SplatColumns::reserve(std::size_t size) {
  for_each_array(*this, *this, [&](auto& items, const auto&) { items.reserve(size); });
}

void SplatColumns::add_splat(const StoredSplat& splat, std::span<const StoredValue> values) {
  splats.centroids.push_back(splat.centroid);
  splats.shapes.push_back(splat.shape);
  splats.depths.push_back(splat.depth);
  splats.counts.push_back(splat.count);
  splats.least_error = std::min(splats.least_error, splat.error);
  for (std::size_t a = 0; a < values.size(); ++a) splat_values[a].push_back(values[a]);
}

void SplatColumns::add_point(const PointPosition& point) {
  points.positions.push_back(point.position);
  points.least_error = std::min(points.least_error, point.error);
}

void SplatColumns::append(const SplatColumns& other) {
  for_each_array(*this, other, [](auto& all, const auto& items) { all.insert(all.end(), items.begin(), items.end()); });
  splats.least_error = std::min(splats.least_error, other.splats.least_error);
  points.least_error = std::min(points.least_error, other.points.least_error);
}

void SplatColumns::put_into(format::Bytes& bytes) const {
  format::append_record(bytes, splats.least_error);
  format::append_record(bytes, points.least_error);
  for_each_array(*this, *this, [&](const auto& items, const auto&) {
    format::append_record(bytes, std::uint64_t{items.size()});
    const auto raw = std::as_bytes(std::span(items));
    bytes.insert(bytes.end(), raw.begin(), raw.end());
  });
}

std::size_t SplatColumns::append_from(std::span<const std::byte> bytes) {
  std::size_t at = 0;
  const auto copy = [&](std::span<std::byte> out) {
    if (!out.empty()) std::memcpy(out.data(), bytes.data() + at, out.size());
    at += out.size();
  };
  for (double* least : {&splats.least_error, &points.least_error}) {
    double error = 0;
    copy(std::as_writable_bytes(std::span(&error, 1)));
    *least = std::min(*least, error);
  }
  for_each_array(*this, *this, [&](auto& items, const auto&) {
    const std::size_t before = items.size();
    std::uint64_t count = 0;
    copy(std::as_writable_bytes(std::span(&count, 1)));
    items.resize(before + count);
    copy(std::as_writable_bytes(std::span(items).subspan(before)));
  });
  return at;
}

std::size_t SplatColumns::bytes_of_splat(std::size_t attributes, bool gradients) {
  const std::size_t splat = sizeof(dvec3) + sizeof(SplatShape) + 2;
  return splat + sizeof(dvec3) + attributes * (sizeof(StoredValue) + sizeof(float) + (gradients ? sizeof(vec3) : 0));
}

void SplatColumns::clear() {
  for_each_array(*this, *this, [](auto& items, const auto&) { items.clear(); });
  splats.least_error = points.least_error = std::numeric_limits<double>::infinity();
}

}  // namespace splatvol
