#include "streamer/first/first_transfer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <numeric>
#include <span>
#include <utility>

#include "base/parallel.h"
#include "pictures/contrast.h"
#include "scene/color_maps.h"
#include "scene/transfer_edits.h"

namespace splatvol {
namespace {

// A normal distribution as three values, with their weights.
struct Node {
  double deviations, weight;
};
constexpr std::array<Node, 3> nodes = {{{-std::numbers::sqrt3, 1.0 / 6}, {0, 2.0 / 3}, {std::numbers::sqrt3, 1.0 / 6}}};

struct Interval {
  double low, high;
  [[nodiscard]] double width() const { return high - low; }
};

struct WeightedValue {
  double value;
  double count;  // of splats that are seen. Each stands for about as many points: small cells count like large ones
  double volume;
};
using Values = std::vector<WeightedValue>;

// The axis on which colours are chosen. `least`: smaller values count as this one on a logarithmic axis.
struct Axis {
  ValueAxis kind = ValueAxis::linear;
  double width = 1, least = 0;

  [[nodiscard]] double position(double value) const {
    if (kind == ValueAxis::log) return std::log(std::max(value, least));
    return kind == ValueAxis::asinh ? std::asinh(value / width) : value;
  }
  [[nodiscard]] double value(double position) const {
    if (kind == ValueAxis::log) return std::exp(position);
    return kind == ValueAxis::asinh ? width * std::sinh(position) : position;
  }
};

// Takes the means alone: next to an outlier, deviations are large in many splats.
template <class Map>
Values values_of(const std::vector<SurveySplat>& splats, const Map& map) {
  Values values;
  for (const SurveySplat& splat : splats)
    if (splat.has_value) values.push_back({map(splat.value), splat.weight, splat.volume});
  std::ranges::sort(values, {}, &WeightedValue::value);
  return values;
}

double total(std::span<const WeightedValue> values, double WeightedValue::*weight) {
  return std::accumulate(values.begin(), values.end(), 0.0,
                         [&](double sum, const WeightedValue& value) { return sum + value.*weight; });
}

// Returns the value below which this share of the splats, or of another weight, is. Requires sorted values, at least
// one.
double quantile(std::span<const WeightedValue> values, double share,
                double WeightedValue::*weight = &WeightedValue::count) {
  double left = share * total(values, weight);
  for (const WeightedValue& value : values)
    if ((left -= value.*weight) <= 0) return value.value;
  return values.back().value;
}

// Returns the shortest interval that holds this share of the volume.
Interval shortest_interval(const Values& values, double share) {
  const double wanted = share * total(values, &WeightedValue::volume);
  Interval shortest{values.front().value, values.back().value};
  double inside = 0;
  for (std::size_t low = 0, high = 0; low < values.size(); inside -= values[low++].volume) {
    while (high < values.size() && inside < wanted) inside += values[high++].volume;
    if (inside < wanted) break;
    const Interval interval{values[low].value, values[high - 1].value};
    if (interval.width() < shortest.width()) shortest = interval;
  }
  return shortest;
}

constexpr double share_left_out = 0.01;  // at either end, so that outliers do not flatten the rest
constexpr double fewest_beyond = 20;     // splats that are not outliers
constexpr double rounding = 1e-6;        // of the largest value; a smaller negative one is an error
constexpr double shown_decades = 1e10;   // from the largest values down; less is as good as 0

// Whether more values are above half of the largest, `top`, than from there down to a hundredth: such as the share of
// one of two fluids. Then small values are errors.
bool is_a_step(std::span<const WeightedValue> values, double top) {
  const auto number_above = [&](double least) {
    return total(values.last(static_cast<std::size_t>(
                     values.end() - std::ranges::lower_bound(values, least, {}, &WeightedValue::value))),
                 &WeightedValue::count);
  };
  const double large = number_above(0.5 * top);
  return large > number_above(1e-2 * top) - large;
}

// Returns whether sizes span decades: half of those above 0, by number and by volume, are less than 1 / `half` of the
// largest, and some are less than 1/1000. A linear axis would show most of them as one. `sizes` keeps those that are
// shown, above `least`.
bool spans_decades(Values& sizes, double half, double least) {
  const std::size_t all = sizes.size();
  least = std::max(least, quantile(sizes, 0.99) / shown_decades);
  std::erase_if(sizes, [&](const WeightedValue& size) { return !(size.value > least); });
  if (20 * sizes.size() < all || sizes.size() < fewest_beyond) return false;
  const double top = quantile(sizes, 0.99);
  return quantile(sizes, 0.5) * half <= top && quantile(sizes, 0.05) * 1e3 <= top &&
         quantile(sizes, 0.5, &WeightedValue::volume) * half <= top && !is_a_step(sizes, top);
}

// Few negative values, or small ones, are errors of rounding.
Axis choose_axis(const std::vector<SurveySplat>& splats, bool whole) {
  const double least_size = whole ? 0.5 : 0;
  Values values = values_of(splats, [](double value) { return value; });
  const double least = quantile(values, 0.01), most = quantile(values, 0.99);
  if (most > 0 && least >= -most * rounding)
    return spans_decades(values, 30, least_size) ? Axis{ValueAxis::log, 1, quantile(values, share_left_out)} : Axis{};
  Values sizes = values_of(splats, [](double value) { return std::abs(value); });
  return spans_decades(sizes, 100, least_size) ? Axis{ValueAxis::asinh, quantile(sizes, 0.25), 0} : Axis{};
}

// Findings on the values, on their axis, before colours and densities are chosen.
struct Findings {
  Interval range{};           // the domain
  Interval clear{};           // values that draw least: those of the surroundings, or one value
  bool surroundings = false;  // most of the volume has about the same value
};

constexpr double share_of_outliers = 1e-4;       // at either end, at least one and a half splats of many
constexpr double narrow = 0.08;                  // of all values: such an interval is one value
constexpr double share_of_a_side = 0.05;         // of the splats outside of the surroundings; fewer are outliers
constexpr double least_side_of_diverging = 0.2;  // of the longer side
constexpr double low_end = 0.25;                 // of a logarithmic axis: surroundings lie there
constexpr double clear_margin = 0.03;            // of the range, round the surroundings: there they fade out

// If at least half of the volume has about one value, this is the free stream, or what lies round the data. There must
// be data: some values beyond may be outliers.
std::optional<Interval> find_surroundings(const Values& values, double width) {
  for (const double share : {0.9, 0.75, 0.5}) {
    const Interval interval = shortest_interval(values, share);
    double beyond = 0;
    for (const WeightedValue& value : values)
      if (value.value < interval.low || value.value > interval.high) beyond += value.count;
    if (interval.width() <= narrow * width && beyond >= fewest_beyond) return interval;
  }
  return {};
}

// Extends the surroundings by the values beyond, side by side, unless they are too few to be seen.
Interval range_round(const Values& values, const Interval& clear) {
  const auto first_inside = std::ranges::lower_bound(values, clear.low, {}, &WeightedValue::value);
  const auto behind = std::ranges::upper_bound(values, clear.high, {}, &WeightedValue::value);
  const std::span<const WeightedValue> below(values.begin(), first_inside), above(behind, values.end());
  const double count_below = total(below, &WeightedValue::count), count_above = total(above, &WeightedValue::count);
  const double least = share_of_a_side * (count_below + count_above);
  Interval range = clear;
  if (count_below > 0 && count_below >= least) range.low = quantile(below, 2 * share_left_out);
  if (count_above > 0 && count_above >= least) range.high = quantile(above, 1 - 2 * share_left_out);
  return range;
}

// `from_below`: on a logarithmic axis small values are clear, and surroundings are only looked for among them.
Findings study(const Values& values, bool from_below) {
  Findings findings;
  const double count = total(values, &WeightedValue::count);
  const double outliers = std::clamp(1.5 / count, share_of_outliers, 2 * share_left_out);
  const Interval all{quantile(values, outliers), quantile(values, 1 - outliers)};
  const auto surroundings = find_surroundings(values, all.width());
  const bool usable = surroundings && (!from_below || surroundings->high - all.low < low_end * all.width());
  if (usable) {
    findings.surroundings = true;
    findings.clear = *surroundings;
    findings.range = range_round(values, *surroundings);
    const double more = clear_margin * findings.range.width();
    findings.clear = {std::max(surroundings->low - more, findings.range.low),
                      std::min(surroundings->high + more, findings.range.high)};
    return findings;
  }
  findings.range = {quantile(values, share_left_out), quantile(values, 1 - share_left_out)};
  if (from_below) {
    findings.clear = {findings.range.low, findings.range.low + clear_margin * findings.range.width()};
    return findings;
  }
  const double clear = std::clamp(0.0, findings.range.low, findings.range.high);  // the value nearest to 0
  findings.clear = {clear, clear};
  return findings;
}

// Returns the least density. If the material fills little of its box, or the box is flat, its shape is worth a look,
// and no value of it is clear. If it fills the box, a least density would be a fog. Surroundings of larger cells
// must not be seen either.
double least_density(const std::vector<SurveySplat>& splats, const Axis& axis, const Findings& findings) {
  constexpr double filled = 0.3, deep = 0.1, most = 0.5;
  const Box box = bounds_of(splats);
  const dvec3 extent = box.extent();
  const double box_volume = extent.x * extent.y * extent.z;
  double volume = 0, volume_inside = 0, inside = 0, count = 0;
  for (const SurveySplat& splat : splats) {
    const double value = axis.position(splat.value);
    const bool is_inside = value >= findings.clear.low && value <= findings.clear.high;
    volume += splat.volume, count += 1;
    if (is_inside) volume_inside += splat.volume, inside += 1;
  }
  const bool larger_cells = inside * (volume - volume_inside) < 0.5 * (count - inside) * volume_inside;
  if (!(box_volume > 0) || (findings.surroundings && larger_cells)) return 0;
  const double shortest = std::min({extent.x, extent.y, extent.z});
  const double longest = std::max({extent.x, extent.y, extent.z});
  const double depth = shortest / (extent.x + extent.y + extent.z - shortest - longest);  // against the middle side
  const double emptiness = std::clamp(1 - volume / (filled * box_volume), 0.0, 1.0);
  return most * std::max(emptiness, std::clamp(1 - depth / deep, 0.0, 1.0));
}

// A rise from the clear values to both ends, as fast on both sides. It is linear, but quadratic round surroundings: far
// away, values come near those of the surroundings slowly, and rays are long there. It is cubic on a logarithmic axis,
// where small values fill most of the volume.
std::vector<TransferFunction::Density> densities_of(const Interval& domain, const Axis& axis, const Findings& findings,
                                                    double least) {
  const auto parameter = [&](double position) {
    return std::clamp((position - domain.low) / domain.width(), 0.0, 1.0);
  };
  const double power = axis.kind == ValueAxis::log ? 3 : findings.surroundings ? 2 : 1;
  const double low = parameter(findings.clear.low), high = parameter(findings.clear.high);
  const double farthest = std::max(low, 1 - high);
  if (!(farthest > 0)) return {{0, 1}};
  const auto density = [&](double away) {
    const double share = away / farthest;
    return least + (1 - least) * std::pow(share, power);
  };
  constexpr std::array<double, 3> shares = {1, 0.5, 0.25};
  const std::size_t first = 0, last = power > 1 ? 3 : 1;
  std::vector<TransferFunction::Density> densities;
  for (std::size_t i = first; i < last && low > 0; ++i)
    densities.push_back({low - shares[i] * low, density(shares[i] * low)});
  densities.push_back({low, least});
  if (high > low) densities.push_back({high, least});
  for (std::size_t i = last; i > first && high < 1; --i)
    densities.push_back({high + shares[i - 1] * (1 - high), density(shares[i - 1] * (1 - high))});
  return densities;
}

// Viridis, bright where it is dense, so that it stands out from a dark background. Its darkest fifth is left out: large
// regions of little density have these colours, and would hardly be seen.
std::vector<TransferFunction::Color> sequential(bool dense_above) {
  constexpr double left_out = 0.2;
  TransferFunction viridis;
  viridis.colors = color_maps()[0].colors;
  std::vector<TransferFunction::Color> colors = {{0, viridis.color_at(left_out)}};
  for (const auto& [t, rgb] : viridis.colors)
    if (t > left_out) colors.push_back({(t - left_out) / (1 - left_out), rgb});
  if (!dense_above) colors = reversed(colors);
  for (auto& [t, rgb] : colors) {
    // Short enough for a file that a person edits.
    t = std::round(1e4 * t) / 1e4;
    rgb = glm::round(1e4 * rgb) / 1e4;
  }
  return colors;
}

TransferFunction constant_function(double value) {
  const double half = value == 0 ? 1 : 1e-3 * std::abs(value);
  TransferFunction function;
  function.lo = value - half, function.hi = value + half;
  function.colors = short_cool_to_warm();
  function.densities = {{0, 1}};
  return function;
}

}  // namespace

TransferFunction choose_transfer_function(const std::vector<SurveySplat>& splats, bool whole, double least_range,
                                          bool share) {
  const Axis axis = share ? Axis{} : choose_axis(splats, whole);
  const Values values = values_of(splats, [&](double value) { return axis.position(value); });
  const Findings findings = study(values, axis.kind == ValueAxis::log);
  const double largest = std::max(std::abs(findings.range.low), std::abs(findings.range.high));
  if (!(findings.range.width() > least_range * largest)) return constant_function(axis.value(quantile(values, 0.5)));

  TransferFunction function;
  const bool round_zero = axis.kind != ValueAxis::log && findings.clear.low <= 0 && findings.clear.high >= 0;
  const double middle = round_zero ? 0 : 0.5 * (findings.clear.low + findings.clear.high);
  const double below = middle - findings.range.low, above = findings.range.high - middle;
  const bool diverging = std::min(below, above) >= least_side_of_diverging * std::max(below, above);
  Interval domain = findings.range;
  if (diverging) domain = {middle - std::max(below, above), middle + std::max(below, above)};
  function.colors = diverging ? short_cool_to_warm() : sequential(above >= below);
  function.axis = axis.kind;
  function.linear_width = axis.width;
  function.lo = axis.value(domain.low), function.hi = axis.value(domain.high);
  function.densities = densities_of(domain, axis, findings, least_density(splats, axis, findings));
  return function;
}

TransferFunction label_function(double least, double most) {
  TransferFunction function;
  function.lo = least, function.hi = most;
  function.colors = sequential(true);
  function.densities.clear();
  const auto add = [&](double value, double density) {
    if (value >= least && value <= most) function.densities.push_back({(value - least) / (most - least), density});
  };
  for (const auto& [value, density] : {std::pair(-0.75, 1), {-0.25, 0}, {0.25, 0}, {0.75, 1}}) add(value, density);
  if (function.densities.empty()) function.densities = {{0, 1}};
  return function;
}

double mean_extinction(const TransferFunction& function, const SurveySplat& splat) {
  if (!splat.has_value) return 0;
  const AxisMoments t = function.moments_of(splat.value, splat.deviation);
  double extinction = 0;
  for (const Node& node : nodes)
    extinction += node.weight * function.extinction_at(t.mean + node.deviations * t.deviation);
  return splat.factor * extinction;
}

namespace {

// A diverging colour map is lightest, or darkest, in its middle.
bool is_diverging(const TransferFunction& function) {
  const double low = luminance(function.color_at(0)), middle = luminance(function.color_at(0.5)),
               high = luminance(function.color_at(1));
  return (middle > low && middle > high) || (middle < low && middle < high);
}

// A splat as a uniform ellipsoid in which rays have chords.
struct Ellipsoid {
  dvec3 center;
  dmat3 to_ball;      // turns the ellipsoid into the unit ball
  double radius;      // of a ball round the ellipsoid
  double extinction;  // of its material, times its density in the ellipsoid
  double weight;      // of the rays through it
  double density;     // of these rays: the weight over the square of the side
  std::size_t splat;  // its number

