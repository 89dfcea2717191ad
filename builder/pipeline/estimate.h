// An estimate of a build, before it runs.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>

#include "base/error.h"
#include "builder/pipeline/build.h"
#include "builder/sources/source.h"

namespace splatvol {

/// The facts about an input that the cost of a build depends on.
struct InputSize {
  std::uint64_t points = 0;       // copies of a vertex in several pieces count each
  std::uint64_t tetrahedra = 0;   // of all cells, after splitting
  std::uint64_t piece_bytes = 0;  // of the largest piece, with what finds its material
  std::size_t pieces = 1;
  std::size_t attributes = 0;
  bool has_material = false;      // by cells, or from the source; else the points are scattered
  bool has_planes = false;        // PointRecords
  bool has_bounds = false;        // before the points are read
  bool single_precision = false;  // Source::single_precision()
  bool was_read = false;          // all pieces: the input does not tell otherwise
};

/// Finds the size of an input: from what it declares if that tells, else by reading its pieces, one at a time.
/// `use_cells`: as PointStream. `progress` gets the share that is read. Fails as Source::next().
[[nodiscard]] Result<InputSize> measure_input(Source& source, bool use_cells,
                                              const std::function<void(double)>& progress = {});

/// A number that is not known exactly.
struct Range {
  double low = 0, high = 0;
};

/// The needs of a build, in bytes and seconds.
struct BuildEstimate {
  Connectivity connectivity = Connectivity::mesh;  // that the build will use
  bool keeps_cells = false;                        // in the file
  Range file = {};                                 // bytes of the output
  Range disk = {};                                 // most bytes at a time: temporary files, and the output so far
  Range memory = {};                               // most bytes held, without the process that reads foreign formats
  Range seconds = {};
  std::uint64_t least_memory = 0;  // held even if BuildOptions::memory grants less
};

/// Estimates a build from the size of its input, by the formula of docs/scale.md. `steps`: of a time series, which
/// `size` describes one of; else 1. `threads`: at least 1. The constants were measured (docs/scale.md): the seconds
/// hold for a machine like the one there.
[[nodiscard]] BuildEstimate estimate_build(const InputSize& size, const BuildOptions& options, std::size_t steps,
                                           unsigned threads);

}  // namespace splatvol
