#include "builder/scattered/box_estimate.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>

#include "builder/scattered/selection.h"

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

constexpr std::uint32_t neighbourhood_points = 64;
constexpr std::uint32_t group_points = 16;
constexpr std::uint32_t sorted_points = 16;  // few enough to look at all gaps

// A side of a box that is longer than this many of its neighbourhood's median widths borders on a void: among random
// points one side in ten thousand is. Then it becomes half of such a width.
constexpr double longest_side = 3, usual_side = 0.5;

int longest_axis(const dvec3& extent) {
  return extent.x >= extent.y && extent.x >= extent.z ? 0 : extent.y >= extent.z ? 1 : 2;
}

double half_way(double below, double above) { return below + (above - below) / 2; }

}  // namespace

void BoxEstimate::estimate(std::span<const dvec3> positions, std::span<const std::span<const double>> values,
                           const Box& bounds, const EstimatedMaterial& result) {
  places_.clear();
  for (const dvec3& p : positions) {
    const dvec3 place = p - bounds.low;
    places_.push_back({Place::Lanes{place.x, place.y, place.z, static_cast<double>(places_.size())}});
  }
  boxes_.resize(positions.size());
  neighbourhoods_.clear();
  groups_.clear();
  const auto count = static_cast<std::uint32_t>(positions.size());
  if (count > 0) split({0, count}, {dvec3(0), bounds.high - bounds.low}, {});
  const double widest = widest_spacing();
  for (const Range& neighbourhood : neighbourhoods_) cut_off_voids(neighbourhood, widest);

  store_boxes(result.moments);
  for (std::size_t a = 0; a < values.size() && count > 0; ++a) {
    const dvec3 whole = fit_gradient({0, count}, values[a], dvec3(0));
    auto group = groups_.begin();
    for (const Range& neighbourhood : neighbourhoods_) {
      const dvec3 around = fit_gradient(neighbourhood, values[a], whole);
      for (; group != groups_.end() && group->end <= neighbourhood.end; ++group) {
        const dvec3 gradient = fit_gradient(*group, values[a], around);
        store_values(*group, values[a], gradient, result.moments, result.value_moments[a]);
        for (std::uint32_t i = group->begin; i < group->end; ++i) {
          const std::uint32_t point = places_[i].point();
          result.gradients[a][point] = std::isnan(values[a][point]) ? dvec3(0) : gradient;
        }
      }
    }
  }
}

void BoxEstimate::split(Range range, const Box& box, Level level) {
  const std::uint32_t count = range.end - range.begin;
  if (!level.in_neighbourhood && count <= neighbourhood_points) {
    neighbourhoods_.push_back(range);
    level.in_neighbourhood = true;
  }
  if (!level.in_group && count <= group_points) {
    groups_.push_back(range);
    level.in_group = true;
  }
  if (count == 1) {
    boxes_[range.begin] = box;
    return;
  }
  Place low = places_[range.begin], high = low;
  for (std::uint32_t i = range.begin + 1; i < range.end; ++i) {
    const Place::Lanes& lanes = places_[i].lanes;
    low.lanes = lanes < low.lanes ? lanes : low.lanes;
    high.lanes = lanes > high.lanes ? lanes : high.lanes;
  }
  const int axis = longest_axis(high.position() - low.position());
  if (low[axis] == high[axis]) {
    // All in one place; the earliest has it.
    if (!level.in_neighbourhood) neighbourhoods_.push_back(range);
    if (!level.in_group) groups_.push_back(range);
    const auto first = places_.begin() + range.begin;
    std::iter_swap(first, std::min_element(first, places_.begin() + range.end,
                                           [](const Place& a, const Place& b) { return a.point() < b.point(); }));
    std::fill(boxes_.begin() + range.begin, boxes_.begin() + range.end, Box{dvec3(1), dvec3(-1)});
    boxes_[range.begin] = box;
    return;
  }
  const auto [middle, plane] = find_split(range, axis);
  Box lower = box, upper = box;
  lower.high[axis] = upper.low[axis] = plane;
  split({range.begin, middle}, lower, level);
  split({middle, range.end}, upper, level);
}

// Orders the range so that all before the middle have a smaller coordinate than the others; the plane lies half way
// between.
BoxEstimate::Split BoxEstimate::find_split(Range range, int axis) {
  return range.end - range.begin <= sorted_points ? split_at_gap(range, axis) : split_at_median(range, axis);
}

