#include "format/polyhedron.h"

#include <algorithm>
#include <bit>
#include <optional>

namespace splatvol::format {
namespace {

struct Edge {
  std::uint8_t from, to;
};

constexpr std::size_t most_triangles = surface_triangles(max_polyhedron_corners);

// A set of corners of a polyhedron that has no more than 64 * words.
template <std::size_t words>
class CornerSet {
 public:
  void set(std::size_t corner) { bits_[corner / 64] |= bit(corner); }
  [[nodiscard]] bool has(std::size_t corner) const { return (bits_[corner / 64] & bit(corner)) != 0; }

  [[nodiscard]] std::size_t count() const {
    std::size_t count = 0;
    for (const std::uint64_t word : bits_) count += static_cast<std::size_t>(std::popcount(word));
    return count;
  }

  // The number of lower corners.
  [[nodiscard]] std::size_t count_below(std::size_t corner) const {
    auto count = static_cast<std::size_t>(std::popcount(bits_[corner / 64] & (bit(corner) - 1)));
    for (std::size_t w = 0; w < corner / 64; ++w) count += static_cast<std::size_t>(std::popcount(bits_[w]));
    return count;
  }

  // Undoes count_below(). Requires number < count().
  [[nodiscard]] std::size_t corner_at(std::size_t number) const {
    std::size_t w = 0;
    for (; number >= static_cast<std::size_t>(std::popcount(bits_[w])); ++w)
      number -= static_cast<std::size_t>(std::popcount(bits_[w]));
    std::uint64_t word = bits_[w];
    for (; number > 0; --number) word &= word - 1;
    return w * 64 + static_cast<std::size_t>(std::countr_zero(word));
  }

  void add(const CornerSet& other) {
    for (std::size_t w = 0; w < words; ++w) bits_[w] |= other.bits_[w];
  }
  [[nodiscard]] CornerSet without(const CornerSet& other) const {
    CornerSet rest;
    for (std::size_t w = 0; w < words; ++w) rest.bits_[w] = bits_[w] & ~other.bits_[w];
    return rest;
  }

 private:
  static constexpr std::uint64_t bit(std::size_t corner) { return std::uint64_t{1} << corner % 64; }
  std::array<std::uint64_t, words> bits_{};
};

// A surface that grows triangle by triangle at the edge that has been open for longest. An edge is open if there is a
// triangle at its reverse, and none at itself.
template <std::size_t words>
class GrowingSurface {
 public:
  GrowingSurface(std::size_t corners, std::uint8_t second) : corners_(corners) {
    for (std::size_t corner = 0; corner < corners; ++corner) {
      all_.set(corner);
      from_[corner] = to_[corner] = {};
    }
    queue_[end_++] = {0, second};
  }

  // Returns the edge of the next triangle; none: the surface is closed.
  std::optional<Edge> next_edge() {
    for (; first_ < end_; ++first_)
      if (const Edge edge = queue_[first_]; !from_[edge.from].has(edge.to)) return edge;
    return std::nullopt;
  }
  [[nodiscard]] bool uses_all() const { return used_.count() == corners_; }

  // Returns the number of a third corner among the candidates for it. Requires that it is none of the edge.
  [[nodiscard]] std::uint8_t number_of(Edge edge, std::size_t corner) const {
    std::size_t before = 0, number = 0;
    for_each_group(edge, [&](const Set& group) {
      const bool is_here = group.has(corner);
      number = before + (is_here ? group.count_below(corner) : 0);
      before += group.count();
      return is_here;
    });
    return static_cast<std::uint8_t>(number);
  }

  // Undoes number_of(); none: there are not so many.
  [[nodiscard]] std::optional<std::uint8_t> corner_of(Edge edge, std::size_t number) const {
    std::optional<std::uint8_t> corner;
    for_each_group(edge, [&](const Set& group) {
      const std::size_t count = group.count();
      if (number >= count) {
        number -= count;
        return false;
      }
      corner = static_cast<std::uint8_t>(group.corner_at(number));
      return true;
    });
    return corner;
  }

  // Adds a triangle. Returns false if an edge has one already.
  bool add(Edge edge, std::uint8_t third) {
    used_.set(edge.from), used_.set(edge.to), used_.set(third);
    return close(edge) && close({edge.to, third}) && close({third, edge.from});
  }

 private:
  using Set = CornerSet<words>;

  // Calls visit(corners) for groups of candidates until it returns true. The likeliest come first: corners at which the
  // triangle closes an open edge, then unused ones.
  template <class Visit>
  void for_each_group(Edge edge, const Visit& visit) const {
    Set seen;
    seen.set(edge.from), seen.set(edge.to);
    const auto is_last = [&](const Set& all) {
      const Set group = all.without(seen);
      seen.add(group);
      return visit(group);
    };
    is_last(to_[edge.to].without(from_[edge.to])) || is_last(from_[edge.from].without(to_[edge.from])) ||
        is_last(all_.without(used_)) || is_last(used_);
  }

