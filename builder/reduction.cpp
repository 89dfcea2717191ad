#include "builder/reduction.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <deque>
#include <numeric>

namespace splatvol {
namespace {

constexpr std::size_t coarsest_target = 512;
constexpr std::size_t max_resolutions = 64;

// Number of members from `begin` on that share its leaf.
std::size_t leaf_end(std::span<const MortonKey> keys, const Resolution& resolution, std::size_t begin) {
  const MortonKey& key = keys[resolution.members[begin]];
  const int depth = resolution.depths[begin];
  std::size_t end = begin + 1;
  while (end < resolution.size() && common_depth(key, keys[resolution.members[end]]) >= depth) ++end;
  return end;
}

std::uint64_t nearest_to_center(std::span<const dvec3> positions, const Cube& cube, const Resolution& resolution,
                                std::size_t begin, std::size_t end) {
  const dvec3 center = cell_center(positions[resolution.members[begin]], cube, resolution.depths[begin]);
  const auto distance = [&](std::uint64_t point) {
    const dvec3 offset = (positions[point] - center) / cube.edge;
    return glm::dot(offset, offset);
  };
  return *std::min_element(resolution.members.begin() + static_cast<std::ptrdiff_t>(begin),
                           resolution.members.begin() + static_cast<std::ptrdiff_t>(end),
                           [&](std::uint64_t a, std::uint64_t b) { return distance(a) < distance(b); });
}

}  // namespace

// A cell is split where it holds more than N members, that is where it holds N + 1 consecutive ones. So a member's leaf
// lies one level below the deepest cell that some window of N + 1 members around it shares: no tree is built, and one
// pass over sorted keys is enough, whatever their number.
void find_leaves(std::span<const MortonKey> keys, std::uint32_t leaf_points, Resolution& resolution) {
  const std::size_t n = resolution.size(), window = leaf_points;
  resolution.depths.assign(n, 0);
  resolution.counts.assign(n, 0);
  const auto shared_depth = [&](std::size_t first) {
    return common_depth(keys[resolution.members[first]], keys[resolution.members[first + window]]);
  };
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, n, 4096), [&](const tbb::blocked_range<std::size_t>& range) {
    // Maximum of shared_depth over the windows that contain i, by a queue of falling depths.
    std::deque<std::pair<std::size_t, int>> deepest;
    std::size_t next = range.begin() > window ? range.begin() - window : 0;
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      for (; next <= i && next + window < n; ++next) {
        const int depth = shared_depth(next);
        while (!deepest.empty() && deepest.back().second <= depth) deepest.pop_back();
        deepest.emplace_back(next, depth);
      }
      while (!deepest.empty() && deepest.front().first + window < i) deepest.pop_front();
      const int depth = deepest.empty() ? 0 : deepest.front().second + 1;
      resolution.depths[i] = static_cast<std::uint8_t>(std::min(depth, max_morton_depth));
    }
  });
  for (std::size_t begin = 0; begin < n;) {
    const std::size_t end = leaf_end(keys, resolution, begin);
    std::fill(resolution.counts.begin() + static_cast<std::ptrdiff_t>(begin),
              resolution.counts.begin() + static_cast<std::ptrdiff_t>(end),
              static_cast<std::uint8_t>(std::min<std::size_t>(end - begin, 255)));
    begin = end;
  }
}

std::vector<std::uint64_t> leaf_begins(std::span<const MortonKey> keys, const Resolution& resolution) {
  std::vector<std::uint64_t> begins = {0};
  while (begins.back() < resolution.size()) begins.push_back(leaf_end(keys, resolution, begins.back()));
  return begins;
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
    for (std::size_t begin = 0; begin < finer.size();) {
      const std::size_t end = leaf_end(keys, finer, begin);
      coarser.members.push_back(nearest_to_center(positions, cube, finer, begin, end));
      begin = end;
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

}  // namespace splatvol