// At wide gaps near the middle: boxes are rounder and points nearer to their centres than with medians.
BoxEstimate::Split BoxEstimate::split_at_gap(Range range, int axis) {
  sort_few(std::span(places_).subspan(range.begin, range.end - range.begin), axis);
  std::uint32_t best = range.begin;
  double best_score = -1;
  for (std::uint32_t i = range.begin + 1; i < range.end; ++i) {
    const double gap = places_[i][axis] - places_[i - 1][axis];
    const double score = gap * std::min(i - range.begin, range.end - i);
    const bool better = (gap > 0) & (score > best_score);
    best = better ? i : best;
    best_score = better ? score : best_score;
  }
  return {best, half_way(places_[best - 1][axis], places_[best][axis])};
}

// Stable. Every place is counted to where it belongs, as sorting few makes the processor guess at every step.
void BoxEstimate::sort_few(std::span<Place> places, int axis) {
  constexpr std::uint32_t lanes = 4;
  const auto count = static_cast<std::uint32_t>(places.size());
  std::array<Place, sorted_points> unsorted;
  std::ranges::copy(places, unsorted.begin());
  for (std::uint32_t first = 0; first < count; first += lanes) {
    Place::Lanes x{};
    for (std::uint32_t l = 0; l < lanes; ++l) x[l] = unsorted[std::min(first + l, count - 1)][axis];
    Indices below{};
    for (std::uint32_t j = 0; j < count; ++j) {
      const Place::Lanes other = Place::Lanes{} + unsorted[j][axis];
      below -= (other < x) | ((other == x) & (Indices{} + j < Indices{0, 1, 2, 3} + first));
    }
    for (std::uint32_t l = 0; l < std::min(lanes, count - first); ++l)
      places[static_cast<std::size_t>(below[l])] = unsorted[first + l];
  }
}

// Points with the very same coordinate stay on one side, that of the smaller part.
BoxEstimate::Split BoxEstimate::split_at_median(Range range, int axis) {
  const auto first = places_.begin() + range.begin, last = places_.begin() + range.end;
  const auto middle = first + (last - first) / 2;
  select_nth(std::span(first, last), static_cast<std::size_t>(middle - first),
             [axis](const Place& a, const Place& b) { return a[axis] < b[axis]; });
  const double value = (*middle)[axis];
  double below = -infinity;
  for (auto place = first; place != middle; ++place) below = std::max(below, (*place)[axis]);
  const auto at = [&](auto place) { return static_cast<std::uint32_t>(place - places_.begin()); };
  if (below < value) return {at(middle), half_way(below, value)};

  const auto before = std::partition(first, middle, [&](const Place& place) { return place[axis] < value; });
  const auto after = std::partition(middle, last, [&](const Place& place) { return place[axis] <= value; });
  const bool up = before == first || (after < last && after - middle < middle - before);
  double low = -infinity, high = infinity;
  for (auto place = first; place != last; ++place) {
    const double x = (*place)[axis];
    if (up ? x <= value : x < value) low = std::max(low, x);
    if (up ? x > value : x >= value) high = std::min(high, x);
  }
  return {at(up ? after : before), half_way(low, high)};
}

// Of a volume, a plane or a line that the points fill evenly, whatever its direction; 0 for one place.
double BoxEstimate::widest_spacing() const {
  if (places_.empty()) return 0;
  const double share = 1 / static_cast<double>(places_.size());
  const dvec3 origin = places_[0].position();  // so that points in one place have no width at all
  dvec3 mean(0);
  for (const Place& place : places_) mean += share * (place.position() - origin);
  SpatialMoments points;
  points.mass = 1;
  SymmetricMatrix& s = points.covariance;
  for (const Place& place : places_) {
    const dvec3 x = place.position() - origin - mean;
    s.xx += share * x.x * x.x, s.yy += share * x.y * x.y, s.zz += share * x.z * x.z;
    s.xy += share * x.x * x.y, s.xz += share * x.x * x.z, s.yz += share * x.y * x.z;
  }
  const dvec3 width = std::sqrt(12.0) * shape_of(points).deviations;  // descending
  return std::max(
      {share * width[0], std::sqrt(share * width[0] * width[1]), std::cbrt(share * width[0] * width[1] * width[2])});
}

