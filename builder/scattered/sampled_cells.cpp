#include "builder/scattered/sampled_cells.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

#include "builder/scattered/trimming.h"

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

// Most cuts by neighbours that samples did not find, and most directions of voids.
constexpr unsigned most_cuts = 32;
constexpr std::size_t most_voids = 16;

// A place is nearer to another point if it is so by more than rounding.
constexpr double nearer = 1 - 1e-9;

// Vertices whose directions have a larger cosine border on the same void.
constexpr double same_void = 0.9;

}  // namespace

void SampledCells::Found::add(std::uint32_t point) {
  std::uint32_t known = count == most ? 1U : 0U;
  for (std::uint32_t i = 0; i < most; ++i) known |= points[i] == point ? 1U : 0U;
  if (known == 0) points[count++] = point;
}

void SampledCells::find(std::span<const dvec3> positions, std::size_t own, std::size_t coincident) {
  set_positions(positions, own, coincident);
  const std::size_t count = own_ - coincident_;
  Found none;
  none.points.fill(PointLeaves::none);
  found_.assign(count, none);
  cells_.assign(count, {});
  neighbours_.clear();
  if (count == 0) return;
  leaves_.build(positions_, static_cast<std::uint32_t>(count), domain_);
  std::uint32_t seed = 0;
  samples_.reset();
  known_pairs_.fill(0);
  // Empty leaves last: a void may have more neighbours than there is room for.
  for (const bool has_points : {true, false})
    for (const PointLeaves::Leaf& leaf : leaves_.leaves())
      if (leaf.has_points == has_points) sample(leaf, seed++);
  for (std::uint32_t i = 0; i < count; ++i)
    if (leaves_.is_kept(i)) make_first_cell(i);
  trim_cells();
}

void SampledCells::set_positions(std::span<const dvec3> positions, std::size_t own, std::size_t coincident) {
  own_ = own, coincident_ = coincident;
  Box box;
  for (const dvec3& p : positions) box.include(p);
  const dvec3 extent = box.extent();
  const double longest = extent[longest_axis(extent)];
  origin_ = box.low;
  unit_ = longest > 0 ? longest : 1;
  positions_.clear();
  for (const dvec3& p : positions.subspan(coincident)) positions_.push_back((p - origin_) / unit_);
  // The domain is so large that voids round the points are out of proportion.
  const double margin = longest > 0 ? 1 : 0.5;
  domain_ = {dvec3(-margin), extent / unit_ + margin};
}

void SampledCells::sample(const PointLeaves::Leaf& leaf, std::uint32_t seed) {
  if (!samples_.find(leaves_, leaf, static_cast<std::uint32_t>(found_.size()), seed)) return;
  constexpr std::size_t steps[] = {1, LeafSamples::side, LeafSamples::side * LeafSamples::side};
  std::array<Pair, (1 + std::size(steps)) * LeafSamples::count> pairs;
  std::size_t count = 0;
  const auto add = [&](std::uint32_t a, std::uint32_t b) {
    // The same pair comes again and again.
    const Pair pair = Pair{std::min(a, b)} << 32 | std::max(a, b);
    Pair& known = known_pairs_[(pair * 0x9e3779b97f4a7c15U) >> 54];
    pairs[count] = pair;
    count += known == pair ? 0 : 1;
    known = pair;
  };
  for (std::size_t s = 0; s < LeafSamples::count; ++s) {
    const std::uint32_t nearest = samples_.nearest(s), second = samples_.second(s);
    if (second != PointLeaves::none) add(nearest, second);
    for (const std::size_t step : steps)
      if (s / step % LeafSamples::side > 0) add(nearest, samples_.nearest(s - step));
  }
  for (const Pair pair : std::span(pairs).first(count)) {
    const auto a = static_cast<std::uint32_t>(pair >> 32), b = static_cast<std::uint32_t>(pair);
    if (a == b) continue;
    if (a < found_.size()) found_[a].add(b);
    if (b < found_.size()) found_[b].add(a);
  }
}

void SampledCells::make_first_cell(std::uint32_t point) {
  Found& found = found_[point];
  if (const auto* nearest = found.count > 0 ? nullptr : leaves_.nearest(positions_[point], infinity, point))
    found.add(nearest->point());
  // Near neighbours first: then few vertices are made in vain.
  std::array<std::pair<double, std::uint32_t>, Found::most> sorted;
  for (std::uint32_t i = 0; i < found.count; ++i)
    sorted[i] = {squared_length(positions_[found.points[i]] - positions_[point]), found.points[i]};
  std::sort(sorted.begin(), sorted.begin() + found.count,
            [](const auto& a, const auto& b) { return a.first < b.first; });
  for (std::uint32_t i = 0; i < found.count; ++i) found.points[i] = sorted[i].second;
  make_cell(positions_, point, std::span(found.points).first(found.count), domain_, polyhedron_);
  Cell& cell = cells_[point];
  cell.radius = bound_vertices(point);
  cell.farthest = farthest_squared(polyhedron_);
  cell.moments = polyhedron_.moments();
  cell.first = static_cast<std::uint32_t>(neighbours_.size());
  for (const ConvexCell::Face& face : polyhedron_.faces())
    if (face.label != ConvexCell::no_label) neighbours_.push_back(face.label);
  cell.last = static_cast<std::uint32_t>(neighbours_.size());
}

