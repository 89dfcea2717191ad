#include "format/polyhedron.h"

#include <algorithm>
#include <bitset>
#include <optional>

namespace splatvol::format {
namespace {

struct Edge {
  std::uint8_t from, to;
  bool operator==(const Edge&) const = default;
};

constexpr std::size_t most_triangles = surface_triangles(max_polyhedron_corners);

// A surface that grows triangle by triangle at the edge that has been open for longest.
class GrowingSurface {
 public:
  GrowingSurface(std::size_t corners, std::uint8_t second) : corners_(corners) {
    used_.set(0);
    used_.set(second);
    edges_[end_++] = {0, second};
    edges_[end_++] = {second, 0};
  }

  [[nodiscard]] bool is_closed() const { return first_ == end_; }
  [[nodiscard]] bool uses_all() const { return used_.count() == corners_; }

  // The edge of the next triangle. Requires an open one.
  Edge take_edge() { return edges_[first_++]; }

  // Returns the number of a third corner among the candidates for it.
  [[nodiscard]] std::optional<std::uint8_t> number_of(Edge edge, std::uint8_t corner) const {
    std::optional<std::uint8_t> found;
    for_each_candidate(edge, [&](std::uint8_t number, std::uint8_t candidate) {
      if (candidate == corner) found = number;
      return found.has_value();
    });
    return found;
  }

  // Undoes number_of().
  [[nodiscard]] std::optional<std::uint8_t> corner_of(Edge edge, std::uint8_t number) const {
    std::optional<std::uint8_t> found;
    for_each_candidate(edge, [&](std::uint8_t present, std::uint8_t candidate) {
      if (present == number) found = candidate;
      return found.has_value();
    });
    return found;
  }

  // Adds a triangle at an edge that was taken. Requires a third corner that is a candidate.
  void add(Edge edge, std::uint8_t third) {
    used_.set(third);
    close_or_open({edge.to, third});
    close_or_open({third, edge.from});
  }

 private:
  // Calls visit(number, corner) until it returns true. The likeliest come first: corners at which the triangle closes
  // an open edge, then unused ones.
  template <class Visit>
  void for_each_candidate(Edge edge, const Visit& visit) const {
    std::bitset<max_polyhedron_corners + 1> seen;
    seen.set(edge.from);
    seen.set(edge.to);
    std::uint8_t number = 0;
    const auto is_last = [&](std::size_t corner) {
      if (seen[corner]) return false;
      seen.set(corner);
      return visit(number++, static_cast<std::uint8_t>(corner));
    };
    for (std::size_t i = first_; i < end_; ++i)
      if (edges_[i].from == edge.to && is_last(edges_[i].to)) return;
    for (std::size_t i = first_; i < end_; ++i)
      if (edges_[i].to == edge.from && is_last(edges_[i].from)) return;
    for (const bool used : {false, true})
      for (std::size_t corner = 0; corner < corners_; ++corner)
        if (used_[corner] == used && is_last(corner)) return;
  }

  void close_or_open(Edge edge) {
    const auto end = edges_.begin() + static_cast<std::ptrdiff_t>(end_);
    const auto open = std::find(edges_.begin() + static_cast<std::ptrdiff_t>(first_), end, edge);
    if (open == end) {
      edges_[end_++] = {edge.to, edge.from};
    } else {
      std::copy(open + 1, end, open);
      --end_;
    }
  }

  std::size_t corners_;
  std::bitset<max_polyhedron_corners + 1> used_;
  std::array<Edge, 2 + 2 * most_triangles> edges_{};  // open: from first_ to end_
  std::size_t first_ = 0, end_ = 0;
};

// Finds triangles of a surface by their edges.
class TriangleFinder {
 public:
  TriangleFinder(std::span<const SurfaceTriangle> triangles, bool mirrored) : count_(3 * triangles.size()) {
    for (std::size_t t = 0; t < triangles.size(); ++t)
      for (std::size_t k = 0; k < 3; ++k) {
        std::uint64_t from = triangles[t][k], to = triangles[t][(k + 1) % 3];
        if (mirrored) std::swap(from, to);
        sides_[3 * t + k] = from << 32 | to << 24 | std::uint64_t{triangles[t][(k + 2) % 3]} << 16 | t;
      }
    std::ranges::sort(std::span(sides_).first(count_));
  }

