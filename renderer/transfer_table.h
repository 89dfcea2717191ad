// The transfer function as the kernels look it up. Internal to the renderer.
#pragma once

#include <cstddef>
#include <vector>

#include "scene/scene.h"

namespace splatvol {

/// A transfer function averaged over normally distributed values. Row j is for the spread (standard deviation)
/// d (513^(j / (rows - 1)) - 1) / 64, d the domain's width: from 0 to 8 d, finely near 0. Column i is for the mean
/// lo + d/2 + (d + 8 spread) (i / (columns - 1) - 1/2). A single row is the function itself.
struct TransferTable {
  std::size_t columns;
  std::size_t rows;
  std::vector<vec4> entries;  // row by row: colour, weighted with extinction, and extinction

  /// In units of the domain.
  [[nodiscard]] double spread(std::size_t row) const;
  [[nodiscard]] double mean(std::size_t row, std::size_t column) const;
};

/// Requires columns >= 2, rows >= 1, a function with control points and lo < hi. Exact to double precision.
[[nodiscard]] TransferTable make_transfer_table(const TransferFunction& function, std::size_t columns,
                                                std::size_t rows);

/// The largest extinction in each of `steps` equal parts of the domain, `steps` a power of two; then in each pair of
/// these, and so on, to one for all of it.
[[nodiscard]] std::vector<std::vector<float>> make_peak_levels(const TransferFunction& function, std::size_t steps);

}  // namespace splatvol
