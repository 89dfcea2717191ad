// Points that several parts of one mesh have, such as those on the borders between processors.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "builder/mesh/cell_averages.h"
#include "builder/sources/mesh_data.h"
#include "builder/sources/openfoam/foam_mesh.h"
#include "builder/sources/source.h"

namespace splatvol {

/// Returns the points of the faces that only one cell has, ascending. The points of a face, in any order, tell it from
/// others: a wall inside may have two faces at the same points.
[[nodiscard]] std::vector<std::uint32_t> outer_points(const FoamMesh& mesh);

/// Means of cells at the points that several parts have, over the cells of all parts. Without it, each part would have
/// a value of its own there, and the points would not merge. Holds the points on the outer faces of all parts.
class SharedPoints {
 public:
  /// Adds a part: the means of its arrays of cells. `outer`: its outer_points(). `block`: the
  /// block of the mesh that this is a part of; points of different blocks are not the same. Call it for all parts, then
  /// finish(). `missing`: values that do not count. Requires as many values as cells.
  void add(const MeshDataSet& part, std::span<const std::uint32_t> outer, const std::string& block,
           const CellAverages& averages, const MissingValues& missing);

  /// Forgets the points that only one part has. A point that a part has twice is one, too: there the field may jump.
  void finish();

  /// Sets the means of an array of cells at the shared points of a part that has been added. `means`: at all `points`
  /// of the part, a component.
  void apply(std::span<const dvec3> points, const std::string& block, const std::string& array, int component,
             std::span<double> means) const;

 private:
  struct PositionHash {
    std::size_t operator()(const dvec3& position) const;
  };
  struct Mean {
    double weight = 0;
    double value = 0;
  };
  struct Shared {
    std::uint32_t last_part = 0;
    std::uint32_t parts = 0;
    bool jumps = false;
    std::map<std::uint32_t, std::vector<Mean>> means;  // [array][component]
  };
  using Block = std::unordered_map<dvec3, Shared, PositionHash>;

  std::uint32_t number_of(const std::string& array);

  std::map<std::string, Block> blocks_;
  std::map<std::string, std::uint32_t> numbers_;  // of the names of arrays
  std::uint32_t parts_ = 0;
};

}  // namespace splatvol
