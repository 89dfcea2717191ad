#include "builder/scattered/box_estimate.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <new>

#include "base/selection.h"
#include "builder/scattered/gradient_fit.h"

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

constexpr std::uint32_t neighbourhood_points = 64;
constexpr std::uint32_t group_points = 16;
constexpr std::uint32_t sorted_points = 16;  // so few that all gaps are compared

// A side of a box, from its point to a face, borders on a void if it is longer than this many median widths of its
// neighbourhood. Among random points, one side in ten thousand is that long. Such a side becomes half a median width.
constexpr double longest_side = 3, usual_side = 0.5;

double half_way(double below, double above) { return below + (above - below) / 2; }

}  // namespace

void BoxEstimate::estimate(std::span<const dvec3> positions, std::span<const std::span<const double>> values,
                           const Box& bounds, const EstimatedMaterial& result) {
  entries_.clear();
  for (const dvec3& p : positions) {
    const dvec3 local = p - bounds.low;
    entries_.push_back({Entry::Lanes{local.x, local.y, local.z, static_cast<double>(entries_.size())}});
  }
  boxes_.resize(positions.size());
  neighbourhoods_.clear();
  groups_.clear();
  const auto count = static_cast<std::uint32_t>(positions.size());
  if (count > 0) split({0, count}, {dvec3(0), bounds.extent()}, {});
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
        for (std::uint32_t i = group->begin; i < group->end && !result.gradients.empty(); ++i) {
          const std::uint32_t point = entries_[i].point();
          result.gradients[a][point] = std::isnan(values[a][point]) ? dvec3(0) : gradient;
        }
      }
    }
  }
}

// Shares out `box` to the points of the range.
void BoxEstimate::split(Range range, const Box& box, Enclosing enclosing) {
  const std::uint32_t count = range.end - range.begin;
  if (!enclosing.neighbourhood && count <= neighbourhood_points) {
    neighbourhoods_.push_back(range);
    enclosing.neighbourhood = true;
  }
  if (!enclosing.group && count <= group_points) {
    groups_.push_back(range);
    enclosing.group = true;
  }
  if (count == 1) {
    boxes_[range.begin] = box;
    return;
  }
  Entry low = entries_[range.begin], high = low;
  for (std::uint32_t i = range.begin + 1; i < range.end; ++i) {
    const Entry::Lanes& lanes = entries_[i].lanes;
    low.lanes = lanes < low.lanes ? lanes : low.lanes;
    high.lanes = lanes > high.lanes ? lanes : high.lanes;
  }
  const int axis = longest_axis(high.position() - low.position());
  if (low[axis] == high[axis]) {
    // All points coincide: the first has the box.
    if (!enclosing.neighbourhood) neighbourhoods_.push_back(range);
    if (!enclosing.group) groups_.push_back(range);
    const auto first = entries_.begin() + range.begin;
    std::iter_swap(first, std::min_element(first, entries_.begin() + range.end,
                                           [](const Entry& a, const Entry& b) { return a.point() < b.point(); }));
    std::fill(boxes_.begin() + range.begin, boxes_.begin() + range.end, Box{dvec3(1), dvec3(-1)});
    boxes_[range.begin] = box;
    return;
  }
  const auto [middle, plane] = find_split(range, axis);
  Box lower = box, upper = box;
  lower.high[axis] = upper.low[axis] = plane;
  split({range.begin, middle}, lower, enclosing);
  split({middle, range.end}, upper, enclosing);
}

// Orders the range so that all entries before the middle have a smaller coordinate than the others. The plane lies half
// way between both.
BoxEstimate::Split BoxEstimate::find_split(Range range, int axis) {
  return range.end - range.begin <= sorted_points ? split_at_gap(range, axis) : split_at_median(range, axis);
}

