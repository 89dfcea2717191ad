#include "builder/sources/far_points.h"

#include <algorithm>
#include <limits>
#include <vector>

#include "builder/mesh/usable_numbers.h"

namespace splatvol {
namespace {

constexpr std::size_t fewest_points = 16;
constexpr double farthest_ratio = 0x1p44;

double select(std::vector<double>& numbers, double share) {
  const auto at = static_cast<std::ptrdiff_t>(share * static_cast<double>(numbers.size() - 1));
  std::ranges::nth_element(numbers, numbers.begin() + at);
  return numbers[static_cast<std::size_t>(at)];
}

// The largest difference along an axis: unlike a length, it needs no root.
double distance(const dvec3& a, const dvec3& b) {
  const dvec3 d = glm::abs(a - b);
  return std::max({d.x, d.y, d.z});
}

Box box_of(std::span<const dvec3> points) {
  Box box;
  for (const dvec3& p : points)
    if (is_usable_position(p)) box.include(p);
  return box;
}

// Returns the number of usable points, or 0 if there can be no far point among them. With far points, nine tenths of
// the points lie within two usual distances of each other, and so do eight tenths of the neighbours in the piece.
// `box`: round the points.
std::size_t count_if_crowded(std::span<const dvec3> points, const Box& box) {
  const double close = 2 / farthest_ratio * distance(box.low, box.high);
  std::size_t count = 0, close_pairs = 0;
  dvec3 last(std::numeric_limits<double>::infinity());
  for (const dvec3& p : points) {
    if (!is_usable_position(p)) continue;
    close_pairs += distance(p, last) <= close ? 1 : 0;
    last = p;
    ++count;
  }
  return 2 * close_pairs > count ? count : 0;
}

}  // namespace

NearPoints drop_far_points(std::span<dvec3> points) {
  NearPoints near{box_of(points)};
  const std::size_t count = count_if_crowded(points, near.box);
  if (count < fewest_points) return near;
  std::vector<double> numbers(count);
  const auto collect = [&](const auto& number_of) -> std::vector<double>& {
    auto next = numbers.begin();
    for (const dvec3& p : points)
      if (is_usable_position(p)) *next++ = number_of(p);
    return numbers;
  };
  dvec3 middle;
  for (int axis = 0; axis < 3; ++axis) middle[axis] = select(collect([&](const dvec3& p) { return p[axis]; }), 0.5);
  const double usual = select(collect([&](const dvec3& p) { return distance(p, middle); }), 0.9);
  if (!(usual > 0)) return near;
  for (dvec3& p : points) {
    if (!is_usable_position(p) || !(distance(p, middle) > farthest_ratio * usual)) continue;
    p = dvec3(std::numeric_limits<double>::quiet_NaN());
    ++near.dropped;
  }
  if (near.dropped > 0) near.box = box_of(points);
  return near;
}

}  // namespace splatvol