void BoxEstimate::cut_off_voids(Range neighbourhood, double widest) {
  for (int axis = 0; axis < 3; ++axis) {
    lengths_.clear();
    for (std::uint32_t i = neighbourhood.begin; i < neighbourhood.end; ++i)
      if (boxes_[i].low[0] <= boxes_[i].high[0]) lengths_.push_back(boxes_[i].high[axis] - boxes_[i].low[axis]);
    const std::size_t middle = lengths_.size() / 2;
    select_nth(std::span(lengths_), middle, std::less<>());
    // Points on a plane have nothing but voids beside them.
    const double usual = widest > 0 ? std::min(lengths_[middle], longest_side * widest) : lengths_[middle];
    for (std::uint32_t i = neighbourhood.begin; i < neighbourhood.end; ++i) {
      if (boxes_[i].low[0] > boxes_[i].high[0]) continue;
      const double place = places_[i][axis];
      double &low = boxes_[i].low[axis], &high = boxes_[i].high[axis];
      if (place - low > longest_side * usual) low = place - usual_side * usual;
      if (high - place > longest_side * usual) high = place + usual_side * usual;
    }
  }
}

void BoxEstimate::store_boxes(std::span<SpatialMoments> moments) const {
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const Box& box = boxes_[i];
    SpatialMoments& own = moments[places_[i].point()];
    if (box.low[0] > box.high[0]) {
      own = {};
      continue;
    }
    const dvec3 size = box.high - box.low, square = size * size / 12.0;
    own.mass = size.x * size.y * size.z;
    own.centroid = (box.low - places_[i].position()) + size / 2.0;
    own.covariance = {square.x, square.y, square.z, 0, 0, 0};
  }
}

// Least squares in units of the range's widths, so that flat boxes do not matter. Directions in which its points do not
// spread, such as those across a single column of thin cells, keep the gradient of the larger range round it.
dvec3 BoxEstimate::fit_gradient(Range range, std::span<const double> values, const dvec3& around) const {
  const dvec3 origin = places_[range.begin].position();
  dvec3 place_sum(0), widest(0);
  double used = 0, base = 0;
  for (std::uint32_t i = range.begin; i < range.end; ++i) {
    const double value = values[places_[i].point()];
    if (std::isnan(value)) continue;
    const dvec3 offset = places_[i].position() - origin;
    if (used == 0) base = value;
    place_sum += offset;
    widest = glm::max(widest, glm::abs(offset));
    ++used;
  }
  if (used == 0) return around;
  const dvec3 center = place_sum / used;
  const dvec3 unit(widest.x > 0 ? 1 / widest.x : 0, widest.y > 0 ? 1 / widest.y : 0, widest.z > 0 ? 1 / widest.z : 0);
  SymmetricMatrix normal;
  dvec3 right(0);
  for (std::uint32_t i = range.begin; i < range.end; ++i) {
    const double value = values[places_[i].point()];
    if (std::isnan(value)) continue;
    const dvec3 offset = places_[i].position() - origin - center, x = offset * unit;
    normal.xx += x.x * x.x, normal.yy += x.y * x.y, normal.zz += x.z * x.z;
    normal.xy += x.x * x.y, normal.xz += x.x * x.z, normal.yz += x.y * x.z;
    right += (value - base - glm::dot(around, offset)) * x;
  }
  const double least = 1e-12 * used;
  const dmat3 matrix(normal.xx + least, normal.xy, normal.xz, normal.xy, normal.yy + least, normal.yz, normal.xz,
                     normal.yz, normal.zz + least);
  return around + unit * (glm::inverse(matrix) * right);
}

void BoxEstimate::store_values(Range group, std::span<const double> values, const dvec3& gradient,
                               std::span<const SpatialMoments> moments, std::span<ValueMoments> result) const {
  double low = infinity, high = -infinity;
  for (std::uint32_t i = group.begin; i < group.end; ++i) {
    const double value = values[places_[i].point()];
    if (value < low) low = value;
    if (value > high) high = value;
  }
  for (std::uint32_t i = group.begin; i < group.end; ++i) {
    const std::uint32_t point = places_[i].point();
    const SpatialMoments& own = moments[point];
    ValueMoments& value = result[point];
    if (std::isnan(values[point]) || own.mass == 0) {
      value = {};
      continue;
    }
    const SymmetricMatrix& s = own.covariance;
    value.mass = own.mass;
    value.centroid = own.centroid;
    value.covariance = {s.xx * gradient.x, s.yy * gradient.y, s.zz * gradient.z};
    value.variance = glm::dot(gradient, value.covariance);
    value.mean = std::clamp(values[point] + glm::dot(gradient, own.centroid), low, high);
    const double reach = std::sqrt(3 * value.variance);  // half the width of a uniform distribution
    value.min = std::max(low, value.mean - reach);
    value.max = std::min(high, value.mean + reach);
  }
}

}  // namespace splatvol