  // Returns the optical depth of a ray through `eye` along a unit vector, or of a line if it is orthographic.
  [[nodiscard]] double depth(const dvec3& eye, const dvec3& direction) const {
    const dvec3 to_center = center - eye;
    const double along = glm::dot(to_center, direction);
    if (glm::dot(to_center, to_center) - along * along > radius * radius) return 0;
    const dvec3 o = to_ball * to_center, d = to_ball * direction;
    const double length = glm::length(d);
    const dvec3 across = glm::cross(o, d) / length;
    const double rest = 1 - glm::dot(across, across);
    return rest > 0 ? extinction * 2 * std::sqrt(rest) / length : 0;
  }
};

constexpr double largest_share = 1.0 / 32;  // of the picture's height: the side of a splat that gets most rays
constexpr std::size_t rays = 256;

std::vector<Ellipsoid> ellipsoids_of(const std::vector<SurveySplat>& splats, const TransferFunction& function,
                                     const View& view) {
  std::vector<Ellipsoid> ellipsoids;
  for (const SurveySplat& splat : splats) {
    const std::size_t number = static_cast<std::size_t>(&splat - splats.data());
    const double extinction = mean_extinction(function, splat);
    const dvec3 deviations(glm::length(splat.axes[0]), glm::length(splat.axes[1]), glm::length(splat.axes[2]));
    if (!(extinction > 0 && splat.volume > 0 && deviations.x > 0)) continue;
    // A pixel shows the mean over its area: splats that are thinner than a pixel count as wide as one.
    const double depth = view.orthographic ? 1 : std::max(view.to_view(splat.center).z, deviations.x);
    const double pixel = depth / view.focal;
    const dvec3 radii = std::sqrt(5.0) * glm::max(deviations, dvec3(std::max(0.4 * pixel, 1e-4 * deviations.x)));
    const double volume = 4 * std::numbers::pi / 3 * radii.x * radii.y * radii.z;
    dmat3 to_ball(0);
    for (int k = 0; k < 3; ++k) {
      dvec3 axis(0);
      axis[k] = 1;
      if (deviations[k] > 0)
        axis = splat.axes[k] / deviations[k];
      else if (k == 2)
        axis = glm::cross(splat.axes[0] / deviations.x, deviations.y > 0 ? splat.axes[1] / deviations.y : dvec3(0));
      for (int column = 0; column < 3; ++column) to_ball[column][k] = axis[column] / radii[k];
    }
    const double side = std::sqrt(radii.x * radii.y) / pixel / view.height;
    const double weight = extinction * std::pow(std::min(side, largest_share), 2);
    ellipsoids.push_back(
        {splat.center, to_ball, radii.x, extinction * splat.volume / volume, weight, weight / (side * side), number});
  }
  return ellipsoids;
}

struct Hit {
  double along, depth;    // distance from the eye, optical depth
  std::size_t ellipsoid;  // its number
};

// A ray, or a line if it is orthographic. `direction` has length 1.
struct Ray {
  dvec3 eye, direction;
  std::size_t count = 1;  // of rays that it stands for
  double depth = 0;       // optical
  std::vector<Hit> hits = {};
};

// Calls `add(ray, number of the ellipsoid, optical depth)` for the ellipsoids that rays may hit. Most rays miss the
// balls round most ellipsoids, of which there is a vector for each number, so that compilers make vectors of the loop.
// Each part of them is tried with all rays while it is near.
template <class Add>
void visit_hits(const std::vector<Ellipsoid>& ellipsoids, std::span<Ray> through, const Add& add) {
  constexpr std::size_t at_once = 256;
  std::array<double, at_once> x, y, z, squares;
  std::array<std::uint8_t, at_once> is_hit;
  for (std::size_t begin = 0; begin < ellipsoids.size(); begin += at_once) {
    const std::size_t count = std::min(at_once, ellipsoids.size() - begin);
    for (std::size_t k = 0; k < count; ++k) {
      const Ellipsoid& ellipsoid = ellipsoids[begin + k];
      x[k] = ellipsoid.center.x, y[k] = ellipsoid.center.y, z[k] = ellipsoid.center.z;
      squares[k] = ellipsoid.radius * ellipsoid.radius;
    }
    for (Ray& ray : through) {
      const dvec3 eye = ray.eye, direction = ray.direction;
      for (std::size_t k = 0; k < count; ++k) {
        const double dx = x[k] - eye.x, dy = y[k] - eye.y, dz = z[k] - eye.z;
        const double along = dx * direction.x + dy * direction.y + dz * direction.z;
        is_hit[k] = dx * dx + dy * dy + dz * dz - along * along <= squares[k] ? 1 : 0;
      }
      for (std::size_t k = 0; k < count; ++k)
        if (is_hit[k] != 0) add(ray, begin + k, ellipsoids[begin + k].depth(eye, direction));
    }
  }
}

void add_depths(const std::vector<Ellipsoid>& ellipsoids, std::span<Ray> through) {
  visit_hits(ellipsoids, through, [](Ray& ray, std::size_t, double depth) { ray.depth += depth; });
}

// Rays through splats, at equal steps of the weights.
std::vector<Ray> choose_rays(const std::vector<Ellipsoid>& ellipsoids, const View& view) {
  double sum = 0;
  for (const Ellipsoid& ellipsoid : ellipsoids) sum += ellipsoid.weight;
  std::vector<Ray> chosen;
  double passed = 0;
  for (const Ellipsoid& through : ellipsoids) {
    const double before = passed;
    passed += through.weight;
    const auto number = [&](double weight) { return std::floor(weight / sum * static_cast<double>(rays) + 0.5); };
    const double ray_count = number(passed) - number(before);
    if (ray_count < 1) continue;
    const dvec3 direction = view.orthographic ? view.forward : glm::normalize(through.center - view.eye);
    chosen.push_back({view.orthographic ? through.center : view.eye, direction, static_cast<std::size_t>(ray_count)});
  }
  return chosen;
}

}  // namespace

struct PictureRays::Contents {
  const std::vector<SurveySplat>& splats;
  TransferFunction function;
  std::vector<Ellipsoid> ellipsoids;
  std::vector<Ray> rays;
};

PictureRays::PictureRays(const std::vector<SurveySplat>& splats, const TransferFunction& function, const Camera& camera)
    : contents_(std::make_unique<Contents>(Contents{splats, function, {}, {}})) {
  const auto view = make_view(camera, 512, 512);
  if (!view) return;
  std::vector<Ellipsoid>& ellipsoids = contents_->ellipsoids;
  std::vector<Ray>& rays = contents_->rays;
  ellipsoids = ellipsoids_of(splats, function, *view);
  rays = choose_rays(ellipsoids, *view);
  constexpr std::size_t at_once = 64;
  parallel_for_ranges(0, rays.size(), at_once, [&](std::size_t begin, std::size_t end) {
    visit_hits(ellipsoids, std::span(rays).subspan(begin, end - begin),
               [&](Ray& ray, std::size_t number, double depth) {
                 ray.depth += depth;
                 const double along = glm::dot(ellipsoids[number].center - ray.eye, ray.direction);
                 if (depth > 0 && (view->orthographic || along > 0)) ray.hits.push_back({along, depth, number});
               });
  });
  for (Ray& ray : rays) std::ranges::sort(ray.hits, {}, &Hit::along);
}

PictureRays::~PictureRays() = default;

double PictureRays::density_factor(double opacity) const {
  std::vector<double> depths;
  for (const Ray& ray : contents_->rays)
    if (ray.depth > 0) depths.insert(depths.end(), ray.count, ray.depth);
  if (depths.empty()) return 1;
  const auto mean_opacity = [&](double factor) {
    double sum = 0;
    for (const double depth : depths) sum -= std::expm1(-factor * depth);
    return sum / static_cast<double>(depths.size());
  };
  const auto [least, most] = std::ranges::minmax(depths);
  const double wanted = -std::log1p(-opacity);
  double low = std::log(wanted / most), high = std::log(wanted / least);
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    (mean_opacity(std::exp(middle)) < opacity ? low : high) = middle;
  }
  return std::exp(0.5 * (low + high));
}

