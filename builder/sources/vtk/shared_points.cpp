#include "builder/sources/vtk/shared_points.h"

#include <vtkCell.h>
#include <vtkDataArray.h>
#include <vtkDataSet.h>
#include <vtkGenericCell.h>
#include <vtkIdList.h>
#include <vtkNew.h>

#include <algorithm>
#include <bit>
#include <numeric>
#include <utility>

#include "builder/sources/vtk/attributes.h"

namespace splatvol {
namespace {

std::uint64_t mix(std::uint64_t value) {
  value = (value ^ (value >> 33)) * 0xff51afd7ed558ccdULL;
  value = (value ^ (value >> 33)) * 0xc4ceb9fe1a85ec53ULL;
  return value ^ (value >> 33);
}

/// Finds the points on faces that only one cell has. The points of a face, in any order, give its hash.
std::vector<vtkIdType> outer_points(vtkDataSet& data) {
  std::unordered_map<std::uint64_t, std::vector<vtkIdType>> open;
  const vtkNew<vtkGenericCell> cell;
  for (vtkIdType c = 0; c < data.GetNumberOfCells(); ++c) {
    data.GetCell(c, cell);
    for (int f = 0; f < cell->GetNumberOfFaces(); ++f) {
      vtkIdList* points = cell->GetFace(f)->GetPointIds();
      std::uint64_t hash = 0;
      for (vtkIdType i = 0; i < points->GetNumberOfIds(); ++i)
        hash += mix(static_cast<std::uint64_t>(points->GetId(i)) + 1);
      const auto [face, is_new] = open.try_emplace(hash, points->begin(), points->end());
      if (!is_new) open.erase(face);
    }
  }
  std::vector<vtkIdType> points;
  for (const auto& [hash, corners] : open) points.insert(points.end(), corners.begin(), corners.end());
  std::ranges::sort(points);
  points.erase(std::ranges::unique(points).begin(), points.end());
  return points;
}

std::array<double, 3> position_of(vtkDataSet& data, vtkIdType point) {
  std::array<double, 3> position{};
  data.GetPoint(point, position.data());
  for (double& coordinate : position) coordinate += 0.0;  // -0 and 0 are one position
  return position;
}

}  // namespace

std::size_t SharedPoints::PositionHash::operator()(const Position& position) const {
  std::uint64_t hash = 0;
  for (const double coordinate : position) hash = mix(hash + std::bit_cast<std::uint64_t>(coordinate));
  return hash;
}

std::uint32_t SharedPoints::number_of(const std::string& array) {
  return numbers_.try_emplace(array, static_cast<std::uint32_t>(numbers_.size())).first->second;
}

void SharedPoints::add(vtkDataSet& part, const std::string& block, const CellAverages& averages,
                       std::span<vtkDataArray* const> arrays, const MissingValues& missing) {
  ++parts_;
  std::vector<std::pair<vtkIdType, Shared*>> outer;
  Block& points = blocks_[block];
  for (const vtkIdType point : outer_points(part)) {
    Shared& shared = points[position_of(part, point)];
    shared.jumps = shared.jumps || shared.last_part == parts_;
    shared.parts += shared.last_part != parts_ ? 1 : 0;
    shared.last_part = parts_;
    outer.emplace_back(point, &shared);  // stays where it is while others are added
  }
  std::vector<std::uint32_t> cells(static_cast<std::size_t>(part.GetNumberOfCells()));
  std::iota(cells.begin(), cells.end(), 0u);
  for (vtkDataArray* array : arrays) {
    const std::uint32_t number = number_of(array->GetName());
    for (int c = 0; c < array->GetNumberOfComponents(); ++c) {
      std::vector<double> weights;
      std::vector<double> values = component_values(*array, c, cells);
      missing.replace(values);
      const std::vector<double> means = averages.means(values, &weights);
      for (const auto& [point, shared] : outer) {
        const auto i = static_cast<std::size_t>(point), component = static_cast<std::size_t>(c);
        std::vector<Mean>& of_array = shared->means[number];
        if (of_array.size() <= component) of_array.resize(component + 1);
        if (!(weights[i] > 0)) continue;
        Mean& mean = of_array[component];
        // So that a constant stays what it is.
        if (mean.weight == 0) mean.value = means[i];
        mean.weight += weights[i];
        mean.value += weights[i] / mean.weight * (means[i] - mean.value);
      }
    }
  }
}

void SharedPoints::finish() {
  for (auto& [name, points] : blocks_)
    std::erase_if(points, [](const auto& point) { return point.second.parts < 2 || point.second.jumps; });
}

void SharedPoints::apply(vtkDataSet& part, const std::string& block, const std::string& array, int component,
                         std::span<double> means) const {
  const auto points = blocks_.find(block);
  const auto number = numbers_.find(array);
  if (points == blocks_.end() || number == numbers_.end()) return;
  const auto c = static_cast<std::size_t>(component);
  for (std::size_t point = 0; point < means.size(); ++point) {
    const auto shared = points->second.find(position_of(part, static_cast<vtkIdType>(point)));
    if (shared == points->second.end()) continue;
    const auto found = shared->second.means.find(number->second);
    if (found == shared->second.means.end() || c >= found->second.size() || found->second[c].weight == 0) continue;
    means[point] = found->second[c].value;
  }
}

}  // namespace splatvol
