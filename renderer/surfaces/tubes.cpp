#include "renderer/surfaces/tubes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>

namespace splatvol {
namespace {

constexpr std::uint32_t sides = 10;

// How far a row is from the line between two others, as shares of what it may be; 0 for values that are missing.
double distance_from(std::span<const dvec3> positions, std::span<const double> values, std::size_t first,
                     std::size_t last, std::size_t row, double distance, double difference) {
  const dvec3 way = positions[last] - positions[first], offset = positions[row] - positions[first];
  const double square = squared_length(way);
  const double share = square > 0 ? std::clamp(glm::dot(offset, way) / square, 0.0, 1.0) : 0;
  double farthest = glm::length(offset - share * way) / distance;
  if (values.empty()) return farthest;
  const double between = (1 - share) * values[first] + share * values[last];
  if (std::isnan(values[row]) != std::isnan(between)) return std::numeric_limits<double>::infinity();
  if (!std::isnan(between) && values[row] != between)
    farthest = std::max(farthest, std::abs(values[row] - between) / difference);
  return farthest;
}

// Any direction across another one.
dvec3 across(const dvec3& direction) {
  dvec3 axis(0);
  axis[(longest_axis(glm::abs(direction)) + 1) % 3] = 1;
  return glm::normalize(glm::cross(direction, axis));
}

dvec3 direction_of(const dvec3& from, const dvec3& to) {
  const double length = glm::length(to - from);
  return length > 0 ? (to - from) / length : dvec3(0);
}

// A ring of points round a row.
struct Ring {
  std::size_t row;
  dvec3 tangent;
};

// Rings lie across the mean of the directions before and after them. A sharp bend has two, so that no part gets flat.
std::vector<Ring> rings_of(std::span<const dvec3> positions, std::span<const std::size_t> rows) {
  constexpr double sharp = 0.5;  // cosine of the angle
  std::vector<Ring> rings;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const dvec3& at = positions[rows[i]];
    const dvec3 after = i + 1 < rows.size() ? direction_of(at, positions[rows[i + 1]]) : rings.back().tangent;
    const dvec3 before = i > 0 ? direction_of(positions[rows[i - 1]], at) : after;
    if (i + 1 == rows.size() || glm::dot(before, after) < sharp) rings.push_back({rows[i], before});
    if (i + 1 == rows.size()) break;
    rings.push_back({rows[i], glm::dot(before, after) < sharp ? after : glm::normalize(before + after)});
  }
  return rings;
}

// Closes an end.
void add_disc(std::uint32_t ring, bool is_first, std::vector<std::array<std::uint32_t, 3>>& triangles) {
  for (std::uint32_t k = 1; k + 1 < sides; ++k)
    triangles.push_back({ring, ring + k + (is_first ? 1 : 0), ring + k + (is_first ? 0 : 1)});
}

}  // namespace

// Douglas and Peucker's way.
std::vector<std::size_t> thinned(std::span<const dvec3> positions, std::span<const double> values, double distance,
                                 double difference) {
  std::vector<bool> stays(positions.size());
  stays.front() = stays.back() = true;
  for (std::vector<std::pair<std::size_t, std::size_t>> open{{0, positions.size() - 1}}; !open.empty();) {
    const auto [first, last] = open.back();
    open.pop_back();
    double most = 1;
    std::optional<std::size_t> farthest;
    for (std::size_t row = first + 1; row < last; ++row) {
      const double is_from = distance_from(positions, values, first, last, row, distance, difference);
      if (is_from > most) most = is_from, farthest = row;
    }
    if (!farthest) continue;
    stays[*farthest] = true;
    open.emplace_back(first, *farthest);
    open.emplace_back(*farthest, last);
  }
  std::vector<std::size_t> rows;
  for (std::size_t row = 0; row < positions.size(); ++row)
    if (stays[row]) rows.push_back(row);
  return rows;
}

std::size_t tube_points(std::span<const dvec3> positions, std::span<const std::size_t> rows) {
  return sides * rings_of(positions, rows).size();
}

Status add_tube(std::span<const dvec3> positions, std::span<const double> values, std::span<const std::size_t> rows,
                double radius, TubeMesh& tubes) {
  std::vector<dvec3>& points = tubes.mesh.points;
  std::vector<std::array<std::uint32_t, 3>>& triangles = tubes.mesh.triangles;
  const std::vector<Ring> rings = rings_of(positions, rows);
  if (points.size() + sides * rings.size() >= std::numeric_limits<std::uint32_t>::max())
    return fail(ErrorCode::unsupported, "streamlines: their tubes have 2^32 points or more: take fewer seeds");
  const auto begin = static_cast<std::uint32_t>(points.size());
  dvec3 side(0);
  for (const auto& [row, tangent] : rings) {
    side -= glm::dot(side, tangent) * tangent;  // the ring turns as little as it can
    side = squared_length(side) > 1e-12 ? glm::normalize(side) : across(tangent);
    const dvec3 other = glm::cross(tangent, side);
    const auto ring = static_cast<std::uint32_t>(points.size());
    for (std::uint32_t k = 0; k < sides; ++k) {
      const double angle = 2 * std::numbers::pi * k / sides;
      points.push_back(positions[row] + radius * (std::cos(angle) * side + std::sin(angle) * other));
      if (!values.empty()) tubes.values.push_back(values[row]);
      if (ring == begin) continue;
      const std::uint32_t next = (k + 1) % sides, last = ring - sides;
      triangles.push_back({last + k, last + next, ring + k});
      triangles.push_back({last + next, ring + next, ring + k});
    }
  }
  add_disc(begin, true, triangles);
  add_disc(static_cast<std::uint32_t>(points.size()) - sides, false, triangles);
  return {};
}

}  // namespace splatvol
