// Ranges of the values in cells, for a step of a time series (spec/svol-1.md, section 14).
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>

#include "base/error.h"
#include "format/cell_reader.h"
#include "format/chunk_source.h"

namespace splatvol {

/// Writes the summaries of all chunks of `cells` for one step through `append`. `values`: the rows of the step, whose
/// attributes these are. `memory`: bytes to hold. Works on all of TBB's threads.
[[nodiscard]] Status write_step_summaries(const format::CellReader& cells,
                                          const std::shared_ptr<const format::ChunkSource>& values,
                                          std::span<const format::Attribute> attributes, std::uint64_t memory,
                                          const std::function<Status(std::span<const std::byte>)>& append);

}  // namespace splatvol
