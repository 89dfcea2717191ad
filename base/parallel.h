// Loops on several threads. Layers that may run where there are none include this header, and not TBB's.
#pragma once

#include <cstddef>

#include "base/has_threads.h"

#if !SPLATVOL_ONE_THREAD
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>
#endif

namespace splatvol {

/// Calls body(i) for each i from `begin` up to `end`, in any order, on several threads.
template <class Index, class Body>
void parallel_for(Index begin, Index end, const Body& body) {
#if SPLATVOL_ONE_THREAD
  for (Index i = begin; i < end; ++i) body(i);
#else
  tbb::parallel_for(begin, end, body);
#endif
}

/// The same for ranges that together are those from `begin` up to `end`: body(first, last). A range has one to `most`
/// numbers.
template <class Body>
void parallel_for_ranges(std::size_t begin, std::size_t end, std::size_t most, const Body& body) {
#if SPLATVOL_ONE_THREAD
  for (std::size_t first = begin; first < end; first += most) body(first, first + most < end ? first + most : end);
#else
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(begin, end, most),
      [&](const tbb::blocked_range<std::size_t>& range) { body(range.begin(), range.end()); },
      tbb::simple_partitioner());
#endif
}

/// Returns the most threads on which a loop of this thread runs.
[[nodiscard]] inline std::size_t parallel_threads() {
#if SPLATVOL_ONE_THREAD
  return 1;
#else
  return static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());
#endif
}

/// A value for each thread of loops.
template <class Value>
class ThreadValues {
 public:
  /// Returns that of this thread.
  [[nodiscard]] Value& local() {
#if SPLATVOL_ONE_THREAD
    return value_;
#else
    return values_.local();
#endif
  }

 private:
#if SPLATVOL_ONE_THREAD
  Value value_{};
#else
  tbb::enumerable_thread_specific<Value> values_;
#endif
};

}  // namespace splatvol
