// Exodus files, written with the format's own library.
#pragma once

#include <gtest/gtest.h>
#include <vtk_exodusII.h>

#include <array>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "base/math.h"

namespace splatvol::test {

inline constexpr std::array<double, 2> times = {0.5, 2};

/// The scalar "f" at a time.
inline double field(dvec3 p, double time) { return (1 + p.x - 2 * p.y + 0.5 * p.z) * (1 + time); }

/// A block of cells of one type, by the numbers of their points from 1.
struct ExodusBlock {
  std::string type;
  std::vector<std::vector<int>> cells;
};

using NodalValue = std::function<double(dvec3 point, double time)>;
using CellValue = std::function<double(std::size_t cell, double time)>;

/// Sides of cells: the number of the cell from 1, and that of its side.
struct ExodusSideSet {
  std::string name;  // may be empty
  std::vector<std::pair<int, int>> sides;
};

/// A mesh with values at `times`.
struct ExodusMesh {
  std::vector<dvec3> points;
  std::vector<ExodusBlock> blocks;
  std::vector<std::pair<std::string, NodalValue>> nodal = {{"f", field}};
  std::vector<std::pair<std::string, CellValue>> of_cells = {};  // of the last block
  std::vector<int> node_numbers = {};                            // names of the points in a map of the file
  std::vector<ExodusSideSet> side_sets = {};                     // numbered from 7
  std::size_t steps = times.size();
  int real_bytes = 8;
  int mode = EX_CLOBBER;

  void write(const std::string& path) const {
    int computer = 8, file = real_bytes;
    const int id = ex_create(path.c_str(), mode, &computer, &file);
    ASSERT_GE(id, 0);
    put_mesh(id);
    put_variables(id);
    ex_close(id);
  }

 private:
  void put_mesh(int id) const {
    std::size_t cells = 0;
    for (const ExodusBlock& block : blocks) cells += block.cells.size();
    ex_put_init(id, "test", 3, static_cast<std::int64_t>(points.size()), static_cast<std::int64_t>(cells),
                static_cast<std::int64_t>(blocks.size()), 0, static_cast<std::int64_t>(side_sets.size()));
    std::array<std::vector<double>, 3> axes;
    for (const dvec3& p : points)
      for (std::size_t axis = 0; axis < 3; ++axis) axes[axis].push_back(p[static_cast<int>(axis)]);
    ex_put_coord(id, axes[0].data(), axes[1].data(), axes[2].data());
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      std::vector<int> connectivity;
      for (const auto& cell : blocks[b].cells) connectivity.insert(connectivity.end(), cell.begin(), cell.end());
      const auto count = static_cast<std::int64_t>(blocks[b].cells.size());
      const auto nodes = static_cast<std::int64_t>(blocks[b].cells.at(0).size());
      const auto number = static_cast<std::int64_t>(10 * (b + 1));
      ex_put_block(id, EX_ELEM_BLOCK, number, blocks[b].type.c_str(), count, nodes, 0, 0, 0);
      ex_put_conn(id, EX_ELEM_BLOCK, number, connectivity.data(), nullptr, nullptr);
    }
    if (!node_numbers.empty()) {
      ex_put_map_param(id, 1, 0);
      ex_put_num_map(id, EX_NODE_MAP, 1, node_numbers.data());
      ex_put_id_map(id, EX_NODE_MAP, node_numbers.data());
    }
    for (std::size_t set = 0; set < side_sets.size(); ++set) {
      const auto& [name, sides] = side_sets[set];
      const auto id_of_set = static_cast<std::int64_t>(7 + set);
      std::vector<int> side_cells, numbers;
      for (const auto& [cell, side] : sides) side_cells.push_back(cell), numbers.push_back(side);
      ex_put_set_param(id, EX_SIDE_SET, id_of_set, static_cast<std::int64_t>(sides.size()), 0);
      ex_put_set(id, EX_SIDE_SET, id_of_set, side_cells.data(), numbers.data());
      if (!name.empty()) ex_put_name(id, EX_SIDE_SET, id_of_set, name.c_str());
    }
  }

  template <class Values>
  static void put_names(int id, ex_entity_type type, const Values& variables) {
    std::vector<std::string> names;
    std::vector<char*> pointers;
    for (const auto& [name, value] : variables) names.push_back(name);
    for (std::string& name : names) pointers.push_back(name.data());
    if (names.empty()) return;
    ex_put_variable_param(id, type, static_cast<int>(names.size()));
    ex_put_variable_names(id, type, static_cast<int>(names.size()), pointers.data());
  }

  void put_variables(int id) const {
    put_names(id, EX_NODAL, nodal);
    put_names(id, EX_ELEM_BLOCK, of_cells);
    for (std::size_t step = 0; step < steps; ++step) {
      const int number = static_cast<int>(step) + 1;
      ex_put_time(id, number, &times[step]);
      for (std::size_t v = 0; v < nodal.size(); ++v) {
        std::vector<double> values;
        for (const dvec3& p : points) values.push_back(nodal[v].second(p, times[step]));
        ex_put_var(id, number, EX_NODAL, static_cast<int>(v) + 1, 1, static_cast<std::int64_t>(values.size()),
                   values.data());
      }
      for (std::size_t v = 0; v < of_cells.size(); ++v) {
        std::vector<double> values(blocks.back().cells.size());
        for (std::size_t cell = 0; cell < values.size(); ++cell) values[cell] = of_cells[v].second(cell, times[step]);
        ex_put_var(id, number, EX_ELEM_BLOCK, static_cast<int>(v) + 1, static_cast<std::int64_t>(10 * blocks.size()),
                   static_cast<std::int64_t>(values.size()), values.data());
      }
    }
  }
};

}  // namespace splatvol::test
