// Reads parts of a file beside frames.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <stop_token>
#include <thread>
#include <vector>

#include "base/fetched_source.h"
#include "streamer/store/parts.h"

namespace splatvol {

/// Threads of low priority that read and decode load runs, in the order of `submit`. All calls must come from one
/// thread. Where reads do not wait (format::Volume::waits), and where none starts, there are none: `submit` asks for
/// the bytes of a run, and `extract_done` reads and decodes what has come, for a few milliseconds.
class Loader {
 public:
  /// Keeps a reference to the volume. Calls `on_data`, if there is one, on its threads after each load run.
  Loader(const format::Volume& volume, const format::SummaryAttributes& attributes, unsigned threads,
         std::function<void()> on_data);
  Loader(const Loader&) = delete;
  Loader& operator=(const Loader&) = delete;

  /// Interrupts reads from servers (base/interruption.h). Waits for the other load runs that were begun; begins no
  /// others.
  ~Loader();

  void submit(LoadRun run);

  /// Removes and returns the load runs that were not begun. Their bytes may come all the same.
  [[nodiscard]] std::vector<LoadRun> withdraw();

  /// Moves out the load runs that were read, or failed, since the last call.
  [[nodiscard]] std::vector<LoadRun> extract_done();

  /// Waits until `extract_done` has a result, nothing is left to read, or `deadline`; less if the caller is
  /// interrupted.
  void wait_until(std::chrono::steady_clock::time_point deadline);

 private:
  struct Run {
    LoadRun run;
    std::unique_ptr<FetchedBytes> bytes = {};  // without threads
  };
  [[nodiscard]] static std::vector<LoadRun> take_all(std::list<Run>& runs);
  void work();
  void decode_what_has_come();

  const format::Volume& volume_;
  const format::SummaryAttributes attributes_;
  const std::function<void()> on_data_;
  std::mutex mutex_;
  std::condition_variable submitted_;
  std::condition_variable finished_;
  std::list<Run> queue_;  // lists, so that a thread moves a run without memory
  std::list<Run> done_;
  std::size_t begun_ = 0;  // begun and not done
  std::stop_source stop_;
  std::vector<std::thread> threads_;
};

}  // namespace splatvol
