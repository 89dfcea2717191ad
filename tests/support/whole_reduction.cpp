#include "tests/support/whole_reduction.h"

#include <algorithm>
#include <numeric>

namespace splatvol::test {
namespace {

constexpr std::size_t coarsest_target = 512;
constexpr std::size_t max_resolutions = 64;

void visit_node(std::span<const MortonKey> keys, std::uint64_t leaf_points, std::size_t begin, std::size_t end,
                int depth, const NodeVisitor& visit) {
  const bool leaf = end - begin <= leaf_points || depth == max_morton_depth;
  visit(begin, end, depth, leaf);
  for (std::size_t child = begin; !leaf && child < end;) {
    std::size_t child_end = child;
    while (child_end < end && octant_at(keys[child_end], depth) == octant_at(keys[child], depth)) ++child_end;
    visit_node(keys, leaf_points, child, child_end, depth + 1, visit);
    child = child_end;
  }
}

// Sets everything but the members.
void find_leaves(std::span<const MortonKey> keys, std::uint32_t leaf_points, Resolution& resolution) {
  std::vector<MortonKey> member_keys;
  for (const std::uint64_t i : resolution.members) member_keys.push_back(keys[i]);
  visit_octree(member_keys, leaf_points, [&](std::size_t begin, std::size_t end, int depth, bool leaf) {
    if (!leaf) return;
    resolution.begins.push_back(begin);
    resolution.depths.resize(end, static_cast<std::uint8_t>(depth));
    resolution.counts.resize(end, static_cast<std::uint8_t>(std::min<std::size_t>(end - begin, 255)));
  });
  resolution.begins.push_back(resolution.size());
}

std::uint64_t nearest_to_center(std::span<const dvec3> positions, const Cube& cube,
                                std::span<const std::uint64_t> members, int depth) {
  const dvec3 center = cell_center(positions[members[0]], cube, depth);
  return *std::ranges::min_element(members, {}, [&](std::uint64_t i) {
    const dvec3 offset = (positions[i] - center) / cube.edge;
    return glm::dot(offset, offset);
  });
}

}  // namespace

void visit_octree(std::span<const MortonKey> keys, std::uint64_t leaf_points, const NodeVisitor& visit) {
  visit_node(keys, leaf_points, 0, keys.size(), 0, visit);
}

std::vector<Resolution> reduce_by_octree(std::span<const MortonKey> keys, std::span<const dvec3> positions,
                                         const Cube& cube, std::uint32_t leaf_points) {
  std::vector<Resolution> resolutions(1);
  resolutions[0].members.resize(keys.size());
  std::iota(resolutions[0].members.begin(), resolutions[0].members.end(), std::uint64_t{0});
  for (;;) {
    Resolution& finer = resolutions.back();
    find_leaves(keys, leaf_points, finer);
    if (finer.size() <= coarsest_target || resolutions.size() == max_resolutions) break;
    Resolution coarser;
    for (std::size_t k = 0; k + 1 < finer.begins.size(); ++k) {
      const std::uint64_t begin = finer.begins[k], end = finer.begins[k + 1];
      const auto members = std::span(finer.members).subspan(begin, end - begin);
      coarser.members.push_back(nearest_to_center(positions, cube, members, finer.depths[begin]));
    }
    resolutions.push_back(std::move(coarser));
  }
  std::ranges::reverse(resolutions);
  return resolutions;
}

std::vector<std::uint8_t> find_segments(std::span<const Resolution> resolutions) {
  std::vector<std::uint8_t> segments(resolutions.back().size());
  for (std::size_t r = resolutions.size(); r-- > 0;)
    for (const std::uint64_t point : resolutions[r].members) segments[point] = static_cast<std::uint8_t>(r);
  return segments;
}

std::vector<std::uint64_t> file_order(std::span<const Resolution> resolutions) {
  const std::vector<std::uint8_t> segments = find_segments(resolutions);
  std::vector<std::uint64_t> order = resolutions.back().members;
  std::ranges::stable_sort(order, {}, [&](std::uint64_t i) { return segments[i]; });
  return order;
}

}  // namespace splatvol::test
