// Turns a data set into a Piece.
#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>

#include "base/error.h"
#include "builder/mesh/cell_averages.h"
#include "builder/sources/array_attributes.h"
#include "builder/sources/data_set.h"
#include "builder/sources/source.h"

namespace splatvol {

/// Changes the means of a component of an array of cells, at all points of a data set.
using ChangeMeans = std::function<void(const std::string& array, int component, std::span<double> means)>;

/// Returns the points, the values of `attributes`, and the cells as tetrahedra, as open_source promises. With cells of
/// their own the points are these cells, without those of no volume. Calls `change_means` on the means of cells at the
/// points, if it is not empty. With `lend`, the piece lends its values (LentValues); with `whole_cells`, it tells
/// them. Fails if cells are damaged or not
/// supported, or if an attribute is not there; `name` begins the message. Safe on untrusted data sets.
[[nodiscard]] Result<std::unique_ptr<Piece>> make_piece(const std::string& name, const DataSet& data,
                                                        std::span<const ArrayAttribute> attributes, CellValues cells,
                                                        const MissingValues& missing,
                                                        const ChangeMeans& change_means = {}, bool lend = false,
                                                        bool whole_cells = false);

/// Returns the averages that make_piece() uses. Fails if cells are damaged or not supported.
[[nodiscard]] Result<CellAverages> make_averages(const std::string& name, const DataSet& data);

}  // namespace splatvol