  // The lowest corner to which an edge leads from corner 0.
  [[nodiscard]] std::uint8_t second() const { return static_cast<std::uint8_t>(sides_[0] >> 24); }

  // Returns the lowest third corner of the triangles at an edge that were not taken.
  [[nodiscard]] std::optional<std::uint8_t> third_of(Edge edge) const {
    const auto side = find(edge);
    return side ? std::optional(static_cast<std::uint8_t>(*side >> 16)) : std::nullopt;
  }

  // Takes that triangle. Requires third_of().
  void take(Edge edge) { taken_.set(static_cast<std::size_t>(*find(edge) & 0xffff)); }

 private:
  [[nodiscard]] std::optional<std::uint64_t> find(Edge edge) const {
    const std::uint64_t low = std::uint64_t{edge.from} << 32 | std::uint64_t{edge.to} << 24;
    const auto sides = std::span(sides_).first(count_);
    for (auto side = std::ranges::lower_bound(sides, low); side != sides.end() && *side < low + (1u << 24); ++side)
      if (!taken_[*side & 0xffff]) return *side;
    return std::nullopt;
  }

  std::size_t count_;
  std::array<std::uint64_t, 3 * most_triangles> sides_;  // edge, third corner, triangle; ascending
  std::bitset<most_triangles> taken_;
};

bool encode(TriangleFinder& finder, std::size_t corners, std::vector<std::byte>& code) {
  GrowingSurface surface(corners, finder.second());
  code.push_back(static_cast<std::byte>(finder.second()));
  for (std::size_t t = 0; t < surface_triangles(corners); ++t) {
    if (surface.is_closed()) return false;
    const Edge edge = surface.take_edge();
    const auto third = finder.third_of(edge);
    const auto number = third ? surface.number_of(edge, *third) : std::nullopt;
    if (!number) return false;
    code.push_back(static_cast<std::byte>(*number));
    finder.take(edge);
    surface.add(edge, *third);
  }
  return surface.is_closed() && surface.uses_all();
}

}  // namespace

SurfaceCoding encode_surface(std::span<const SurfaceTriangle> triangles, std::size_t corners,
                             std::vector<std::byte>& code) {
  if (triangles.size() != surface_triangles(corners)) return SurfaceCoding::failed;
  // Of the two ways round, the one whose triangle at the first edge has the lower third corner.
  TriangleFinder finder(triangles, false);
  const std::uint8_t second = finder.second();
  const auto left = finder.third_of({0, second}), right = finder.third_of({second, 0});
  if (!left || !right || *left == *right) return SurfaceCoding::failed;
  const bool mirrored = *left > *right;
  if (mirrored) finder = TriangleFinder(triangles, true);
  const std::size_t had = code.size();
  if (!encode(finder, corners, code)) {
    code.resize(had);
    return SurfaceCoding::failed;
  }
  return mirrored ? SurfaceCoding::mirrored : SurfaceCoding::as_given;
}

bool decode_surface(std::span<const std::byte> code, std::size_t corners, std::span<SurfaceTriangle> triangles) {
  const auto second = std::to_integer<std::uint8_t>(code[0]);
  if (second == 0 || second >= corners) return false;
  GrowingSurface surface(corners, second);
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    if (surface.is_closed()) return false;
    const Edge edge = surface.take_edge();
    const auto third = surface.corner_of(edge, std::to_integer<std::uint8_t>(code[1 + t]));
    if (!third) return false;
    triangles[t] = {edge.from, edge.to, *third};
    surface.add(edge, *third);
  }
  return surface.is_closed() && surface.uses_all();
}

}  // namespace splatvol::format
