// A cube of tetrahedra as arrays of a caller.
#pragma once

#include <cstdint>
#include <vector>

#include "splatvol/build.h"

namespace splatvol::test {

/// A cube of edge 1 of n^3 cubes, each cut into six tetrahedra. The value `x` is the position's linear function
/// 1 + 2 x + 3 y - z.
struct Lattice {
  explicit Lattice(int n) {
    const auto at = [n](int x, int y, int z) { return std::int64_t{x} + (n + 1) * (y + std::int64_t{n + 1} * z); };
    for (int z = 0; z <= n; ++z)
      for (int y = 0; y <= n; ++y)
        for (int x = 0; x <= n; ++x) {
          for (const int i : {x, y, z}) points.push_back(static_cast<double>(i) / n);
          values.push_back(field(points[points.size() - 3], points[points.size() - 2], points.back()));
        }
    constexpr int axes[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
    offsets.push_back(0);
    for (int z = 0; z < n; ++z)
      for (int y = 0; y < n; ++y)
        for (int x = 0; x < n; ++x)
          for (const auto& order : axes) {
            int corner[3] = {x, y, z};
            connectivity.push_back(at(x, y, z));
            for (const int axis : order) {
              ++corner[axis];
              connectivity.push_back(at(corner[0], corner[1], corner[2]));
            }
            offsets.push_back(static_cast<std::int64_t>(connectivity.size()));
            types.push_back(10);
          }
  }

  static double field(double x, double y, double z) { return 1 + 2 * x + 3 * y - z; }

  [[nodiscard]] MeshArrays mesh() const {
    MeshArrays arrays{.points = std::span<const double>(points),
                      .connectivity = connectivity,
                      .offsets = offsets,
                      .types = types,
                      .point_values = {{.name = "v", .values = std::span<const double>(values), .unit = "m/s"}}};
    return arrays;
  }

  std::vector<double> points, values;
  std::vector<std::int64_t> connectivity, offsets;
  std::vector<std::uint8_t> types;
};

}  // namespace splatvol::test
