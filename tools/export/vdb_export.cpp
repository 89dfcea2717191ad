#include "tools/export/vdb_export.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/names.h"
#include "tools/export/vdb_grids.h"
#include "tools/export/voxel_sums.h"

namespace splatvol {
namespace {

constexpr const char* usual_fraction_name = "volume_fraction";

// Share of a voxel's volume. A value is written if more material than this has one.
constexpr double least_fraction = 1e-3;

// Far below the largest 32-bit index.
constexpr double most_voxels = 1 << 30;

// Converts from the file's units to voxels.
struct VoxelFrame {
  dvec3 origin;
  double voxel;

  [[nodiscard]] dvec3 position(const dvec3& world) const { return (world - origin) / voxel; }
};

// Whether the centre of a voxel is in a box, in voxels. It has integers as coordinates.
bool has_voxel(const Box& box) {
  for (int k = 0; k < 3; ++k)
    if (!(std::ceil(box.low[k]) <= std::floor(box.high[k]))) return false;
  return true;
}

VoxelSplat make_splat(const format::SplatGroup& group, std::size_t i, const VoxelFrame& frame) {
  SplatShape shape = group.shapes[i];
  shape.deviations /= frame.voxel;
  VoxelSplat splat{VoxelKernel(frame.position(group.centroids[i]), shape), shape.mass, {}};
  for (const auto& of_attribute : group.materials) {
    const SplatValue& value = of_attribute[i];
    splat.values.push_back({shape.mass * value.coverage, splat.kernel.field(shape, value)});
  }
  return splat;
}

// An attribute may be called as the grid of the fraction is, and keeps its name.
std::string fraction_name(const format::SplatSelection& selection) {
  return free_name(usual_fraction_name, [&](const std::string& name) {
    return std::ranges::find(selection.names, name) != selection.names.end();
  });
}

// Makes one grid for the fraction and one for each attribute.
class GridBuilder {
 public:
  GridBuilder(const format::Volume& volume, const format::SplatSelection& selection, const VoxelFrame& frame)
      : voxel_volume_(frame.voxel * frame.voxel * frame.voxel), grids_(names_of(selection), frame.origin, frame.voxel) {
    grids_.mark_share(0);
    for (const std::size_t a : selection.attributes) {
      attributes_.push_back(volume.info().attributes[a]);
      if (!attributes_.back().unit.empty()) grids_.set_unit(attributes_.size(), attributes_.back().unit);
    }
  }

  void add_brick(const VoxelSums::BrickIndex& index, std::span<const double> sums, VdbReport& report) {
    const std::size_t count = 1 + 2 * attributes_.size();
    std::array<std::int32_t, 3> first = index;
    for (std::int32_t& coordinate : first) coordinate *= VoxelSums::brick_edge;
    std::array<float, VoxelSums::brick_voxels> values;
    for (std::size_t v = 0; v < values.size(); ++v) {
      const double mass = sums[v * count];
      values[v] = mass > 0 ? static_cast<float>(mass / voxel_volume_) : missing;
      report.voxels += mass > 0 ? 1 : 0;
      report.voxel_mass += mass;
    }
    grids_.add_brick(0, first, values);
    for (std::size_t a = 0; a < attributes_.size(); ++a) {
      for (std::size_t v = 0; v < values.size(); ++v)
        values[v] = value(sums[v * count + 1 + 2 * a], sums[v * count + 2 + 2 * a], attributes_[a]);
      grids_.add_brick(1 + a, first, values);
    }
  }

  [[nodiscard]] const VdbGrids& grids() const { return grids_; }

 private:
  static constexpr float missing = std::numeric_limits<float>::quiet_NaN();

  static std::vector<std::string> names_of(const format::SplatSelection& selection) {
    std::vector<std::string> names = {fraction_name(selection)};
    names.insert(names.end(), selection.names.begin(), selection.names.end());
    return names;
  }

  // The linear field in a splat may leave the range of the attribute: clamps it.
  [[nodiscard]] float value(double mass, double integral, const format::Attribute& attribute) const {
    if (!(mass > least_fraction * voxel_volume_)) return missing;
    return static_cast<float>(std::clamp(attribute.value(integral / mass), attribute.min, attribute.max));
  }

  double voxel_volume_;
  VdbGrids grids_;
  std::vector<format::Attribute> attributes_;
};

// The grids hold single precision.
Status check_range(const format::Volume& volume, const format::Attribute& attribute) {
  const double largest = std::max(std::abs(attribute.min), std::abs(attribute.max));
  constexpr double least = std::numeric_limits<float>::min(), most = std::numeric_limits<float>::max();
  if (std::isnan(largest) || largest == 0 || (largest >= least && largest <= most)) return {};
  return fail(ErrorCode::unsupported,
              "{}: values of \"{}\" reach {:g}, and OpenVDB's grids hold {:.0e} to {:.0e}: leave it out (--attribute), "
              "or export points (.vtu)",
              volume.name(), attribute.name, largest, least, most);
}

}  // namespace

Result<VdbReport> export_vdb(const format::Volume& volume, const std::string& path,
                             const format::SplatSelection& selection, double voxel, std::uint64_t memory,
                             const std::function<void(double)>& progress, Replace replace) {
  const format::VolumeInfo& info = volume.info();
  if (const auto duplicate = find_duplicate(selection.names))
    return fail(ErrorCode::invalid_argument,
                "{}: two attributes are called \"{}\" in the output: take one (--attribute)", volume.name(),
                *duplicate);
  for (const std::size_t a : selection.attributes) SPLATVOL_TRY(check_range(volume, info.attributes[a]));
  const VoxelFrame frame{info.cube.origin, voxel};
  if (!(info.cube.edge / voxel < most_voxels) || !(voxel * voxel * voxel > 0) || !std::isfinite(voxel * voxel * voxel))
    return fail(ErrorCode::invalid_argument, "{}: voxels of {} cannot be numbered: the volume is {} wide",
                volume.name(), voxel, info.cube.edge);

  VdbReport report;
  const Box box{frame.position(selection.box.low), frame.position(selection.box.high)};
  if (!has_voxel(box))
    return fail(ErrorCode::invalid_argument, "{}: no voxel has its centre in the box (--box)", volume.name());
  VoxelSums sums(selection.attributes.size(), box, memory);
  std::vector<VoxelSplat> splats;
  const auto add_group = [&](const format::SplatGroup& group) {
    splats.clear();
    for (std::size_t i = 0; i < group.size(); ++i) {
      if (!(group.shapes[i].mass > 0)) continue;
      VoxelSplat splat = make_splat(group, i, frame);
      if (!splat.kernel.reaches(box)) continue;
      ++report.splats;
      report.splat_mass += splat.mass;
      splats.push_back(std::move(splat));
    }
    const Status added = sums.add(splats);
    return added ? added : Status(fail_in(volume.name(), added.error()));
  };
  SPLATVOL_TRY(for_each_group(format::SplatReader(volume, selection, own_room(format::splat_reader_bytes)),
                              {.material = true}, add_group, progress));

  GridBuilder grids(volume, selection, frame);
  sums.drain([&](const VoxelSums::BrickIndex& index, std::span<const double> brick) {
    grids.add_brick(index, brick, report);
  });
  if (report.voxels == 0) return fail(ErrorCode::invalid_data, "{}: no material to export", volume.name());
  SPLATVOL_TRY_ASSIGN(bytes, grids.grids().write(path, replace));
  report.file_bytes = bytes;
  if (const std::string name = fraction_name(selection); name != usual_fraction_name)
    report.renamed.emplace(usual_fraction_name, name);
  return report;
}

}  // namespace splatvol
