#include "builder/scattered/scattered.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>
#include <utility>

#include "builder/scattered/convex_cell.h"

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

/// A box round points; none at first.
struct Bounds {
  dvec3 low{infinity}, high{-infinity};

  void add(const dvec3& p) {
    low = glm::min(low, p);
    high = glm::max(high, p);
  }
  [[nodiscard]] double squared_distance(const dvec3& p) const {
    const dvec3 outside = glm::max(glm::max(low - p, p - high), dvec3(0));
    return glm::dot(outside, outside);
  }
};

/// A balanced k-d tree; the children of node i are 2 i + 1 and 2 i + 2.
class PointTree {
 public:
  PointTree(std::span<const dvec3> positions, std::vector<std::uint32_t> points)
      : positions_(positions), points_(std::move(points)) {
    while ((points_.size() >> levels_) > leaf_points) ++levels_;
    boxes_.resize((std::size_t{2} << levels_) - 1);
    build({0, 0, points_.size(), 0});
  }

  [[nodiscard]] std::span<const std::uint32_t> points() const { return points_; }
  [[nodiscard]] const Bounds& box() const { return boxes_[0]; }

  /// Calls visit(point) for the points of all boxes that wanted(box) is true of, roughly from near to far.
  template <class Wanted, class Visit>
  void search(const dvec3& from, const Wanted& wanted, const Visit& visit) const {
    search({0, 0, points_.size(), 0}, from, wanted, visit);
  }

 private:
  static constexpr std::size_t leaf_points = 6;
  struct Node {
    std::size_t number, begin, end;
    int level;
    [[nodiscard]] std::size_t middle() const { return begin + (end - begin) / 2; }
    [[nodiscard]] Node lower() const { return {2 * number + 1, begin, middle(), level + 1}; }
    [[nodiscard]] Node upper() const { return {2 * number + 2, middle(), end, level + 1}; }
  };

  void build(const Node& node) {
    Bounds& box = boxes_[node.number];
    for (std::size_t i = node.begin; i < node.end; ++i) box.add(positions_[points_[i]]);
    if (node.level == levels_) return;
    const dvec3 extent = box.high - box.low;
    const int axis = extent.x >= extent.y && extent.x >= extent.z ? 0 : extent.y >= extent.z ? 1 : 2;
    const auto at = [&](std::size_t i) { return points_.begin() + static_cast<std::ptrdiff_t>(i); };
    std::nth_element(at(node.begin), at(node.middle()), at(node.end), [&](std::uint32_t i, std::uint32_t j) {
      const double a = positions_[i][axis], b = positions_[j][axis];
      return a != b ? a < b : i < j;
    });
    constexpr std::size_t worth_a_task = 4096;
    if (node.end - node.begin > worth_a_task) {
      tbb::parallel_invoke([&] { build(node.lower()); }, [&] { build(node.upper()); });
    } else {
      build(node.lower());
      build(node.upper());
    }
  }

  template <class Wanted, class Visit>
  void search(const Node& node, const dvec3& from, const Wanted& wanted, const Visit& visit) const {
    if (!wanted(boxes_[node.number])) return;
    if (node.level == levels_) {
      for (std::size_t i = node.begin; i < node.end; ++i) visit(points_[i]);
      return;
    }
    Node near = node.lower(), far = node.upper();
    if (boxes_[far.number].squared_distance(from) < boxes_[near.number].squared_distance(from)) std::swap(near, far);
    search(near, from, wanted, visit);
    search(far, from, wanted, visit);
  }

  std::span<const dvec3> positions_;
  std::vector<std::uint32_t> points_;
  int levels_ = 0;
  std::vector<Bounds> boxes_;
};

double quantile(std::vector<double>& items, double share) {
  const auto middle = items.begin() + static_cast<std::ptrdiff_t>(static_cast<double>(items.size() - 1) * share);
  std::ranges::nth_element(items, middle);
  return *middle;
}