  bool close(Edge edge) {
    if (from_[edge.from].has(edge.to)) return false;
    from_[edge.from].set(edge.to);
    to_[edge.to].set(edge.from);
    if (!from_[edge.to].has(edge.from)) queue_[end_++] = {edge.to, edge.from};
    return true;
  }

  std::size_t corners_;
  Set all_, used_;
  std::array<Set, 64 * words> from_, to_;  // [corner]: the other ends of edges that have a triangle
  std::array<Edge, 3 * most_triangles + 1> queue_;
  std::size_t first_ = 0, end_ = 0;  // of it
};

// The triangles of a surface by their edges.
class TriangleTable {
 public:
  static constexpr std::uint8_t none = 255;

  // Returns whether no edge has two triangles.
  bool fill(std::span<const SurfaceTriangle> triangles, std::size_t corners) {
    corners_ = corners;
    std::fill_n(thirds_.begin(), corners * corners, none);
    for (const auto& [a, b, c] : triangles)
      if (a == b || b == c || c == a || !set(a, b, c) || !set(b, c, a) || !set(c, a, b)) return false;
    return true;
  }
  void mirror() { mirrored_ = !mirrored_; }

  // The third corner of the triangle at an edge.
  [[nodiscard]] std::uint8_t third_of(Edge edge) const {
    return mirrored_ ? thirds_[edge.to * corners_ + edge.from] : thirds_[edge.from * corners_ + edge.to];
  }

  // The lowest corner to which an edge leads from corner 0, or `none`.
  [[nodiscard]] std::uint8_t second() const {
    std::size_t second = 0;
    while (second < corners_ && thirds_[second] == none) ++second;
    return second < corners_ ? static_cast<std::uint8_t>(second) : none;
  }

 private:
  bool set(std::size_t from, std::size_t to, std::uint8_t third) {
    std::uint8_t& place = thirds_[from * corners_ + to];
    if (place != none) return false;
    place = third;
    return true;
  }

  std::size_t corners_ = 0;
  bool mirrored_ = false;
  std::array<std::uint8_t, max_polyhedron_corners * max_polyhedron_corners> thirds_;  // [from][to]
};

template <std::size_t words>
bool encode(const TriangleTable& table, std::size_t corners, std::span<std::byte> code) {
  GrowingSurface<words> surface(corners, table.second());
  code[0] = static_cast<std::byte>(table.second());
  for (std::byte& byte : code.subspan(1)) {
    const auto edge = surface.next_edge();
    const std::uint8_t third = edge ? table.third_of(*edge) : TriangleTable::none;
    if (third == TriangleTable::none) return false;
    byte = static_cast<std::byte>(surface.number_of(*edge, third));
    surface.add(*edge, third);
  }
  return !surface.next_edge() && surface.uses_all();
}

template <std::size_t words>
bool decode(std::span<const std::byte> code, std::size_t corners, std::span<SurfaceTriangle> triangles) {
  const auto second = std::to_integer<std::uint8_t>(code[0]);
  if (second == 0 || second >= corners) return false;
  GrowingSurface<words> surface(corners, second);
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    const auto edge = surface.next_edge();
    const auto third = edge ? surface.corner_of(*edge, std::to_integer<std::size_t>(code[1 + t])) : std::nullopt;
    if (!third || !surface.add(*edge, *third)) return false;
    triangles[t] = {edge->from, edge->to, *third};
  }
  return !surface.next_edge() && surface.uses_all();
}

constexpr std::size_t few_corners = 64;  // so many take a word

}  // namespace

SurfaceCoding encode_surface(std::span<const SurfaceTriangle> triangles, std::size_t corners,
                             std::vector<std::byte>& code) {
  if (triangles.size() != surface_triangles(corners)) return SurfaceCoding::failed;
  TriangleTable table;
  if (!table.fill(triangles, corners)) return SurfaceCoding::failed;
  // Of the two ways round, the one whose triangle at the first edge has the lower third corner.
  const std::uint8_t second = table.second();
  if (second == TriangleTable::none) return SurfaceCoding::failed;
  const bool mirrored = table.third_of({0, second}) > table.third_of({second, 0});
  if (mirrored) table.mirror();
  const std::size_t had = code.size();
  code.resize(had + surface_code_bytes(corners));
  const auto to = std::span(code).subspan(had);
  if (!(corners <= few_corners ? encode<1>(table, corners, to) : encode<4>(table, corners, to))) {
    code.resize(had);
    return SurfaceCoding::failed;
  }
  return mirrored ? SurfaceCoding::mirrored : SurfaceCoding::as_given;
}

bool decode_surface(std::span<const std::byte> code, std::size_t corners, std::span<SurfaceTriangle> triangles) {
  return corners <= few_corners ? decode<1>(code, corners, triangles) : decode<4>(code, corners, triangles);
}

}  // namespace splatvol::format
