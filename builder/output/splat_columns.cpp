#include "builder/output/splat_columns.h"

#include <cstring>

#include "builder/output/prefetch.h"
#include "format/codec.h"

namespace splatvol {
namespace {

// Calls visit(a, b) for each pair of arrays.
template <class A, class B, class Visit>
void for_each_array(A& a, B& b, const Visit& visit) {
  visit(a.splats.centroids, b.splats.centroids);
  visit(a.splats.errors, b.splats.errors);
  visit(a.splats.shapes, b.splats.shapes);
  visit(a.splats.depths, b.splats.depths);
  visit(a.splats.counts, b.splats.counts);
  visit(a.points.positions, b.points.positions);
  visit(a.points.errors, b.points.errors);
  for (std::size_t i = 0; i < a.splat_values.size(); ++i) {
    visit(a.splat_values[i], b.splat_values[i]);
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
  splats.depths.push_back(splat.depth);
  splats.counts.push_back(splat.count);
  for (std::size_t a = 0; a < values.size(); ++a) {
    splat_values[a].push_back(values[a]);
    prefetch_end(splat_values[a]);
  }
  prefetch_end(splats.centroids);
  prefetch_end(splats.shapes);
}

void SplatColumns::add_point(const PointPosition& point) {
  points.positions.push_back(point.position);
  points.errors.push_back(point.error);
}

void SplatColumns::append(const SplatColumns& other, std::size_t begin, std::size_t end) {
  for_each_array(*this, other, [&](auto& all, const auto& items) {
    const auto at = [&](std::size_t i) { return items.begin() + static_cast<std::ptrdiff_t>(i); };
    if (!items.empty()) all.insert(all.end(), at(begin), at(end));
  });
}

Result<std::uint64_t> SplatColumns::write_to(TempFile& file) const {
  const std::uint64_t begin = file.size();
  std::vector<std::uint64_t> heads;  // of each array: size, hash
  for_each_array(*this, *this, [&](const auto& items, const auto&) {
    heads.push_back(items.size());
    heads.push_back(format::hash_bytes(std::as_bytes(std::span(items))));
  });
  heads.push_back(format::hash_bytes(std::as_bytes(std::span(heads))));
  SPLATVOL_TRY(file.append(std::as_bytes(std::span(heads))));
  Status written;
  for_each_array(*this, *this, [&](const auto& items, const auto&) {
    if (written) written = file.append(std::as_bytes(std::span(items)));
  });
  SPLATVOL_TRY(written);
  return file.size() - begin;
}

Status SplatColumns::read_from(const TempFile& file, std::uint64_t offset) {
  std::size_t arrays = 0;
  for_each_array(*this, *this, [&](const auto&, const auto&) { ++arrays; });
  std::vector<std::uint64_t> heads(2 * arrays + 1);
  SPLATVOL_TRY(file.read(offset, std::as_writable_bytes(std::span(heads))));
  if (heads.back() != format::hash_bytes(std::as_bytes(std::span(heads).first(2 * arrays))))
    return fail_changed_temporary();
  offset += heads.size() * sizeof(std::uint64_t);
  Status done;
  auto head = heads.begin();
  for_each_array(*this, *this, [&](auto& items, const auto&) {
    const std::size_t before = items.size();
    items.resize(before + *head++);
    const auto added = std::as_writable_bytes(std::span(items).subspan(before));
    if (done) done = file.read(offset, added);
    if (done && format::hash_bytes(added) != *head) done = fail_changed_temporary();
    ++head;
    offset += added.size();
  });
  return done;
}

void SplatColumns::put_into(format::Bytes& bytes) const {
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
  const std::size_t splat = sizeof(dvec3) + sizeof(double) + sizeof(SplatShape) + 2;
  const std::size_t point = sizeof(dvec3) + sizeof(double);
  return splat + point + attributes * (sizeof(StoredValue) + sizeof(float) + (gradients ? sizeof(vec3) : 0));
}

void SplatColumns::clear() {
  for_each_array(*this, *this, [](auto& items, const auto&) { items.clear(); });
}

}  // namespace splatvol
