// Points that several parts of one mesh have, such as those on the borders between processors.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <unordered_map>
#include <vector>

class vtkDataSet;

namespace splatvol {

/// Means of cells at the points that several parts have, over the cells of all parts. Without it, each part would have
/// a value of its own there, and the points would not merge. Holds the points on the outer faces of all parts.
class SharedPoints {
 public:
  /// Adds a part whose arrays of cells have become arrays of points (cell_averages.h). `block`: the block of the mesh
  /// that this is a part of; points of different blocks are not the same. Call it for all parts, then finish().
  void add(vtkDataSet& part, const std::string& block);

  /// Forgets the points that only one part has. A point that a part has twice is one, too: there the field may jump.
  void finish();

  /// Sets the arrays at the shared points of a part that has been added, in the same state as then.
  void apply(vtkDataSet& part, const std::string& block) const;

 private:
  using Position = std::array<double, 3>;
  struct PositionHash {
    std::size_t operator()(const Position& position) const;
  };
  struct Shared {
    std::uint32_t last_part = 0;
    std::uint32_t parts = 0;
    bool jumps = false;
    std::map<std::uint32_t, std::vector<double>> sums;  // [array]: sum of weights, and weighted sum, for each component
  };
  using Block = std::unordered_map<Position, Shared, PositionHash>;

  std::uint32_t number_of(const std::string& array);

  std::map<std::string, Block> blocks_;
  std::map<std::string, std::uint32_t> numbers_;  // of the names of arrays
  std::uint32_t parts_ = 0;
};

}  // namespace splatvol
