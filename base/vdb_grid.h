// Grids of OpenVDB.
#pragma once

#include <openvdb/openvdb.h>

namespace splatvol {

/// An empty grid with the background 0, made by the library: Grid::create() compiles all of a grid's code where it
/// stands. OpenVDB must be initialized.
template <class Grid>
typename Grid::Ptr make_vdb_grid() {
  return std::static_pointer_cast<Grid>(openvdb::GridBase::createGrid(Grid::gridType()));
}

}  // namespace splatvol
