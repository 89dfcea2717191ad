// Reads a step of a time series while another one is drawn.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "base/memory_budget.h"
#include "format/volume.h"
#include "streamer/store/parts.h"

namespace splatvol {

/// What was read of a step.
struct StepParts {
  std::shared_ptr<const format::Volume> volume = {};  // null if the step could not be opened
  std::vector<PartLoad> parts = {};                   // that were read, with their data
};

/// Largest load run of a step, packed. One is held at a time, in `working`.
inline constexpr std::uint64_t step_run_bytes = std::uint64_t{256} << 10;

/// Opens a step of the series of `from`, and reads parts of it, in order. Parts that cannot be read are left out:
/// whoever shows the step meets the error. Interrupted, it ends as soon as the load run in progress is read.
///
/// `pages` and `rows` (parts of rows) have the keys of `step`, and reservations for their data. Index pages have their
/// structure. The locations of chunks are not known yet; the directory pages must have them. `working` is for all else:
/// the step's preamble and a load run.
[[nodiscard]] StepParts read_step_parts(const format::Volume& from, std::size_t step,
                                        const format::SummaryAttributes& attributes, std::vector<PartLoad> pages,
                                        std::vector<PartLoad> rows, Reservation working);

}  // namespace splatvol
