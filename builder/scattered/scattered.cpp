#include "builder/scattered/scattered.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>
#include <utility>

#include "base/interruption.h"
#include "builder/scattered/trimming.h"
#include "builder/scattered/voronoi_cell.h"

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

/// A balanced k-d tree; the children of tree node i are 2 i + 1 and 2 i + 2.
class PointTree {
 public:
  PointTree(std::span<const dvec3> positions, std::vector<std::uint32_t> points)
      : positions_(positions), points_(std::move(points)) {
    while ((points_.size() >> bucket_depth_) > bucket_points) ++bucket_depth_;
    boxes_.resize((std::size_t{2} << bucket_depth_) - 1);
    build({0, 0, points_.size(), 0});
  }

  [[nodiscard]] std::span<const std::uint32_t> points() const { return points_; }
  [[nodiscard]] const Box& box() const { return boxes_[0]; }

  /// Calls visit(point) for the points of every bucket if wanted(box) is true of all boxes round it. Goes roughly from
  /// near to far.
  template <class Wanted, class Visit>
  void search(const dvec3& from, const Wanted& wanted, const Visit& visit) const {
    search({0, 0, points_.size(), 0}, from, wanted, visit);
  }

 private:
  static constexpr std::size_t bucket_points = 6;
  struct Node {
    std::size_t number, begin, end;
    int depth;
    [[nodiscard]] std::size_t middle() const { return begin + (end - begin) / 2; }
    [[nodiscard]] Node lower() const { return {2 * number + 1, begin, middle(), depth + 1}; }
    [[nodiscard]] Node upper() const { return {2 * number + 2, middle(), end, depth + 1}; }
  };

  void build(const Node& node) {
    Box& box = boxes_[node.number];
    for (std::size_t i = node.begin; i < node.end; ++i) box.include(positions_[points_[i]]);
    if (node.depth == bucket_depth_) return;
    const int axis = longest_axis(box.extent());
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
    if (node.depth == bucket_depth_) {
      for (std::size_t i = node.begin; i < node.end; ++i) visit(points_[i]);
      return;
    }
    Node near = node.lower(), far = node.upper();
    if (squared_distance(boxes_[far.number], from) < squared_distance(boxes_[near.number], from)) std::swap(near, far);
    search(near, from, wanted, visit);
    search(far, from, wanted, visit);
  }

  std::span<const dvec3> positions_;
  std::vector<std::uint32_t> points_;
  int bucket_depth_ = 0;
  std::vector<Box> boxes_;  // [number of a tree node]
};

/// Makes the Voronoi cell of a point, relative to the point. Another point can matter only if it is nearer to a vertex
/// of the cell than this point is: so the search skips whole boxes of long rows in boundary layers.
void find_cell(const PointTree& tree, std::span<const dvec3> positions, std::uint32_t point, const Box& domain,
               ConvexCell& cell) {
  const dvec3 center = positions[point];
  cell.reset(domain.low - center, domain.high - center);
  double reach = infinity;  // the square of twice the distance to the farthest vertex
  const auto wanted = [&](const Box& box) {
    if (squared_distance(box, center) >= reach) return false;
    const Box local{box.low - center, box.high - center};
    return std::ranges::any_of(cell.vertices(),
                               [&](const dvec3& v) { return squared_distance(local, v) < squared_length(v); });
  };
  tree.search(center, wanted, [&](std::uint32_t other) {
    const dvec3 d = positions[other] - center;
    const double square = squared_length(d);
    if (other == point || square >= reach || !cell.clip(d, square / 2, other)) return;
    reach = 4 * farthest_squared(cell);
  });
}

}  // namespace

std::vector<std::uint32_t> distinct_points(std::span<const dvec3> positions) {
  std::vector<std::uint32_t> points(positions.size());
  std::iota(points.begin(), points.end(), 0u);
  const auto coordinates = [&](std::uint32_t i) {
    const dvec3& p = positions[i];
    return std::tie(p.x, p.y, p.z);
  };
  tbb::parallel_sort(points.begin(), points.end(), [&](std::uint32_t i, std::uint32_t j) {
    return coordinates(i) != coordinates(j) ? coordinates(i) < coordinates(j) : i < j;
  });
  const auto repeated =
      std::ranges::unique(points, [&](std::uint32_t i, std::uint32_t j) { return coordinates(i) == coordinates(j); });
  points.erase(repeated.begin(), repeated.end());
  return points;
}

class ScatteredEstimate::Builder {
 public:
  explicit Builder(ScatteredEstimate& estimate)
      : estimate_(estimate),
        positions_(estimate.positions_),
        tree_(positions_, distinct_points(positions_)),
        points_(tree_.points()),
        domain_(tree_.box()),
        found_((points_.size() + task_points - 1) / task_points),
        own_(positions_.size()),
        farthest_(positions_.size()) {
    // The domain is so large that vertices on its border are out of proportion.
    const dvec3 extent = domain_.extent();
    const double margin = extent == dvec3(0) ? 0.5 : 4 * glm::length(extent);
    domain_.low -= margin;
    domain_.high += margin;
  }