double farthest_squared(const ConvexCell& cell) {
  double largest = 0;
  for (const dvec3& v : cell.vertices()) largest = std::max(largest, glm::dot(v, v));
  return largest;
}

/// The Voronoi cell of a point, relative to it. A point of the tree can matter only if it is nearer to a vertex than
/// the cell's own point is; long rows of points in boundary layers are passed over by whole boxes.
void find_cell(const PointTree& tree, std::span<const dvec3> positions, std::uint32_t point, const Bounds& domain,
               ConvexCell& cell) {
  const dvec3 center = positions[point];
  cell.reset(domain.low - center, domain.high - center);
  double reach = infinity;  // twice the distance of the farthest vertex, squared
  const auto wanted = [&](const Bounds& box) {
    if (box.squared_distance(center) >= reach) return false;
    const Bounds local{box.low - center, box.high - center};
    return std::ranges::any_of(cell.vertices(),
                               [&](const dvec3& v) { return local.squared_distance(v) < glm::dot(v, v); });
  };
  tree.search(center, wanted, [&](std::uint32_t other) {
    const dvec3 d = positions[other] - center;
    const double length = glm::dot(d, d);
    if (other == point || length >= reach || !cell.clip(d, length / 2, other)) return;
    reach = 4 * farthest_squared(cell);
  });
}

/// The same once its neighbours are known.
void rebuild_cell(std::span<const dvec3> positions, std::uint32_t point, std::span<const std::uint32_t> neighbours,
                  const Bounds& domain, ConvexCell& cell) {
  const dvec3 center = positions[point];
  cell.reset(domain.low - center, domain.high - center);
  for (const std::uint32_t other : neighbours) {
    const dvec3 d = positions[other] - center;
    cell.clip(d, glm::dot(d, d) / 2, other);
  }
}

/// What is usual for the distance of a cell's vertices, which are the centres of Delaunay tetrahedra: the lower
/// quartile, as in trimming.h. Points on a plane have none but those on the domain's box, or at random far away:
/// then the distance of the neighbours stands in.
double usual_radius(const ConvexCell& cell, std::vector<double>& items) {
  std::vector<bool> on_box(cell.vertices().size());
  double farthest_neighbour = 0;
  for (const auto& face : cell.faces())
    if (face.label != ConvexCell::no_label)
      farthest_neighbour = std::max(farthest_neighbour, glm::length(face.normal));
    else
      for (const std::uint32_t v : cell.loop(face)) on_box[v] = true;
  items.clear();
  for (std::size_t v = 0; v < on_box.size(); ++v)
    if (!on_box[v]) items.push_back(glm::length(cell.vertices()[v]));
  if (farthest_neighbour == 0) return glm::length(cell.vertices()[0]);
  return items.empty() ? farthest_neighbour : std::min(quantile(items, 0.25), farthest_neighbour);
}

constexpr double max_radius_ratio = 2;  // as in trimming.h
constexpr double min_facing = 0.4;

/// Cuts off what fills holes and concavities of the domain: vertices out of proportion. The cut runs through the point,
/// parallel to the nearest face on the other side: that ends a boundary layer along the wall however thin it is. With
/// nothing on the other side (points on a plane), the cell gets the thickness of the spacing.
void trim(ConvexCell& cell, std::span<const double> usual, double own) {
  for (int cuts = 0; cuts < 32; ++cuts) {
    // The farthest of the vertices that are too far.
    std::vector<double> limit(cell.vertices().size(), own);
    for (const auto& face : cell.faces())
      if (face.label != ConvexCell::no_label)
        for (const std::uint32_t v : cell.loop(face)) limit[v] = std::max(limit[v], usual[face.label]);
    const dvec3* farthest = nullptr;
    double distance = 0;
    for (std::size_t v = 0; v < limit.size(); ++v) {
      const double length = glm::length(cell.vertices()[v]);
      if (length > max_radius_ratio * limit[v] && length > distance) farthest = &cell.vertices()[v], distance = length;
    }
    if (!farthest) return;
    const ConvexCell::Face* opposite = nullptr;
    double nearest = infinity;
    for (const auto& face : cell.faces()) {
      const double length = glm::length(face.normal);
      if (face.label == ConvexCell::no_label || length >= nearest) continue;
      if (glm::dot(face.normal, *farthest) < -min_facing * length * distance) opposite = &face, nearest = length;
    }
    if (opposite)
      cell.clip(-opposite->normal, 0, ConvexCell::no_label);
    else
      cell.clip(*farthest / distance, own / 2, ConvexCell::no_label);
  }
}

}  // namespace

