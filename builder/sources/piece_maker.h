// Turns a data set into a Piece.
#pragma once

#include <memory>
#include <span>
#include <string>

#include "base/error.h"
#include "builder/mesh/cell_averages.h"
#include "builder/sources/array_attributes.h"
#include "builder/sources/data_set.h"
#include "builder/sources/source.h"

namespace splatvol {

/// Returns the points, the values of `attributes`, and the cells as tetrahedra, as open_source promises. With cells of
/// their own the points are these cells, without those of no volume. With `lend`, the piece lends its values
/// (LentValues); with `whole_cells`, it tells them. Where the data set lacks an attribute, its values are missing.
/// Fails if cells are damaged or not supported, or if an array is too short; `name` begins the message. Safe on
/// untrusted data sets.
[[nodiscard]] Result<std::unique_ptr<Piece>> make_piece(const std::string& name, const DataSet& data,
                                                        std::span<const ArrayAttribute> attributes, CellValues cells,
                                                        const MissingValues& missing, bool lend = false,
                                                        bool whole_cells = false);

/// Returns the averages that make_piece() uses. Fails if cells are damaged or not supported.
[[nodiscard]] Result<CellAverages> make_averages(const std::string& name, const DataSet& data);

}  // namespace splatvol
