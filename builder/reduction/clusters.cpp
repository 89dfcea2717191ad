#include "builder/reduction/clusters.h"

#include <limits>
#include <numeric>
#include <utility>

#include "builder/scattered/delaunay_edges.h"

namespace splatvol {
namespace {

constexpr std::uint32_t none = std::numeric_limits<std::uint32_t>::max();

double longest_edge(const Box& box) {
  const dvec3 extent = box.extent();
  return extent[longest_axis(extent)];
}

// Finds the point nearest to a position (ties: the lower index). Compares distances in units of `scale`, so that their
// squares neither overflow nor vanish.
class Nearest {
 public:
  Nearest(const dvec3& position, double scale) : position_(position), scale_(scale) {}

  void consider(std::uint32_t i, const dvec3& position) {
    const dvec3 offset = scale_ > 0 ? (position - position_) / scale_ : dvec3(0);
    nearest_ = std::min(nearest_, {glm::dot(offset, offset), i});
  }
  [[nodiscard]] std::uint32_t index() const { return nearest_.second; }

 private:
  dvec3 position_;
  double scale_;
  std::pair<double, std::uint32_t> nearest_{std::numeric_limits<double>::infinity(), none};
};

// Halves `part` until it has at most `most` points, and sets their owners.
void halve(std::span<const dvec3> positions, std::span<std::uint32_t> part, std::size_t most,
           std::span<std::uint32_t> owners) {
  Box box;
  for (const std::uint32_t i : part) box.include(positions[i]);
  if (part.size() <= most) {
    Nearest nearest(box.low / 2.0 + box.high / 2.0, longest_edge(box));
    for (const std::uint32_t i : part) nearest.consider(i, positions[i]);
    for (const std::uint32_t i : part) owners[i] = nearest.index();
    return;
  }
  const int axis = longest_axis(box.extent());
  const std::size_t half = part.size() / 2;
  std::ranges::nth_element(part, part.begin() + static_cast<std::ptrdiff_t>(half), {},
                           [&](std::uint32_t i) { return std::pair(positions[i][axis], i); });
  halve(positions, part.first(half), most, owners);
  halve(positions, part.subspan(half), most, owners);
}

void find_buckets(std::span<const dvec3> positions, std::size_t most, std::span<std::uint32_t> owners) {
  std::vector<std::uint32_t> all(positions.size());
  std::iota(all.begin(), all.end(), 0u);
  halve(positions, all, most, owners);
}

// The points that an edge joins to each point.
IndexLists neighbours_of(std::size_t points, std::span<const Edge> edges) {
  IndexLists neighbours;
  neighbours.assign(points, [&](const auto& add) {
    for (const auto& [a, b] : edges) {
      add(a, b);
      add(b, a);
    }
  });
  return neighbours;
}

void find_independent_set(std::span<const dvec3> positions, std::span<std::uint32_t> owners) {
  const IndexLists neighbours = neighbours_of(positions.size(), delaunay_edges(positions));
  std::vector<std::uint32_t> order(positions.size());
  std::iota(order.begin(), order.end(), 0u);
  std::ranges::sort(order, {}, [&](std::uint32_t i) { return std::pair(neighbours[i].size(), i); });
  const auto stays = [&](std::uint32_t i) { return owners[i] == i; };
  std::ranges::fill(owners, none);
  for (const std::uint32_t i : order)
    if (std::ranges::none_of(neighbours[i], stays)) owners[i] = i;

  Box box;
  for (const dvec3& p : positions) box.include(p);
  for (std::uint32_t i = 0; i < positions.size(); ++i) {
    if (stays(i)) continue;
    Nearest nearest(positions[i], longest_edge(box));
    for (const std::uint32_t k : neighbours[i])
      if (stays(k)) nearest.consider(k, positions[k]);
    owners[i] = nearest.index();
  }
}

}  // namespace

const char* reduction_name(Reduction method) {
  switch (method) {
    case Reduction::mis:
      return "mis";
    case Reduction::kdtree:
      return "kdtree";
    default:
      return "octree";
  }
}

Result<Reduction> parse_reduction(const std::string& name) {
  for (const Reduction reduction : {Reduction::octree, Reduction::mis, Reduction::kdtree})
    if (name == reduction_name(reduction)) return reduction;
  return fail(ErrorCode::invalid_argument, "reduction \"{}\": take octree, mis or kdtree", name);
}

void find_clusters(Reduction method, std::uint32_t leaf_points, std::span<const MortonKey> keys,
                   std::span<const dvec3> positions, std::span<std::uint32_t> owners) {
  // Points that share a key could never be told apart again, and CGAL wants distinct positions: of each key only the
  // first point takes part.
  std::vector<std::uint32_t> firsts;
  std::vector<dvec3> distinct;
  for (std::uint32_t i = 0; i < keys.size(); ++i) {
    if (i > 0 && keys[i] == keys[i - 1]) continue;
    firsts.push_back(i);
    distinct.push_back(positions[i]);
  }
  std::vector<std::uint32_t> distinct_owners(distinct.size());
  if (method == Reduction::kdtree)
    find_buckets(distinct, leaf_points, distinct_owners);
  else
    find_independent_set(distinct, distinct_owners);
  for (std::size_t i = 0, d = 0; i < keys.size(); ++i) {
    if (d + 1 < firsts.size() && firsts[d + 1] == i) ++d;
    owners[i] = firsts[distinct_owners[d]];
  }
}

}  // namespace splatvol