std::vector<std::uint32_t> distinct_points(std::span<const dvec3> positions) {
  std::vector<std::uint32_t> points(positions.size());
  std::iota(points.begin(), points.end(), 0u);
  const auto place = [&](std::uint32_t i) {
    const dvec3& p = positions[i];
    return std::tie(p.x, p.y, p.z);
  };
  tbb::parallel_sort(points.begin(), points.end(), [&](std::uint32_t i, std::uint32_t j) {
    return place(i) != place(j) ? place(i) < place(j) : i < j;
  });
  const auto repeated =
      std::ranges::unique(points, [&](std::uint32_t i, std::uint32_t j) { return place(i) == place(j); });
  points.erase(repeated.begin(), repeated.end());
  return points;
}

Result<ScatteredEstimate> ScatteredEstimate::create(std::span<const dvec3> positions) {
  if (positions.size() >= ConvexCell::no_label)
    return fail(ErrorCode::unsupported, "{} points are more than an index can name", positions.size());
  ScatteredEstimate estimate;
  estimate.positions_ = positions;
  estimate.spatial_.resize(positions.size());
  estimate.begins_.resize(positions.size() + 1);
  if (positions.empty()) return estimate;
  const PointTree tree(positions, distinct_points(positions));
  const auto points = tree.points();

  // So far out that vertices on it are out of proportion.
  Bounds domain = tree.box();
  const dvec3 extent = domain.high - domain.low;
  const double margin = extent == dvec3(0) ? 0.5 : 4 * glm::length(extent);
  domain.low -= margin;
  domain.high += margin;

  constexpr std::size_t block = 1024;
  const std::size_t blocks = (points.size() + block - 1) / block;
  std::vector<std::vector<std::uint32_t>> found(blocks);
  std::vector<double> own(positions.size()), farthest(positions.size());
  const auto each_block = [&](const auto& work) {
    tbb::parallel_for(std::size_t{0}, blocks, [&](std::size_t b) {
      work(b, points.subspan(b * block, std::min(block, points.size() - b * block)));
    });
  };
  // Whole cells, and what they tell.
  each_block([&](std::size_t b, std::span<const std::uint32_t> members) {
    ConvexCell cell;
    std::vector<double> items;
    for (const std::uint32_t point : members) {
      find_cell(tree, positions, point, domain, cell);
      own[point] = usual_radius(cell, items);
      farthest[point] = std::sqrt(farthest_squared(cell));
      estimate.spatial_[point] = cell.moments();
      for (const auto& face : cell.faces())
        if (face.label != ConvexCell::no_label) found[b].push_back(face.label), ++estimate.begins_[point + 1];
    }
  });
  std::partial_sum(estimate.begins_.begin(), estimate.begins_.end(), estimate.begins_.begin());
  estimate.neighbours_.resize(estimate.begins_.back());
  const auto neighbours = [&](std::uint32_t point) {
    return std::span(estimate.neighbours_)
        .subspan(estimate.begins_[point], estimate.begins_[point + 1] - estimate.begins_[point]);
  };
  each_block([&](std::size_t b, std::span<const std::uint32_t> members) {
    auto next = found[b].begin();
    for (const std::uint32_t point : members)
      for (std::uint32_t& neighbour : neighbours(point)) neighbour = *next++;
    found[b] = {};
  });

  std::vector<double> usual(positions.size());
  each_block([&](std::size_t, std::span<const std::uint32_t> members) {
    std::vector<double> items;
    for (const std::uint32_t point : members) {
      items = {own[point]};
      for (const std::uint32_t neighbour : neighbours(point)) items.push_back(own[neighbour]);
      usual[point] = quantile(items, 0.25);
    }
  });
  // The few that need trimming, once more.
  each_block([&](std::size_t, std::span<const std::uint32_t> members) {
    ConvexCell cell;
    for (const std::uint32_t point : members) {
      if (farthest[point] <= max_radius_ratio * usual[point]) continue;
      rebuild_cell(positions, point, neighbours(point), domain, cell);
      trim(cell, usual, usual[point]);
      estimate.spatial_[point] = cell.moments();
    }
  });
  return estimate;
}

