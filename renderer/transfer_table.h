// The tables in which the kernels look up the transfer function. Internal to the renderer.
#pragma once

#include <cstddef>
#include <vector>

#include "scene/scene.h"

namespace splatvol {

/// A transfer function averaged over normally distributed values. d is the domain's width. Row j is for the spread
/// (standard deviation) d (513^(j / (rows - 1)) - 1) / 64: from 0 to 8 d, finely near 0. Column i is for the mean
/// lo + d/2 + (d + 8 spread) ((i - margin) / (columns - 1 - 2 margin) - 1/2). A single row is the function itself. The
/// margins tell values at an end of the domain, where the function may jump, from those beyond it.
struct TransferTable {
  static constexpr std::size_t margin = 16;  // columns on each side

  std::size_t columns;
  std::size_t rows;
  std::vector<vec4> entries;  // row by row: colour (averaged with extinction as the weight), extinction

  /// Return the spread and the mean of an entry, in units of the domain.
  [[nodiscard]] double spread(std::size_t row) const;
  [[nodiscard]] double mean(std::size_t row, std::size_t column) const;
};

/// Averages the function. Requires columns >= 2 + 2 margin, rows >= 1, control points and lo < hi. Exact to 1e-14 of
/// the largest extinction. The last few tables are remembered: another of them costs a copy. Thread-safe.
[[nodiscard]] TransferTable make_transfer_table(const TransferFunction& function, std::size_t columns,
                                                std::size_t rows);

/// Level 0: the largest extinction in each of `entries` equal parts of the domain, `entries` a power of two. The first
/// and the last part hold what lies outside, too. Each further level merges pairs of the one before; the last has one
/// entry.
[[nodiscard]] std::vector<std::vector<float>> make_peak_levels(const TransferFunction& function, std::size_t entries);

}  // namespace splatvol
