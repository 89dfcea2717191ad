// How much memory operator new has handed out: for tests of what a reader may allocate.
#pragma once

#include <cstddef>

namespace splatvol::test {

/// Counts from here on; not nestable.
void start_counting_allocations();

/// Most bytes that were held at once since, beyond what was held then.
[[nodiscard]] std::size_t most_bytes_allocated();

}  // namespace splatvol::test
