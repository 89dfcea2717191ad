#include "builder/sources/vtk/shared_points.h"

#include <vtkCell.h>
#include <vtkDataArray.h>
#include <vtkDataSet.h>
#include <vtkGenericCell.h>
#include <vtkIdList.h>
#include <vtkNew.h>
#include <vtkPointData.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <unordered_set>

#include "builder/sources/vtk/cell_averages.h"

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

void SharedPoints::add(vtkDataSet& part, const std::string& block) {
  Block& points = blocks_[block];
  ++parts_;
  const std::vector<double> weights = cell_weights(part);
  vtkPointData& arrays = *part.GetPointData();
  for (const vtkIdType point : outer_points(part)) {
    Shared& shared = points[position_of(part, point)];
    shared.jumps = shared.jumps || shared.last_part == parts_;
    shared.parts += shared.last_part != parts_ ? 1 : 0;
    shared.last_part = parts_;
    for (int i = 0; i < arrays.GetNumberOfArrays(); ++i) {
      vtkDataArray* array = arrays.GetArray(i);
      if (!array || !array->GetName()) continue;
      const auto components = static_cast<std::size_t>(array->GetNumberOfComponents());
      std::vector<double>& sums = shared.sums[number_of(array->GetName())];
      sums.resize(std::max(sums.size(), 2 * components));
      for (std::size_t c = 0; c < components; ++c) {
        const double value = array->GetComponent(point, static_cast<int>(c));
        if (!std::isfinite(value)) continue;
        const double weight = weights[static_cast<std::size_t>(point)];
        sums[2 * c] += weight;
        sums[2 * c + 1] += weight * value;
      }
    }
  }
}

void SharedPoints::finish() {
  for (auto& [name, points] : blocks_)
    std::erase_if(points, [](const auto& point) { return point.second.parts < 2 || point.second.jumps; });
}

void SharedPoints::apply(vtkDataSet& part, const std::string& block) const {
  const auto points = blocks_.find(block);
  if (points == blocks_.end()) return;
  vtkPointData& arrays = *part.GetPointData();
  for (vtkIdType point = 0; point < part.GetNumberOfPoints(); ++point) {
    const auto shared = points->second.find(position_of(part, point));
    if (shared == points->second.end()) continue;
    for (int i = 0; i < arrays.GetNumberOfArrays(); ++i) {
      vtkDataArray* array = arrays.GetArray(i);
      const auto number = array && array->GetName() ? numbers_.find(array->GetName()) : numbers_.end();
      if (number == numbers_.end()) continue;
      const auto sums = shared->second.sums.find(number->second);
      if (sums == shared->second.sums.end()) continue;
      for (int c = 0; c < array->GetNumberOfComponents(); ++c) {
        const auto at = 2 * static_cast<std::size_t>(c);
        if (at + 1 < sums->second.size() && sums->second[at] > 0)
          array->SetComponent(point, c, sums->second[at + 1] / sums->second[at]);
      }
    }
  }
}

}  // namespace splatvol