  Status run() {
    find_cells();
    SPLATVOL_TRY(check_interruption());
    store_neighbours();
    trim_cells(usual_radii());
    return {};
  }

 private:
  static constexpr std::size_t task_points = 1024;

  // Calls work(task, points) for all points, in parallel.
  template <class Work>
  void for_each_task(const Work& work) const {
    tbb::parallel_for(std::size_t{0}, found_.size(), [&](std::size_t task) {
      work(task, points_.subspan(task * task_points, std::min(task_points, points_.size() - task * task_points)));
    });
  }

  void find_cells() {
    for_each_task([&, stop = stop_of_thread()](std::size_t task, std::span<const std::uint32_t> points) {
      if (stop.stop_requested()) return;
      ConvexCell cell;
      std::vector<double> items;
      for (const std::uint32_t point : points) {
        find_cell(tree_, positions_, point, domain_, cell);
        own_[point] = usual_radius(cell, items);
        farthest_[point] = std::sqrt(farthest_squared(cell));
        estimate_.spatial_[point] = cell.moments();
        for (const auto& face : cell.faces())
          if (face.label != ConvexCell::no_label) found_[task].push_back(face.label), ++estimate_.begins_[point + 1];
      }
    });
  }

  // Puts each point's neighbours into one array, in the order of the points.
  void store_neighbours() {
    std::vector<std::uint64_t>& begins = estimate_.begins_;
    std::partial_sum(begins.begin(), begins.end(), begins.begin());
    estimate_.neighbours_.resize(begins.back());
    for_each_task([&](std::size_t task, std::span<const std::uint32_t> points) {
      auto next = found_[task].begin();
      for (const std::uint32_t point : points)
        for (std::uint64_t k = begins[point]; k < begins[point + 1]; ++k) estimate_.neighbours_[k] = *next++;
      found_[task] = {};
    });
  }

  // [point]: the lower quartile over the point and its neighbours.
  [[nodiscard]] std::vector<double> usual_radii() const {
    std::vector<double> usual(positions_.size());
    for_each_task([&](std::size_t, std::span<const std::uint32_t> points) {
      std::vector<double> items;
      for (const std::uint32_t point : points) {
        items = {own_[point]};
        for (const std::uint32_t neighbour : estimate_.neighbours(point)) items.push_back(own_[neighbour]);
        usual[point] = quantile(items, 0.25);
      }
    });
    return usual;
  }

  // Makes the few cells again that need trimming.
  void trim_cells(const std::vector<double>& usual) {
    for_each_task([&](std::size_t, std::span<const std::uint32_t> points) {
      ConvexCell cell;
      for (const std::uint32_t point : points) {
        if (farthest_[point] <= max_radius_ratio * usual[point]) continue;
        make_cell(positions_, point, estimate_.neighbours(point), domain_, cell);
        trim(cell, usual, usual[point]);
        estimate_.spatial_[point] = cell.moments();
      }
    });
  }

  ScatteredEstimate& estimate_;
  std::span<const dvec3> positions_;
  PointTree tree_;
  std::span<const std::uint32_t> points_;          // distinct, in the order of the tree
  Box domain_;                                     // bounds all cells
  std::vector<std::vector<std::uint32_t>> found_;  // [task]: neighbours of its points, one point after the other
  std::vector<double> own_;                        // [point]: usual distance of its cell's vertices
  std::vector<double> farthest_;                   // [point]: largest such distance
};

Result<ScatteredEstimate> ScatteredEstimate::create(std::span<const dvec3> positions) {
  if (positions.size() >= ConvexCell::no_label)
    return fail(ErrorCode::unsupported, "{} points are more than an index can name", positions.size());
  ScatteredEstimate estimate;
  estimate.positions_ = positions;
  estimate.spatial_.resize(positions.size());
  estimate.begins_.resize(positions.size() + 1);
  if (!positions.empty()) SPLATVOL_TRY(Builder(estimate).run());
  return estimate;
}

ValueMoments ScatteredEstimate::value(std::size_t point, std::span<const double> values) const {
  if (spatial_[point].mass == 0 || std::isnan(values[point])) return {};
  return value_in_cell(spatial_[point], values[point], fit(point, values));
}

std::vector<ValueMoments> ScatteredEstimate::values(std::span<const double> values) const {
  std::vector<ValueMoments> result(spatial_.size());
  tbb::parallel_for(std::size_t{0}, result.size(), [&](std::size_t i) { result[i] = value(i, values); });
  return result;
}

std::vector<dvec3> ScatteredEstimate::gradients(std::span<const double> values) const {
  std::vector<dvec3> result(spatial_.size(), dvec3(0));
  tbb::parallel_for(std::size_t{0}, result.size(), [&](std::size_t i) { result[i] = gradient(i, values); });
  return result;
}

}  // namespace splatvol
