// Reads and decodes parts of a file, in the caller or on threads.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <span>
#include <stop_token>
#include <thread>
#include <variant>
#include <vector>

#include "base/error.h"
#include "base/memory_budget.h"
#include "format/volume.h"
#include "streamer/cache.h"

namespace splatvol {

/// Reads at a time. A disk or a server answers several reads faster together than one by one, whatever the number of
/// processors (docs/decisions/2026-11-21-threads-not-io-uring.md).
inline constexpr unsigned read_threads = 8;

/// The data, besides the key, that tells how to read a part. A directory page needs nothing more.
struct IndexPageLoad {
  format::IndexPageRef ref;
  std::uint8_t child_mask;
  std::vector<std::uint64_t> parent_counts;
  std::shared_ptr<const format::IndexPage> structure = nullptr;  // the page at another step, if it is there
};
struct DirectoryPageLoad {};
struct ChunkLoad {
  std::uint64_t row;
  int column;
  format::ChunkLocation location;
};
struct RowLoad {
  KernelKind kernel;
  std::uint32_t points;
  bool opacity;                   // of values: with those of the opacity attribute
  std::vector<ChunkLoad> chunks;  // of shapes: positions first; of values: then perhaps gradients, last the opacity
};

/// A part of the file on its way into the cache.
struct PartLoad {
  CacheKey key;
  std::variant<IndexPageLoad, DirectoryPageLoad, RowLoad> what;
  Reservation decoded;     // for the data; goes into the cache with it
  Reservation working;     // for the packed bytes and for decoding
  Result<CacheData> data;  // CacheData() until it is read
  float error = 0;         // as CutItem::error

  [[nodiscard]] const RowLoad& row() const { return std::get<RowLoad>(what); }
};

/// A load run: one page, or parts of rows whose chunks are next to each other in the file. One read gets it, or a few
/// if chunks of one part are apart.
using LoadRun = std::vector<PartLoad>;

/// Makes a part of a row, without reservations.
[[nodiscard]] PartLoad row_load(const CacheKey& key, RowLoad what);

/// Return about the bytes of a part's data, and the bytes that reading and decoding need besides. Require a part of a
/// row.
[[nodiscard]] std::uint64_t decoded_bytes(const PartLoad& part);
[[nodiscard]] std::uint64_t working_bytes(const format::Volume& volume, const PartLoad& part);

/// Returns the bytes that a part holds now that it is read.
[[nodiscard]] std::uint64_t held_bytes(const CacheData& data);

/// Sorts parts of rows by offset, and joins them to load runs of at most `run_bytes`, or of one part.
[[nodiscard]] std::vector<LoadRun> runs_of(const format::Volume& volume, std::vector<PartLoad> parts,
                                           std::uint64_t run_bytes);

/// Reads and decodes a load run; sets `data` of each part. `attributes` selects the summaries of index pages. Errors
/// name the file and the part. Thread-safe.
void read_run(const format::Volume& volume, const format::SummaryAttributes& attributes, LoadRun& run);

/// The same for several load runs, read_threads at a time. Those that were not begun fail if the caller is interrupted.
void read_runs(const format::Volume& volume, const format::SummaryAttributes& attributes, std::span<LoadRun> runs);

/// Threads of low priority that read and decode load runs, in the order of `submit`. All calls must come from one
/// thread.
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

  /// Removes and returns the load runs that were not begun.
  [[nodiscard]] std::vector<LoadRun> withdraw();

  /// Moves out the load runs that were read, or failed, since the last call.
  [[nodiscard]] std::vector<LoadRun> extract_done();

  /// Waits until `extract_done` has a result, nothing is left to read, or `deadline`; less if the caller is
  /// interrupted.
  void wait_until(std::chrono::steady_clock::time_point deadline);

 private:
  void work();

  const format::Volume& volume_;
  const format::SummaryAttributes attributes_;
  const std::function<void()> on_data_;
  std::mutex mutex_;
  std::condition_variable submitted_;
  std::condition_variable finished_;
  std::list<LoadRun> queue_;  // lists, so that a thread moves a run without memory
  std::list<LoadRun> done_;
  std::size_t begun_ = 0;  // begun and not done
  std::stop_source stop_;
  std::vector<std::thread> threads_;
};

}  // namespace splatvol
