// A transfer function as the drawing of cells takes it: pieces in single precision. Internal to the drawing.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "scene/transfer_function.h"

namespace splatvol::tiles {

/// Pieces of a transfer function, by u = (value - lo) / (hi - lo) - origin. From its start on, a piece is linear in u;
/// the first and the last are constant, and have all that lies outside of the domain. Single precision is finest near
/// u = 0: there the narrowest piece is. What is narrower than single precision can tell stands at the start behind it,
/// as a peak.
struct FunctionPieces {
  static constexpr std::size_t in_registers = 16;
  static constexpr float outside = 1e30F;  // no value has such a u
  static constexpr int bins = 1024;

  double origin = 0;      // in the domain: 0 is lo, 1 is hi
  std::size_t count = 0;  // at least 2

  // [piece], with more behind: at least in_registers numbers, and a start of `outside` behind the last.
  std::vector<float> starts;
  std::array<std::vector<float>, 4> values, slopes;  // at the start: r, g, b and extinction for each world unit
  std::vector<float> peaks;                          // integral of the extinction over u
  std::array<std::vector<float>, 3> peak_colors;
  bool has_peaks = false;

  /// [bin]: the last piece that begins at or before the bin's begin. Bin 0 is below the domain, the last one above it.
  std::vector<std::int32_t> first_of_bin;
  float bin_of_origin = 1;  // a value is in the bin of bin_of_origin + u bins, but for rounding

  /// [bin]: how many bins before this one show something.
  std::vector<std::int32_t> visible_before;

  explicit FunctionPieces(const TransferFunction& function);

  [[nodiscard]] bool fit_registers() const { return count < in_registers; }

 private:
  void add_pieces(const TransferFunction& function);
  void add_bins();
};

}  // namespace splatvol::tiles
