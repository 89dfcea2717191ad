// Turns one of VTK's data sets into a Piece.
#pragma once

#include <memory>
#include <span>
#include <string>

#include "base/error.h"
#include "builder/sources/piece_maker.h"

class vtkDataSet;

namespace splatvol {

/// As for a DataSet (builder/sources/piece_maker.h). Errors of VTK become errors.
[[nodiscard]] Result<std::unique_ptr<Piece>> make_piece(const std::string& path, vtkDataSet& data,
                                                        std::span<const ArrayAttribute> attributes, CellValues cells,
                                                        const MissingValues& missing,
                                                        const ChangeMeans& change_means = {}, bool lend = false,
                                                        bool whole_cells = false);
[[nodiscard]] Result<CellAverages> make_averages(const std::string& path, vtkDataSet& data);

}  // namespace splatvol
