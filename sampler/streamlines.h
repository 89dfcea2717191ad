// Streamlines of the vectors in the cells that a file keeps.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "format/volume.h"
#include "sampler/vector_field.h"
#include "splatvol/streamlines.h"

namespace splatvol {

/// Memory for chunks of cells that lets most streamlines read each chunk once.
inline constexpr std::uint64_t usual_streamline_bytes = std::uint64_t{64} << 20;

/// Most bytes that streamlines take while they are followed: for each seed, and for each row with one attribute.
inline constexpr std::uint64_t streamline_bytes_per_seed = 1000;
inline constexpr std::uint64_t streamline_bytes_per_row = 80;

/// How far streamlines are followed.
struct StreamlineLimits {
  StreamlineDirection direction = StreamlineDirection::both;
  double length = 0;  // from the seed, each way
  std::size_t steps = 0;
  std::uint64_t rows = std::numeric_limits<std::uint64_t>::max();  // of all lines together, as far as they are followed
};

/// Follows the streamlines of seeds, by steps of Dormand and Prince. No step is estimated to be off by more than 1e-5
/// of the tetrahedron that it begins in, and none is longer than that: in the tetrahedron's barycentric coordinates, so
/// in each direction by its own extent. A line ends where its next step would leave the mesh or the vector's values, or
/// exceed the length; there, by bisection, to about 1e-9 of the cell.
///
/// Lines wait for chunks of cells. The chunk for which most of them wait is read next, and a step that lacks one is
/// begun again. Calls take(line) for each line that is complete, in any order, from any thread, but one call at a time.
/// Lines have the same bits for any order of seeds, number of threads, and memory. Fails with out_of_budget beyond the
/// limit of rows. Heeds an Interruptible.
[[nodiscard]] Status follow_streamlines(const VectorField& field, std::span<const dvec3> seeds,
                                        const StreamlineLimits& limits, std::size_t threads,
                                        const std::function<void(Streamline)>& take);

/// Returns how many seeds these are to be.
[[nodiscard]] double count_of(const Seeds& seeds);

/// Returns the positions of seeds that need no file: all but those on patches.
[[nodiscard]] std::vector<dvec3> positions_on(const Seeds& seeds);

/// Returns the positions of seeds. Reads the boundary of the volume for patches. Fails without any, for positions that
/// are not finite, for a line, rectangle or patch without an extent, if the file lacks the patch, and if the patch
/// takes more than `memory` bytes.
[[nodiscard]] Result<std::vector<dvec3>> positions_of(const Seeds& seeds, const format::Volume& volume,
                                                      std::uint64_t memory);

/// Returns the limits of a request. Fails unless the length and the number of steps are above 0.
[[nodiscard]] Result<StreamlineLimits> limits_of(const StreamlineRequest& request, const format::Volume& volume);

/// The failure where no seed has a line: counts why `lines` without rows end.
[[nodiscard]] tl::unexpected<Error> fail_without_lines(const format::Volume& volume, std::span<const Streamline> lines);

/// Returns the streamlines of a request; holds at most `memory` bytes of parts of the file. Fails as the functions
/// above do, and if no seed has a line.
[[nodiscard]] Result<Streamlines> find_streamlines(const format::Volume& volume, const StreamlineRequest& request,
                                                   std::uint64_t memory, std::size_t threads);

}  // namespace splatvol