// Looks for neighbours that cut off the farthest vertices, until one that is not out of proportion is a vertex of the
// Voronoi cell. Returns the usual distance of vertices.
double SampledCells::bound_vertices(std::uint32_t point) {
  voids_.clear();
  double radius = usual_radius(polyhedron_, items_);
  unsigned cuts = 0;
  while (cuts < most_cuts) {
    double farthest = 0;
    std::size_t number = 0;
    const auto vertices = polyhedron_.vertices();
    for (std::size_t v = 0; v < vertices.size(); ++v) {
      const double square = squared_length(vertices[v]);
      if (square > farthest && !is_in_void(vertices[v])) farthest = square, number = v;
    }
    if (farthest == 0) break;
    const double distance = std::sqrt(farthest), near = max_radius_ratio * radius;
    const dvec3 direction = vertices[number] / distance;
    if (cut_along(point, direction, std::min(near, distance), distance)) {
      if (std::has_single_bit(++cuts)) radius = usual_radius(polyhedron_, items_);
    } else if ((distance > near || polyhedron_.is_on_border(number)) && voids_.size() < most_voids) {
      voids_.push_back(direction);
    } else {
      break;
    }
  }
  return std::has_single_bit(cuts) || cuts == 0 ? radius : usual_radius(polyhedron_, items_);
}

bool SampledCells::is_in_void(const dvec3& vertex) const {
  const double least = same_void * glm::length(vertex);
  return std::ranges::any_of(voids_, [&](const dvec3& known) { return glm::dot(known, vertex) > least; });
}

// Looks at places in a direction, from near to far. Cuts the cell by the bisector to the first point that is nearer to
// a place than the cell's own.
bool SampledCells::cut_along(std::uint32_t point, const dvec3& direction, double near, double far) {
  const double step = std::max(4.0, std::sqrt(std::sqrt(far / near)));
  for (double distance = near;; distance = std::min(step * distance, far)) {
    const auto* nearest = leaves_.nearest(positions_[point] + distance * direction, nearer * distance, point);
    if (nearest) {
      const dvec3 d = nearest->position() - positions_[point];
      return polyhedron_.clip(d, squared_length(d) / 2, nearest->point());
    }
    if (!(distance < far)) return false;
  }
}

void SampledCells::trim_cells() {
  usual_.assign(positions_.size(), 0);
  for (std::uint32_t i = 0; i < cells_.size(); ++i)
    if (cells_[i].farthest > 0) usual_[i] = usual_of(i);
  for (std::uint32_t i = 0; i < cells_.size(); ++i) {
    const double largest = max_radius_ratio * usual_[i];
    if (cells_[i].farthest <= largest * largest) continue;
    make_cell(positions_, i, neighbours(i), domain_, polyhedron_);
    trim(polyhedron_, usual_, usual_[i]);
    cells_[i].moments = polyhedron_.moments();
  }
}

// The lower quartile over the point and its neighbours.
double SampledCells::usual_of(std::uint32_t point) {
  items_ = {cells_[point].radius};
  for (const std::uint32_t other : neighbours(point))
    if (other < cells_.size()) items_.push_back(cells_[other].radius);
  return quantile(items_, 0.25);
}

SpatialMoments SampledCells::moments(std::size_t point) const {
  if (point < coincident_) return {};
  SpatialMoments moments = cells_[point - coincident_].moments;
  moments.mass *= unit_ * unit_ * unit_;
  moments.centroid *= unit_;
  SymmetricMatrix& c = moments.covariance;
  for (double* item : {&c.xx, &c.yy, &c.zz, &c.xy, &c.xz, &c.yz}) *item *= unit_ * unit_;
  return moments;
}

ValueMoments SampledCells::value(std::size_t point, std::span<const double> values) const {
  if (point < coincident_ || std::isnan(values[point])) return {};
  const auto own = static_cast<std::uint32_t>(point - coincident_);
  ValueFit fit = fit_value(positions_, own, neighbours(own), values.subspan(coincident_));
  fit.gradient /= unit_;
  return value_in_cell(moments(point), values[point], fit);
}

dvec3 SampledCells::gradient(std::size_t point, std::span<const double> values) const {
  if (point < coincident_ || std::isnan(values[point])) return dvec3(0);
  const auto own = static_cast<std::uint32_t>(point - coincident_);
  return fit_value(positions_, own, neighbours(own), values.subspan(coincident_)).gradient / unit_;
}

}  // namespace splatvol