// Splits at a wide gap near the middle. Boxes become rounder, and points lie nearer to their centres, than with
// medians.
BoxEstimate::Split BoxEstimate::split_at_gap(Range range, int axis) {
  sort_few(std::span(entries_).subspan(range.begin, range.end - range.begin), axis);
  std::uint32_t best = range.begin;
  double best_score = -1;
  for (std::uint32_t i = range.begin + 1; i < range.end; ++i) {
    const double gap = entries_[i][axis] - entries_[i - 1][axis];
    const double score = gap * std::min(i - range.begin, range.end - i);
    const bool better = (gap > 0) & (score > best_score);
    best = better ? i : best;
    best_score = better ? score : best_score;
  }
  return {best, half_way(entries_[best - 1][axis], entries_[best][axis])};
}

// Sorts, stable. Counts for each entry how many come before it: a sort by comparisons would have branches that the
// processor cannot foresee.
void BoxEstimate::sort_few(std::span<Entry> entries, int axis) {
  constexpr std::uint32_t lanes = 4;
  const auto count = static_cast<std::uint32_t>(entries.size());
  std::array<Entry, sorted_points> unsorted;
  std::ranges::copy(entries, unsorted.begin());
  for (std::uint32_t first = 0; first < count; first += lanes) {
    Entry::Lanes x{};
    for (std::uint32_t l = 0; l < lanes; ++l) x[l] = unsorted[std::min(first + l, count - 1)][axis];
    Indices below{};
    for (std::uint32_t j = 0; j < count; ++j) {
      const Entry::Lanes other = Entry::Lanes{} + unsorted[j][axis];
      below -= (other < x) | ((other == x) & (Indices{} + j < Indices{0, 1, 2, 3} + first));
    }
    for (std::uint32_t l = 0; l < std::min(lanes, count - first); ++l)
      entries[static_cast<std::size_t>(below[l])] = unsorted[first + l];
  }
}

// Splits at the median. All points with the median's coordinate come to one side, where fewer points are.
BoxEstimate::Split BoxEstimate::split_at_median(Range range, int axis) {
  const auto first = entries_.begin() + range.begin, last = entries_.begin() + range.end;
  const auto middle = first + (last - first) / 2;
  select_nth(std::span(first, last), static_cast<std::size_t>(middle - first),
             [axis](const Entry& a, const Entry& b) { return a[axis] < b[axis]; });
  const double value = (*middle)[axis];
  double below = -infinity;
  for (auto entry = first; entry != middle; ++entry) below = std::max(below, (*entry)[axis]);
  const auto index = [&](auto entry) { return static_cast<std::uint32_t>(entry - entries_.begin()); };
  if (below < value) return {index(middle), half_way(below, value)};

  const auto before = std::partition(first, middle, [&](const Entry& entry) { return entry[axis] < value; });
  const auto after = std::partition(middle, last, [&](const Entry& entry) { return entry[axis] <= value; });
  const bool up = before == first || (after < last && after - middle < middle - before);
  double low = -infinity, high = infinity;
  for (auto entry = first; entry != last; ++entry) {
    const double x = (*entry)[axis];
    if (up ? x <= value : x < value) low = std::max(low, x);
    if (up ? x > value : x >= value) high = std::min(high, x);
  }
  return {index(up ? after : before), half_way(low, high)};
}

// The widest spacing of a volume, a plane and a line that the points would fill evenly, in any direction; 0 if all
// points coincide.
double BoxEstimate::widest_spacing() const {
  if (entries_.empty()) return 0;
  const double share = 1 / static_cast<double>(entries_.size());
  const dvec3 origin = entries_[0].position();  // so that coincident points have no width at all
  dvec3 mean(0);
  for (const Entry& entry : entries_) mean += share * (entry.position() - origin);
  SpatialMoments points;
  points.mass = 1;
  for (const Entry& entry : entries_) add_square(points.covariance, share, entry.position() - origin - mean);
  const dvec3 width = std::sqrt(12.0) * shape_of(points).deviations;  // descending
  return std::max(
      {share * width[0], std::sqrt(share * width[0] * width[1]), std::cbrt(share * width[0] * width[1] * width[2])});
}