// Dense places have more rays than others of the same area: the light of each counts by the area that it stands for.
std::optional<VisibleValues> PictureRays::visible_values(double density_factor) const {
  constexpr double left_out = 0.02;  // of the light, at either end
  const auto& [splats, function, ellipsoids, rays] = *contents_;
  std::vector<double> lights(splats.size());
  for (const Ray& ray : rays) {
    double density = 0;
    for (const Hit& hit : ray.hits) density += ellipsoids[hit.ellipsoid].density;
    double left = density > 0 ? static_cast<double>(ray.count) / density : 0;
    for (const Hit& hit : ray.hits) {
      const double light = -left * std::expm1(-density_factor * hit.depth);
      lights[ellipsoids[hit.ellipsoid].splat] += light;
      left -= light;
    }
  }
  Values values;
  for (std::size_t i = 0; i < splats.size(); ++i) {
    if (!(lights[i] > 0)) continue;
    const AxisMoments t = function.moments_of(splats[i].value, splats[i].deviation);
    for (const Node& node : nodes) {
      const double at = t.mean + node.deviations * t.deviation, extinction = function.extinction_at(at);
      const double share = node.weight * extinction * splats[i].factor / mean_extinction(function, splats[i]);
      if (extinction > 0) values.push_back({at, share * lights[i], 0});
    }
  }
  if (values.empty()) return {};
  std::ranges::sort(values, {}, &WeightedValue::value);
  return VisibleValues{quantile(values, left_out), quantile(values, 1 - left_out)};
}

