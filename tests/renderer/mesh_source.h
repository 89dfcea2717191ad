// A mesh in memory as a source of cells.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <numeric>
#include <span>
#include <utility>
#include <vector>

#include "base/point_gradients.h"
#include "renderer/cell_source.h"
#include "renderer/reference/reference.h"

namespace splatvol::test {

/// Chunks of tetrahedra that are near each other: the leaves of a k-d tree.
class MeshSource : public CellSource {
 public:
  /// `most`: tetrahedra of a chunk.
  MeshSource(const TetMesh& mesh, std::size_t most) : mesh_(mesh) {
    std::vector<std::uint32_t> all(mesh.tetrahedra.size());
    std::iota(all.begin(), all.end(), 0U);
    split(all, most);
  }

  /// Turns the order of the chunks round.
  void reverse() { std::ranges::reverse(chunks_); }

  [[nodiscard]] std::span<const Chunk> chunks() const override { return chunks_; }

  [[nodiscard]] Result<const Tetrahedra*> read(const Chunk& chunk, Tetrahedra& /*scratch*/) const override {
    return &cells_[chunk.number];
  }

  [[nodiscard]] Result<std::shared_ptr<const std::vector<dvec3>>> gradients(
      const Chunk& chunk, const Tetrahedra& /*cells*/, std::span<const double> /*contours*/) const override {
    std::vector<GradientSum> sums(mesh_.points.size());
    add_gradients(mesh_.points, mesh_.tetrahedra, mesh_.values, sums);
    std::vector<dvec3> gradients;
    for (const std::uint32_t point : points_[chunk.number]) gradients.push_back(sums[point].mean());
    return std::make_shared<const std::vector<dvec3>>(std::move(gradients));
  }

 private:
  [[nodiscard]] double middle(std::uint32_t cell, int axis) const {
    double sum = 0;
    for (const std::uint32_t point : mesh_.tetrahedra[cell]) sum += mesh_.points[point][axis];
    return sum;
  }

  void split(std::span<std::uint32_t> cells, std::size_t most) {
    if (cells.size() <= most) return add(cells);
    Box box;
    for (const std::uint32_t cell : cells) box.include({middle(cell, 0), middle(cell, 1), middle(cell, 2)});
    const int axis = longest_axis(box.extent());
    const auto half = cells.begin() + static_cast<std::ptrdiff_t>(cells.size() / 2);
    std::nth_element(cells.begin(), half, cells.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return middle(a, axis) < middle(b, axis); });
    split({cells.begin(), half}, most);
    split({half, cells.end()}, most);
  }

  void add(std::span<const std::uint32_t> numbers) {
    Tetrahedra cells;
    std::vector<std::uint32_t> points;
    for (const std::uint32_t cell : numbers)
      points.insert(points.end(), mesh_.tetrahedra[cell].begin(), mesh_.tetrahedra[cell].end());
    std::ranges::sort(points);
    points.erase(std::ranges::unique(points).begin(), points.end());
    Chunk chunk{{}, static_cast<std::uint32_t>(numbers.size()), chunks_.size()};
    for (const std::uint32_t point : points) {
      cells.points.push_back(mesh_.points[point]);
      chunk.box.include(mesh_.points[point]);
    }
    const auto& of_values = mesh_.constant ? std::vector<std::uint32_t>(numbers.begin(), numbers.end()) : points;
    for (const std::span<const double> all : {mesh_.values, mesh_.opacity_values, mesh_.color_values}) {
      if (all.empty()) continue;
      std::vector<double>& values = cells.values.emplace_back();
      for (const std::uint32_t number : of_values) values.push_back(all[number]);
    }
    cells.constant = mesh_.constant;
    for (const std::uint32_t cell : numbers) {
      std::array<std::uint32_t, 4> corners = mesh_.tetrahedra[cell];
      for (std::uint32_t& corner : corners)
        corner = static_cast<std::uint32_t>(std::ranges::lower_bound(points, corner) - points.begin());
      std::ranges::sort(corners);
      cells.corners.push_back(corners);
    }
    chunks_.push_back(chunk);
    cells_.push_back(std::move(cells));
    points_.push_back(std::move(points));
  }

  TetMesh mesh_;
  std::vector<Chunk> chunks_;
  std::vector<Tetrahedra> cells_;
  std::vector<std::vector<std::uint32_t>> points_;  // [chunk]
};

}  // namespace splatvol::test
