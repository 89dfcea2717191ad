// The values of OpenVDB grids, whatever type of number they hold.
#pragma once

#include <openvdb/openvdb.h>

#include <memory>
#include <span>

namespace splatvol {

/// The values of a grid. Thread-safe.
class VdbField {
 public:
  /// Stands for the magnitude of a vector, in place of a component's number.
  static constexpr int magnitude = -1;

  virtual ~VdbField() = default;

  /// Adds the grid's active voxels and tiles to `topology`.
  virtual void add_topology(openvdb::MaskTree& topology) const = 0;

  /// Sets values[i] to the grid's value at `voxels[i]`: a component. NaN if the grid is not active
  /// there.
  virtual void sample(std::span<const openvdb::Coord> voxels, int component, std::span<double> values) const = 0;
};

/// Components of a grid's values: 1 or 3, and 0 if they are no numbers.
[[nodiscard]] int vdb_components(const openvdb::GridBase& grid);

/// Requires a grid of numbers.
[[nodiscard]] std::unique_ptr<VdbField> make_vdb_field(const openvdb::GridBase::Ptr& grid);

}  // namespace splatvol
