#include "builder/sources/openfoam/shared_points.h"

#include <algorithm>
#include <bit>

namespace splatvol {
namespace {

std::uint64_t mix(std::uint64_t value) {
  value = (value ^ (value >> 33)) * 0xff51afd7ed558ccdULL;
  value = (value ^ (value >> 33)) * 0xc4ceb9fe1a85ec53ULL;
  return value ^ (value >> 33);
}

}  // namespace

std::vector<std::uint32_t> outer_points(const FoamMesh& mesh) {
  std::unordered_map<std::uint64_t, std::span<const std::uint32_t>> open;
  for (std::size_t face = mesh.neighbour.size(); face < mesh.faces.size(); ++face) {
    const auto corners = mesh.faces[face];
    std::uint64_t hash = 0;
    for (const std::uint32_t corner : corners) hash += mix(corner + std::uint64_t{1});
    const auto [known, is_new] = open.try_emplace(hash, corners);
    if (!is_new) open.erase(known);
  }
  std::vector<std::uint32_t> points;
  for (const auto& [hash, corners] : open) points.insert(points.end(), corners.begin(), corners.end());
  std::ranges::sort(points);
  points.erase(std::ranges::unique(points).begin(), points.end());
  return points;
}

std::size_t SharedPoints::PositionHash::operator()(const dvec3& position) const {
  std::uint64_t hash = 0;
  for (int axis = 0; axis < 3; ++axis) hash = mix(hash + std::bit_cast<std::uint64_t>(position[axis] + 0.0));  // no -0
  return hash;
}

std::uint32_t SharedPoints::number_of(const std::string& array) {
  return numbers_.try_emplace(array, static_cast<std::uint32_t>(numbers_.size())).first->second;
}

void SharedPoints::add(const MeshDataSet& part, std::span<const std::uint32_t> outer, const std::string& block,
                       const CellAverages& averages, const MissingValues& missing) {
  ++parts_;
  std::vector<Shared*> of_outer;
  Block& points = blocks_[block];
  for (const std::uint32_t point : outer) {
    Shared& shared = points[part.points()[point]];
    shared.jumps = shared.jumps || shared.last_part == parts_;
    shared.parts += shared.last_part != parts_ ? 1 : 0;
    shared.last_part = parts_;
    of_outer.push_back(&shared);  // stays where it is while others are added
  }
  for (const ArrayShape& shape : part.arrays()) {
    if (!*shape.of_cells) continue;
    const std::uint32_t number = number_of(shape.name);
    const auto array = *part.array(shape.name, true);
    for (int c = 0; c < shape.components; ++c) {
      std::vector<double> weights;
      std::vector<double> values = component_values(*array, c, part.cell_count());
      missing.replace(values);
      const std::vector<double> means = averages.means(values, &weights);
      for (std::size_t i = 0; i < outer.size(); ++i) {
        const auto component = static_cast<std::size_t>(c);
        std::vector<Mean>& of_array = of_outer[i]->means[number];
        if (of_array.size() <= component) of_array.resize(component + 1);
        const double weight = weights[outer[i]], value = means[outer[i]];
        if (!(weight > 0)) continue;
        Mean& mean = of_array[component];
        // So that a constant stays what it is.
        if (mean.weight == 0) mean.value = value;
        mean.weight += weight;
        mean.value += weight / mean.weight * (value - mean.value);
      }
    }
  }
}

void SharedPoints::finish() {
  for (auto& [name, points] : blocks_)
    std::erase_if(points, [](const auto& point) { return point.second.parts < 2 || point.second.jumps; });
}

void SharedPoints::apply(std::span<const dvec3> points, const std::string& block, const std::string& array,
                         int component, std::span<double> means) const {
  const auto of_block = blocks_.find(block);
  const auto number = numbers_.find(array);
  if (of_block == blocks_.end() || number == numbers_.end()) return;
  const auto c = static_cast<std::size_t>(component);
  for (std::size_t point = 0; point < means.size(); ++point) {
    const auto shared = of_block->second.find(points[point]);
    if (shared == of_block->second.end()) continue;
    const auto found = shared->second.means.find(number->second);
    if (found == shared->second.means.end() || c >= found->second.size() || found->second[c].weight == 0) continue;
    means[point] = found->second[c].value;
  }
}

}  // namespace splatvol
