#include "builder/boundary/welded_surface.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

#include "base/interruption.h"
#include "format/codec.h"

namespace splatvol {
namespace {

constexpr int finest_depth = 20;

// Whether triangles with the same points run the same way round.
bool run_alike(const WeldedSurface::Triangle& one, const WeldedSurface::Triangle& other) {
  const auto [a, b, c] = one;
  return other == one || other == WeldedSurface::Triangle{b, c, a} || other == WeldedSurface::Triangle{c, a, b};
}

}  // namespace

template <class T>
std::size_t WeldedSurface::Hash::operator()(const T& key) const {
  return format::hash_bytes(std::as_bytes(std::span(key)));
}

double WeldedSurface::cell_edge() const {
  const dvec3 extent = box_.extent();
  return std::max(std::ldexp(extent[longest_axis(extent)], -*depth_), std::numeric_limits<double>::min());
}

double WeldedSurface::moved() const { return depth_ ? std::sqrt(3.0) * cell_edge() : 0; }

WeldedSurface::Key WeldedSurface::key_of(const dvec3& position) const {
  Key key;
  for (int axis = 0; axis < 3; ++axis) {
    const double offset = position[axis] - box_.low[axis];
    key[static_cast<std::size_t>(axis)] = depth_ ? static_cast<std::uint64_t>(std::max(offset / cell_edge(), 0.0))
                                                 : std::bit_cast<std::uint64_t>(position[axis]);
  }
  return key;
}

Result<std::uint32_t> WeldedSurface::point_at(const dvec3& position) {
  if (sums_.size() == std::numeric_limits<std::uint32_t>::max())
    return fail(ErrorCode::unsupported, "the boundary has more than 2^32 - 1 points");
  const auto number = static_cast<std::uint32_t>(sums_.size());
  const auto [found, is_new] = numbers_.try_emplace(key_of(position), number);
  if (is_new) {
    sums_.emplace_back(0);
    counts_.push_back(0);
  }
  return found->second;
}

void WeldedSurface::add_points(const Triangle& points, std::uint32_t patch, bool has_side) {
  if (points[0] == points[1] || points[1] == points[2] || points[2] == points[0]) return;
  if (depth_) {
    Named named = {points[0], points[1], points[2], patch};
    std::sort(named.begin(), named.begin() + 3);
    const auto [found, is_new] = named_.try_emplace(named, triangles_.size());
    if (!is_new) {
      const std::size_t same = found->second;
      sides_[same] = sides_[same] && has_side && run_alike(triangles_[same], points);
      return;
    }
  }
  triangles_.push_back(points);
  patches_.push_back(patch);
  sides_.push_back(has_side);
}

Status WeldedSurface::add(const BoundaryTriangle& triangle) {
  Triangle points{};
  for (std::size_t k = 0; k < 3; ++k) {
    SPLATVOL_TRY_ASSIGN(point, point_at(triangle.corners[k]));
    points[k] = point;
    // Without a grid there is one position only, which must stay as it is.
    if (!depth_ && counts_[point] > 0) continue;
    sums_[point] += depth_ ? triangle.corners[k] - box_.low : triangle.corners[k];
    ++counts_[point];
  }
  add_points(points, triangle.patch, triangle.has_side);
  while (triangles_.size() > most_ && (!depth_ || *depth_ > 0)) SPLATVOL_TRY(coarsen());
  return {};
}

// Makes the cells twice as large. Cells of one depth divide those of the next coarser one, so the cell of a sum is that
// of its parts.
Status WeldedSurface::coarsen() {
  SPLATVOL_TRY(check_interruption());
  std::vector<dvec3> places = points();
  const bool was_exact = !depth_;
  depth_ = depth_ ? *depth_ - 1 : finest_depth;
  numbers_.clear();
  named_.clear();
  const std::vector<dvec3> sums = std::exchange(sums_, {});
  const std::vector<std::uint64_t> counts = std::exchange(counts_, {});
  std::vector<std::uint32_t> new_numbers(places.size());
  for (std::size_t i = 0; i < places.size(); ++i) {
    SPLATVOL_TRY_ASSIGN(point, point_at(places[i]));
    new_numbers[i] = point;
    sums_[point] += was_exact ? sums[i] - box_.low : sums[i];
    counts_[point] += counts[i];
  }
  const auto triangles = std::exchange(triangles_, {});
  const auto patches = std::exchange(patches_, {});
  const auto sides = std::exchange(sides_, {});
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    const auto& [a, b, c] = triangles[i];
    add_points({new_numbers[a], new_numbers[b], new_numbers[c]}, patches[i], sides[i]);
  }
  return {};
}

std::vector<dvec3> WeldedSurface::points() const {
  std::vector<dvec3> points(sums_.size());
  for (std::size_t i = 0; i < points.size(); ++i)
    points[i] = depth_ ? box_.low + sums_[i] / static_cast<double>(counts_[i]) : sums_[i];
  return points;
}

}  // namespace splatvol
