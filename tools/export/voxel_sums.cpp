#include "tools/export/voxel_sums.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace splatvol {
namespace {

// Voxels of the splats that are spread at a time.
constexpr double voxels_at_once = 1 << 20;

// Bytes of a brick in the table and in the finished grids, besides its sums.
constexpr std::uint64_t overhead_bytes = 256;

}  // namespace

std::size_t VoxelSums::Hash::operator()(const BrickIndex& index) const {
  std::uint64_t hash = 0;
  for (const std::int32_t coordinate : index) {
    hash = (hash ^ static_cast<std::uint32_t>(coordinate)) * 0x9E3779B97F4A7C15U;
    hash ^= hash >> 29;
  }
  return hash;
}

std::uint64_t VoxelSums::brick_bytes() const { return brick_voxels * sums_ * sizeof(double) + overhead_bytes; }

tl::unexpected<Error> VoxelSums::over_budget() const {
  return fail(ErrorCode::out_of_budget,
              "voxels of this size take more than the {} bytes of memory that may be held: larger ones (--voxel), a "
              "smaller --box, or grant more (--memory)",
              memory_);
}

Status VoxelSums::add(std::span<const VoxelSplat> splats) {
  for (std::size_t begin = 0, end = 0; begin < splats.size(); begin = end) {
    double voxels = 0;
    while (end < splats.size() && (end == begin || voxels < voxels_at_once)) voxels += splats[end++].kernel.volume();
    std::vector<Spread> spreads(end - begin);
    // A growing array of shares is there twice for a moment.
    constexpr std::uint64_t share_bytes = 4 * sizeof(double);
    const std::uint64_t held = bricks_.size() * brick_bytes();
    const std::size_t most = (memory_ - std::min(memory_, held)) / share_bytes + (std::size_t{1} << 17);
    tbb::parallel_for(begin, end, [&](std::size_t i) {
      Spread& spread = spreads[i - begin];
      spread.fits = splats[i].kernel.append(box_, most, spread.runs, spread.shares);
    });
    for (std::size_t i = begin; i < end; ++i) {
      if (!spreads[i - begin].fits) return over_budget();
      SPLATVOL_TRY(add(splats[i], spreads[i - begin]));
    }
  }
  return {};
}

Result<double*> VoxelSums::voxels_of_brick(const BrickIndex& index) {
  if (last_brick_ != nullptr && index == last_index_) return last_brick_;
  std::vector<double>& brick = bricks_[index];
  if (brick.empty()) {
    if (bricks_.size() * brick_bytes() > memory_) return over_budget();
    brick.resize(brick_voxels * sums_);
  }
  last_index_ = index;
  last_brick_ = brick.data();
  return last_brick_;
}

Status VoxelSums::add(const VoxelSplat& splat, const Spread& spread) {
  auto share = spread.shares.begin();
  for (const VoxelKernel::Run& run : spread.runs) {
    const bool inside = run.y >= box_.low.y && run.y <= box_.high.y && run.z >= box_.low.z && run.z <= box_.high.z;
    for (std::int32_t x = run.x; x < run.x + static_cast<std::int32_t>(run.count); ++x, ++share) {
      if (*share == 0 || !inside || x < box_.low.x || x > box_.high.x) continue;
      SPLATVOL_TRY_ASSIGN(brick, voxels_of_brick({x >> 3, run.y >> 3, run.z >> 3}));
      double* sum = brick + static_cast<std::size_t>((x & 7) << 6 | (run.y & 7) << 3 | (run.z & 7)) * sums_;
      *sum++ += splat.mass * *share;
      for (const VoxelSplat::Value& value : splat.values) {
        *sum++ += value.mass * *share;
        *sum++ += value.mass * *share * value.field.at(dvec3(x, run.y, run.z));
      }
    }
  }
  return {};
}

void VoxelSums::drain(const std::function<void(const BrickIndex&, std::span<const double>)>& visit) {
  std::vector<BrickIndex> indices;
  for (const auto& [index, brick] : bricks_) indices.push_back(index);
  std::ranges::sort(indices);
  for (const BrickIndex& index : indices) {
    const auto brick = bricks_.find(index);
    visit(index, brick->second);
    bricks_.erase(brick);
  }
  last_brick_ = nullptr;
}

}  // namespace splatvol
