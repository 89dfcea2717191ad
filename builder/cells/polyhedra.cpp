#include "builder/cells/polyhedra.h"

#include <algorithm>
#include <array>
#include <bitset>
#include <cstring>
#include <numeric>
#include <utility>

#include "builder/cells/packed_numbers.h"
#include "format/codec.h"

namespace splatvol {
namespace {

// Numbers corners in the order in which they come.
class CornerNumbers {
 public:
  // `corners`: gets them.
  explicit CornerNumbers(std::vector<std::uint64_t>& corners) : corners_(corners) { corners_.clear(); }

  // A number up to max_polyhedron_corners + 3, cut to a byte.
  std::uint8_t of(std::uint32_t corner) {
    std::size_t slot = corner * std::uint32_t{0x9e3779b9} >> (32 - slot_bits);
    for (; ends_[slot] > 0; slot = (slot + 1) % ends_.size())
      if (corners_[ends_[slot] - 1u] == corner) return static_cast<std::uint8_t>(ends_[slot] - 1);
    corners_.push_back(corner);
    ends_[slot] = static_cast<std::uint16_t>(corners_.size());
    return static_cast<std::uint8_t>(corners_.size() - 1);
  }

 private:
  static constexpr int slot_bits = 10;
  std::vector<std::uint64_t>& corners_;
  std::array<std::uint16_t, std::size_t{1} << slot_bits> ends_{};  // [slot of a hash]: the corner's number + 1; 0: none
};

}  // namespace

bool join_tetrahedra(std::span<const Tetrahedron> tetrahedra, Polyhedron& polyhedron) {
  if (tetrahedra.size() < 2 || tetrahedra.size() > format::surface_triangles(format::max_polyhedron_corners))
    return false;
  const std::uint32_t apex = tetrahedra[0][3];
  CornerNumbers numbers(polyhedron.corners);
  polyhedron.apex = numbers.of(apex);

  // The apex is opposite to these triangles.
  std::vector<format::SurfaceTriangle>& triangles = polyhedron.triangles;
  triangles.clear();
  for (const auto& [a, b, c, d] : tetrahedra) {
    if (d != apex || a == apex || b == apex || c == apex) return false;
    triangles.push_back({numbers.of(a), numbers.of(c), numbers.of(b)});
    if (polyhedron.corners.size() > format::max_polyhedron_corners) return false;
  }

  // An edge of one of them that no other has the other way round belongs to a triangle with the apex.
  std::bitset<format::max_polyhedron_corners * format::max_polyhedron_corners> edges;
  const auto edge = [&](std::size_t from, std::size_t to) { return from * polyhedron.corners.size() + to; };
  for (const auto& [u, v, w] : triangles)
    for (const std::size_t e : {edge(u, v), edge(v, w), edge(w, u)}) edges.set(e);
  for (std::size_t t = 0; t < tetrahedra.size(); ++t) {
    const auto [u, v, w] = triangles[t];
    for (const auto& [from, to] : {std::pair(u, v), std::pair(v, w), std::pair(w, u)})
      if (!edges[edge(to, from)]) triangles.push_back({to, from, polyhedron.apex});
  }
  if (triangles.size() != format::surface_triangles(polyhedron.corners.size())) return false;
  const std::vector<std::uint64_t> corners = polyhedron.corners;
  return renumber(corners, polyhedron);
}

bool renumber(std::span<const std::uint64_t> numbers, Polyhedron& polyhedron) {
  std::array<std::uint8_t, format::max_polyhedron_corners> order, places;
  const auto ascending = std::span(order).first(numbers.size());
  std::iota(ascending.begin(), ascending.end(), std::uint8_t{0});
  const auto number = [&](std::uint8_t corner) { return numbers[corner]; };
  std::ranges::sort(ascending, {}, number);
  if (std::ranges::adjacent_find(ascending, {}, number) != ascending.end()) return false;
  for (std::size_t place = 0; place < ascending.size(); ++place) {
    places[ascending[place]] = static_cast<std::uint8_t>(place);
    polyhedron.corners[place] = numbers[ascending[place]];
  }
  polyhedron.apex = places[polyhedron.apex];
  for (format::SurfaceTriangle& triangle : polyhedron.triangles)
    for (std::uint8_t& corner : triangle) corner = places[corner];
  return true;
}

bool put_polyhedron(const Polyhedron& polyhedron, std::vector<std::byte>& bytes) {
  const std::size_t begin = bytes.size(), corners = polyhedron.corners.size();
  bytes.resize(begin + 3);
  const format::SurfaceCoding coding = format::encode_surface(polyhedron.triangles, corners, bytes);
  if (coding == format::SurfaceCoding::failed) {
    bytes.resize(begin);
    return false;
  }
  const int sign = coding == format::SurfaceCoding::mirrored ? -polyhedron.sign : polyhedron.sign;
  bytes[begin] = static_cast<std::byte>(sign + 1);
  bytes[begin + 1] = static_cast<std::byte>(corners);
  bytes[begin + 2] = static_cast<std::byte>(polyhedron.apex);
  put_number(bytes, polyhedron.point);
  std::uint64_t before = 0;
  for (const std::uint64_t corner : polyhedron.corners) {
    put_number(bytes, corner - before);
    before = corner;
  }
  return true;
}

void get_polyhedron(std::span<const std::byte>& bytes, Polyhedron& polyhedron) {
  const auto corners = std::to_integer<std::size_t>(bytes[1]), code = format::surface_code_bytes(corners);
  polyhedron.sign = std::to_integer<int>(bytes[0]) - 1;
  polyhedron.apex = std::to_integer<std::uint8_t>(bytes[2]);
  polyhedron.triangles.resize(format::surface_triangles(corners));
  [[maybe_unused]] const bool is_whole = format::decode_surface(bytes.subspan(3, code), corners, polyhedron.triangles);
  bytes = bytes.subspan(3 + code);
  polyhedron.point = get_number(bytes);
  polyhedron.corners.clear();
  std::uint64_t before = 0;
  while (polyhedron.corners.size() < corners) polyhedron.corners.push_back(before += get_number(bytes));
}

}  // namespace splatvol
