// Tasks on several threads.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <future>
#include <vector>

#include "base/error.h"
#include "base/fetched_source.h"
#include "base/has_threads.h"
#include "base/interruption.h"

namespace splatvol {

/// Calls task(number, thread) for the numbers under `tasks`, in order, on this thread, whose number is 0, and others.
/// Returns the failure of the first task that failed. Later ones may not have been called.
template <class Task>
[[nodiscard]] Status run_tasks(std::size_t tasks, std::size_t threads, const Task& task) {
  std::vector<Status> results(tasks);
  std::atomic<std::size_t> next = 0;
  std::atomic<bool> has_failed = false;
  const auto run = [&](std::size_t thread) {
    for (std::size_t number = 0; !has_failed && (number = next++) < tasks;) {
      results[number] = task(number, thread);
      if (!results[number]) has_failed = true;
    }
  };
  std::vector<std::future<void>> others;
  const auto begin = [&](std::size_t thread) {
    return std::async(std::launch::async | std::launch::deferred,
                      [&, thread, stop = stop_of_thread(), bytes = FetchedBytes::of_thread()] {
                        const Interruptible interruptible(stop);
                        const FetchedBytes::Scope scope(bytes);
                        run(thread);
                      });
  };
  if constexpr (has_threads)
    for (std::size_t thread = 1; thread < std::min(threads, tasks); ++thread) others.push_back(begin(thread));
  run(0);
  for (std::future<void>& other : others) other.get();
  for (const Status& result : results) SPLATVOL_TRY(result);
  return {};
}

}  // namespace splatvol
