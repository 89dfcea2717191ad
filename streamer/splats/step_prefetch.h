// Reads a step of a time series while another one is drawn.
#pragma once

#include <atomic>
#include <cstddef>
#include <memory>
#include <stop_token>
#include <thread>
#include <vector>

#include "base/error.h"
#include "base/memory_budget.h"
#include "format/volume.h"
#include "streamer/store/parts.h"

namespace splatvol {

/// Opens a step on a thread of its own, and reads parts of it, in order. Parts that cannot be read are left out:
/// whoever shows the step meets the error.
class StepPrefetch {
 public:
  /// Largest load run, packed. One is held at a time, in `working`.
  static constexpr std::uint64_t run_bytes = std::uint64_t{256} << 10;

  /// `pages` and `rows` (parts of rows) have the keys of `step`, and reservations for their data. Index pages have
  /// their structure. The locations of chunks are not known yet; the directory pages must have them. `working` is for
  /// all else: the step's preamble and a load run.
  StepPrefetch(std::shared_ptr<const format::Volume> from, std::size_t step,
               const format::SummaryAttributes& attributes, std::vector<PartLoad> pages, std::vector<PartLoad> rows,
               Reservation working);
  StepPrefetch(const StepPrefetch&) = delete;
  StepPrefetch& operator=(const StepPrefetch&) = delete;

  /// Stops as soon as the load run in progress is read, or interrupted (base/interruption.h).
  ~StepPrefetch();

  [[nodiscard]] std::size_t step() const { return step_; }

  struct Result {
    std::shared_ptr<const format::Volume> volume;  // null if the step could not be opened
    std::vector<PartLoad> parts;                   // that were read, with their data
  };

  /// Whether all is read, so that `extract` does not wait.
  [[nodiscard]] bool is_done() const { return done_; }

  /// Waits until all is read, and moves it out. Called once.
  [[nodiscard]] Result extract();

 private:
  void run();
  void read_step();
  void read_parts(std::vector<PartLoad> parts);
  [[nodiscard]] bool has_same_layout() const;
  [[nodiscard]] bool find_locations(PartLoad& row) const;
  [[nodiscard]] const format::DirectoryPage* find_page(std::uint64_t number) const;

  std::shared_ptr<const format::Volume> from_;
  const std::size_t step_;
  const format::SummaryAttributes attributes_;
  std::vector<PartLoad> pages_, rows_;
  Reservation working_;
  Result result_;
  std::stop_source stop_;
  std::atomic<bool> done_ = false;
  std::thread thread_;  // last: begins when all else is there
};

}  // namespace splatvol