// Least squares over the neighbours, each by the square of its inverse distance: the normal matrix is then a sum of
// unit vectors' squares, well conditioned in boundary layers too.
ScatteredEstimate::Fit ScatteredEstimate::fit(std::size_t point, std::span<const double> values) const {
  Fit result;
  result.min = result.max = values[point];
  glm::dmat3 normal(0.0);
  dvec3 right{0};
  int used = 0;
  for (std::uint64_t k = begins_[point]; k < begins_[point + 1]; ++k) {
    const std::uint32_t neighbour = neighbours_[k];
    const double difference = values[neighbour] - values[point];
    if (std::isnan(difference)) continue;
    const dvec3 offset = positions_[neighbour] - positions_[point];
    const double length = glm::length(offset);
    const dvec3 direction = offset / length;
    normal += glm::outerProduct(direction, direction);
    right += difference / length * direction;
    result.min = std::min(result.min, values[neighbour]);
    result.max = std::max(result.max, values[neighbour]);
    ++used;
  }
  if (used == 0) return result;
  // Directions in which there is no neighbour get no gradient.
  normal += dmat3(1e-12 * used);
  result.gradient = glm::inverse(normal) * right;
  return result;
}

std::vector<ValueMoments> ScatteredEstimate::values(std::span<const double> values) const {
  std::vector<ValueMoments> result(spatial_.size());
  tbb::parallel_for(std::size_t{0}, result.size(), [&](std::size_t i) {
    const SpatialMoments& cell = spatial_[i];
    if (cell.mass == 0 || std::isnan(values[i])) return;
    const Fit line = fit(i, values);
    const dvec3& g = line.gradient;
    const SymmetricMatrix& s = cell.covariance;
    ValueMoments& moments = result[i];
    moments.mass = cell.mass;
    moments.centroid = cell.centroid;
    moments.covariance = {s.xx * g.x + s.xy * g.y + s.xz * g.z, s.xy * g.x + s.yy * g.y + s.yz * g.z,
                          s.xz * g.x + s.yz * g.y + s.zz * g.z};
    moments.variance = std::max(0.0, glm::dot(g, moments.covariance));
    moments.mean = std::clamp(values[i] + glm::dot(g, cell.centroid), line.min, line.max);
    const double reach = std::sqrt(3 * moments.variance);  // half the width of a uniform distribution
    moments.min = std::max(line.min, moments.mean - reach);
    moments.max = std::min(line.max, moments.mean + reach);
  });
  return result;
}

std::vector<vec3> ScatteredEstimate::gradients(std::span<const double> values) const {
  std::vector<vec3> result(spatial_.size(), vec3(0));
  tbb::parallel_for(std::size_t{0}, result.size(), [&](std::size_t i) {
    if (!std::isnan(values[i])) result[i] = vec3(fit(i, values).gradient);
  });
  return result;
}

}  // namespace splatvol
