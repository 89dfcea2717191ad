// Reading and decoding of parts of a file, at once or by threads of their own.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <span>
#include <thread>
#include <variant>
#include <vector>

#include "base/error.h"
#include "format/volume.h"
#include "streamer/budget.h"
#include "streamer/cache.h"

namespace splatvol {

/// How many parts are read at once: a disk or a server answers some at a time faster than one by one, whatever the
/// number of processors (bench/read_bench).
inline constexpr unsigned read_threads = 8;

/// What reading a part takes besides its key (a directory page: nothing).
struct IndexPageLoad {
  format::IndexPageRef ref;
  std::uint8_t child_mask;
  std::vector<std::uint64_t> parent_counts;
};
struct DirectoryPageLoad {};
struct ChunkLoad {
  format::ColumnKind kind;
  std::uint32_t points;
  format::ChunkLocation location;
};

/// A part of the file on its way into the cache.
struct PartLoad {
  CacheKey key;
  std::variant<IndexPageLoad, DirectoryPageLoad, ChunkLoad> what;
  Reservation decoded;     // goes with the data into the cache
  Reservation working;     // packed bytes, and what decoding takes for itself
  Result<CacheData> data;  // CacheData() until it is read
  float error = 0;         // that of the picture without it, as CutItem has it

  [[nodiscard]] const ChunkLoad& chunk() const { return std::get<ChunkLoad>(what); }
};

/// One page, or chunks that lie side by side in the file and are read at once.
using LoadRun = std::vector<PartLoad>;

/// A chunk, nothing reserved yet.
[[nodiscard]] PartLoad chunk_load(const CacheKey& key, const ChunkLoad& what);

/// Bytes of a chunk's data, and of the rest that reading it takes.
[[nodiscard]] std::uint64_t decoded_bytes(const ChunkLoad& chunk);
[[nodiscard]] std::uint64_t working_bytes(const format::Volume& volume, const ChunkLoad& chunk);

/// Puts chunks into runs of at most `run_bytes`, or of one chunk, in the file's order.
[[nodiscard]] std::vector<LoadRun> runs_of(const format::Volume& volume, std::vector<PartLoad> chunks,
                                           std::uint64_t run_bytes);

/// Reads and decodes a run; sets `data` of each part. `attribute` is that of index pages. Errors name the file and the
/// part. Thread-safe.
void read_run(const format::Volume& volume, int attribute, LoadRun& run);
void read_runs(const format::Volume& volume, int attribute, std::span<LoadRun> runs);  // read_threads at a time

/// Threads that read and decode runs, in the order in which they are submitted. Every call may come from one thread
/// only.
class Loader {
 public:
  /// Keeps a reference to the volume.
  Loader(const format::Volume& volume, int attribute, unsigned threads);
  Loader(const Loader&) = delete;
  Loader& operator=(const Loader&) = delete;

  /// Begins no further run; waits for those that were begun.
  ~Loader();

  void submit(LoadRun run);

  /// Takes back what was not begun.
  [[nodiscard]] std::vector<LoadRun> withdraw();

  /// What has been read or has failed since the last call.
  [[nodiscard]] std::vector<LoadRun> take();

  /// Waits until `take` has something to hand out, nothing is left to be read, or `deadline`.
  void wait_until(std::chrono::steady_clock::time_point deadline);

 private:
  void work();

  const format::Volume& volume_;
  const int attribute_;
  std::mutex mutex_;
  std::condition_variable submitted_;
  std::condition_variable finished_;
  std::deque<LoadRun> queue_;
  std::vector<LoadRun> done_;
  std::size_t begun_ = 0;  // and not done
  bool stopping_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace splatvol
