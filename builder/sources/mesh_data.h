// Meshes in memory as data sets.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/math.h"
#include "builder/sources/data_set.h"
#include "splatvol/build.h"

namespace splatvol {

/// A mesh that a reader of ours makes. Cells are as in MeshArrays (include/splatvol/build.h).
struct MeshData {
  std::vector<dvec3> points;
  std::vector<std::uint8_t> types;  // [cell]: VTK's numbers
  std::vector<std::int64_t> offsets = {0}, connectivity;
  std::vector<std::int64_t> faces, face_locations;  // empty: there are no polyhedra
  std::vector<std::pair<ArrayShape, std::vector<double>>> arrays;

  /// Appends a cell with its points; those of a polyhedron in any order, besides its faces.
  template <class Points>
  void add_cell(int type, const Points& of_cell) {
    types.push_back(static_cast<std::uint8_t>(type));
    connectivity.insert(connectivity.end(), of_cell.begin(), of_cell.end());
    offsets.push_back(static_cast<std::int64_t>(connectivity.size()));
  }
};

/// The data set of a mesh. Its arrays outlive it where they are lent.
class MeshDataSet : public DataSet {
 public:
  explicit MeshDataSet(MeshData mesh);

  /// A mesh in the caller's memory, or `count` of its points from `first` on if it has no cells. The arrays must
  /// outlive all that is made of them.
  MeshDataSet(const MeshArrays& mesh, std::size_t first, std::size_t count);

  MeshDataSet(const MeshDataSet&) = delete;
  MeshDataSet& operator=(const MeshDataSet&) = delete;

  /// The points of a MeshData.
  [[nodiscard]] std::span<const dvec3> points() const { return own_.points; }

  [[nodiscard]] std::uint64_t point_count() const override { return count_; }
  [[nodiscard]] std::uint64_t cell_count() const override { return view_.types.size(); }
  void read_points(std::span<dvec3> points) const override;
  [[nodiscard]] Status check_cells(const std::string& name) const override;
  [[nodiscard]] int cell_type(std::uint64_t cell) const override { return view_.types[cell]; }
  void append_points(std::uint64_t cell, std::vector<std::int64_t>& points) const override;
  [[nodiscard]] std::int64_t face_stream_length() const override {
    return static_cast<std::int64_t>(view_.faces.size());
  }
  [[nodiscard]] std::int64_t face_location(std::uint64_t cell) const override {
    return cell < view_.face_locations.size() ? view_.face_locations[cell] : -1;
  }
  [[nodiscard]] std::int64_t face_number(std::int64_t at) const override {
    return view_.faces[static_cast<std::size_t>(at)];
  }
  [[nodiscard]] std::vector<dvec3> parametric_points(int type, std::size_t count) const override;
  [[nodiscard]] std::vector<ArrayShape> arrays() const override;
  [[nodiscard]] std::optional<std::shared_ptr<const NumberArray>> array(const std::string& name,
                                                                        bool of_cells) const override;
  void add_cell_values(const std::string& name, std::vector<double> values) override;

 private:
  void add_array(ArrayShape shape, std::vector<double> values);

  MeshData own_;
  MeshArrays view_;  // of own_, or of the caller's mesh
  std::size_t first_ = 0, count_;
  std::vector<std::pair<ArrayShape, std::shared_ptr<const NumberArray>>> arrays_;
};

}  // namespace splatvol
