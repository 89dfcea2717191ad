// Counts the memory of operator new, for tests of how much a reader may allocate.
#pragma once

#include <cstddef>

namespace splatvol::test {

/// Begins to count. Not nestable.
void start_counting_allocations();

/// Returns the most bytes that were held at once since then, less those that were held then.
[[nodiscard]] std::size_t most_bytes_allocated();

}  // namespace splatvol::test