// Shortens the sides that border on voids. `widest`: widest_spacing().
void BoxEstimate::cut_off_voids(Range neighbourhood, double widest) {
  for (int axis = 0; axis < 3; ++axis) {
    lengths_.clear();
    for (std::uint32_t i = neighbourhood.begin; i < neighbourhood.end; ++i)
      if (boxes_[i].low[0] <= boxes_[i].high[0]) lengths_.push_back(boxes_[i].high[axis] - boxes_[i].low[axis]);
    const std::size_t middle = lengths_.size() / 2;
    select_nth(std::span(lengths_), middle, std::less<>());
    // Points on a plane have only voids beside them, so that all their sides are long.
    const double usual = widest > 0 ? std::min(lengths_[middle], longest_side * widest) : lengths_[middle];
    for (std::uint32_t i = neighbourhood.begin; i < neighbourhood.end; ++i) {
      if (boxes_[i].low[0] > boxes_[i].high[0]) continue;
      const double x = entries_[i][axis];
      double &low = boxes_[i].low[axis], &high = boxes_[i].high[axis];
      if (x - low > longest_side * usual) low = x - usual_side * usual;
      if (high - x > longest_side * usual) high = x + usual_side * usual;
    }
  }
}

void BoxEstimate::store_boxes(std::span<SpatialMoments> moments) const {
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    const Box& box = boxes_[i];
    SpatialMoments& own = moments[entries_[i].point()];
    if (box.low[0] > box.high[0]) {
      own = {};
      continue;
    }
    const dvec3 size = box.high - box.low, square = size * size / 12.0;
    own.mass = size.x * size.y * size.z;
    own.centroid = (box.low - entries_[i].position()) + size / 2.0;
    own.covariance = {square.x, square.y, square.z, 0, 0, 0};
  }
}

// Fits in units of the range's widths, so that flat boxes do not matter. `around` is the gradient of the larger range
// round this one. It remains in directions in which the points do not spread, such as across a single column of thin
// cells.
dvec3 BoxEstimate::fit_gradient(Range range, std::span<const double> values, const dvec3& around) const {
  const dvec3 origin = entries_[range.begin].position();
  dvec3 offset_sum(0), widest(0);
  double used = 0, base = 0;
  for (std::uint32_t i = range.begin; i < range.end; ++i) {
    const double value = values[entries_[i].point()];
    if (std::isnan(value)) continue;
    const dvec3 offset = entries_[i].position() - origin;
    if (used == 0) base = value;
    offset_sum += offset;
    widest = glm::max(widest, glm::abs(offset));
    ++used;
  }
  if (used == 0) return around;
  const dvec3 center = offset_sum / used;
  const dvec3 unit(widest.x > 0 ? 1 / widest.x : 0, widest.y > 0 ? 1 / widest.y : 0, widest.z > 0 ? 1 / widest.z : 0);
  GradientFit fit;
  for (std::uint32_t i = range.begin; i < range.end; ++i) {
    const double value = values[entries_[i].point()];
    if (std::isnan(value)) continue;
    const dvec3 offset = entries_[i].position() - origin - center;
    fit.add(offset * unit, value - base - glm::dot(around, offset));
  }
  return around + unit * fit.gradient();
}

void BoxEstimate::store_values(Range group, std::span<const double> values, const dvec3& gradient,
                               std::span<const SpatialMoments> moments, std::span<ValueMoments> result) const {
  double low = infinity, high = -infinity;
  for (std::uint32_t i = group.begin; i < group.end; ++i) {
    const double value = values[entries_[i].point()];
    if (value < low) low = value;
    if (value > high) high = value;
  }
  for (std::uint32_t i = group.begin; i < group.end; ++i) {
    const std::uint32_t point = entries_[i].point();
    const SpatialMoments& own = moments[point];
    if (std::isnan(values[point]) || own.mass == 0) {
      result[point] = {};
      continue;
    }
    const SymmetricMatrix& s = own.covariance;  // of a box: nothing beside the diagonal
    const dvec3 covariance(s.xx * gradient.x, s.yy * gradient.y, s.zz * gradient.z);
    // In their memory: the processor would have to wait before it copies what it just wrote.
    new (&result[point]) ValueMoments(linear_value_moments(own, values[point], gradient, covariance, low, high));
  }
}

}  // namespace splatvol