TransferFunction with_visible_colors(TransferFunction function, const VisibleValues& visible) {
  constexpr double narrowest = 0.01;  // of the domain: fewer values have no colours to show
  const double first = function.colors.front().t, last = function.colors.back().t;
  double low = std::clamp(visible.low, 0.0, 1.0), high = std::clamp(visible.high, 0.0, 1.0);
  if (is_diverging(function)) {
    const double middle = 0.5 * (first + last), half = std::max(middle - low, high - middle);
    low = middle - half, high = middle + half;
  }
  if (!(last > first) || !(high - low >= narrowest)) return function;
  for (auto& color : function.colors)
    color.t = std::clamp(low + (color.t - first) / (last - first) * (high - low), 0.0, 1.0);
  return function;
}

double border_opacity(const std::vector<SurveySplat>& splats, const TransferFunction& function, const Camera& camera,
                      double aspect) {
  constexpr int rays_of_a_side = 16, quarter = 4, height = 512;
  const auto view = make_view(camera, static_cast<int>(std::ceil(aspect * height)), height);
  if (!view) return 0;
  const std::vector<Ellipsoid> ellipsoids = ellipsoids_of(splats, function, *view);
  const dvec2 half(0.5 * view->width, 0.5 * view->height);
  double most = 0;
  for (const int axis : {0, 1})
    for (const double side : {-1.0, 1.0}) {
      std::vector<Ray> across;
      for (int i = 0; i < rays_of_a_side; ++i) {
        dvec2 at(side * half);
        at[1 - axis] = ((i + 0.5) / rays_of_a_side * 2 - 1) * half[1 - axis];
        across.push_back({view->eye, glm::normalize(view->forward + at.x / view->focal * view->right +
                                                    at.y / view->focal * view->up)});
      }
      add_depths(ellipsoids, across);
      std::vector<double> opacities;
      for (const Ray& ray : across) opacities.push_back(-std::expm1(-ray.depth));
      std::ranges::sort(opacities, std::greater<>());
      most = std::max(most, std::accumulate(opacities.begin(), opacities.begin() + quarter, 0.0) / quarter);
    }
  return most;
}

}  // namespace splatvol
