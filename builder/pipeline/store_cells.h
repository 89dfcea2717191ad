// The cells on their way into a file.
#pragma once

#include <memory>
#include <string>

#include "base/error.h"
#include "builder/cells/mesh_cells.h"
#include "builder/pipeline/build.h"
#include "builder/points/point_records.h"
#include "builder/sources/source.h"

namespace splatvol {

/// Makes an empty store of cells, with a part of the memory; null if the options ask for none, or if it is sure that
/// there are none to keep.
[[nodiscard]] Result<std::unique_ptr<MeshCells>> start_cells(const Source& source, const BuildOptions& options,
                                                             const std::string& folder);

/// Whether the cells to keep are those of pieces, so that records need tags.
[[nodiscard]] bool keeps_cells_of_pieces(const Source& source, const BuildOptions& options);

/// Returns the watcher that gives `faces` and `cells` the pieces and points that they need. Either may be null.
[[nodiscard]] WatchPoints watch_points(const Source& source, const BuildOptions& options, BoundaryFaces* faces,
                                       MeshCells* cells);

}  // namespace splatvol
