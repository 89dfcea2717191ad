#include "builder/sources/openvdb/vdb_fields.h"

#include <utility>

#include "builder/sources/source.h"

namespace splatvol {
namespace {

template <class Grid>
class GridField final : public VdbField {
 public:
  explicit GridField(typename Grid::ConstPtr grid) : grid_(std::move(grid)) {}

  void add_topology(openvdb::MaskTree& topology) const override { topology.topologyUnion(grid_->tree()); }

  void sample(std::span<const openvdb::Coord> voxels, int component, std::span<double> values) const override {
    const auto accessor = grid_->getConstUnsafeAccessor();
    for (std::size_t i = 0; i < voxels.size(); ++i) {
      typename Grid::ValueType stored;
      values[i] = accessor.probeValue(voxels[i], stored) ? number(stored, component) : missing_value;
    }
  }

 private:
  template <class T>
  static double number(const T& stored, int component) {
    if constexpr (openvdb::VecTraits<T>::IsVec) {
      return static_cast<double>(stored[component]);
    } else {
      return static_cast<double>(stored);
    }
  }

  typename Grid::ConstPtr grid_;
};

/// Calls visit.operator()<Grid>() with the type of a grid of numbers; does nothing for other grids.
template <class Visit>
void visit_type(const openvdb::GridBase& grid, const Visit& visit) {
  const auto try_type = [&]<class Grid>() {
    if (!grid.isType<Grid>()) return false;
    visit.template operator()<Grid>();
    return true;
  };
  static_cast<void>(
      try_type.template operator()<openvdb::FloatGrid>() || try_type.template operator()<openvdb::DoubleGrid>() ||
      try_type.template operator()<openvdb::Int32Grid>() || try_type.template operator()<openvdb::Int64Grid>() ||
      try_type.template operator()<openvdb::Vec3SGrid>() || try_type.template operator()<openvdb::Vec3DGrid>() ||
      try_type.template operator()<openvdb::Vec3IGrid>());
}

}  // namespace

int vdb_components(const openvdb::GridBase& grid) {
  int components = 0;
  visit_type(grid, [&]<class Grid>() { components = openvdb::VecTraits<typename Grid::ValueType>::IsVec ? 3 : 1; });
  return components;
}

std::unique_ptr<VdbField> make_vdb_field(const openvdb::GridBase::Ptr& grid) {
  std::unique_ptr<VdbField> field;
  visit_type(*grid,
             [&]<class Grid>() { field = std::make_unique<GridField<Grid>>(openvdb::gridConstPtrCast<Grid>(grid)); });
  return field;
}

}  // namespace splatvol
