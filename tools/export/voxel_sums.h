// Sums over splats, in a sparse grid of voxels, within a budget of memory.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <unordered_map>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "tools/export/voxel_kernel.h"

namespace splatvol {

/// A splat on its way into voxels; lengths in voxels.
struct VoxelSplat {
  VoxelKernel kernel;
  double mass;
  struct Value {
    double mass;  // of the material that has a value
    LinearField field;
  };
  std::vector<Value> values;  // [attribute]
};

/// The sums of each voxel: the mass; then, for each attribute, the mass of the material that has a value, and the
/// integral of the value over this mass.
class VoxelSums {
 public:
  static constexpr std::int32_t brick_edge = 8;
  static constexpr std::size_t brick_voxels = 512;
  using BrickIndex = std::array<std::int32_t, 3>;  // along each axis: its first voxel / brick_edge

  /// Leaves out voxels whose centres are outside of `box`. `memory`: the most bytes to hold.
  VoxelSums(std::size_t attributes, const Box& box, std::uint64_t memory)
      : sums_(1 + 2 * attributes), box_(box), memory_(memory) {}

  /// Adds the whole mass of each splat. The result does not depend on how splats are divided into calls. Fails if it
  /// would hold more than `memory`.
  [[nodiscard]] Status add(std::span<const VoxelSplat> splats);

  /// Returns the number of sums of a voxel.
  [[nodiscard]] std::size_t sums() const { return sums_; }

  /// Calls visit(index, sums) for each brick, in the order of the indices, and drops the brick afterwards. The sums are
  /// [voxel][sum], with z running fastest, then y, then x.
  void drain(const std::function<void(const BrickIndex&, std::span<const double>)>& visit);

 private:
  struct Hash {
    std::size_t operator()(const BrickIndex& index) const;
  };
  struct Spread {
    std::vector<VoxelKernel::Run> runs;
    std::vector<double> shares;
    bool fits = true;
  };

  [[nodiscard]] Status add(const VoxelSplat& splat, const Spread& spread);
  [[nodiscard]] Result<double*> voxels_of_brick(const BrickIndex& index);
  [[nodiscard]] std::uint64_t brick_bytes() const;
  [[nodiscard]] tl::unexpected<Error> over_budget() const;

  std::size_t sums_;
  Box box_;
  std::uint64_t memory_;
  std::unordered_map<BrickIndex, std::vector<double>, Hash> bricks_;
  BrickIndex last_index_{};
  double* last_brick_ = nullptr;
};

}  // namespace splatvol
