// Sorted runs in a file to one sorted stream.
#pragma once

#include <tbb/task_group.h>

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "builder/sorting/key_sort.h"
#include "builder/sorting/record_packets.h"

namespace splatvol {

/// A sorted run: packets in the bytes [begin, end) of a file, at least one.
struct Run {
  std::uint64_t begin = 0;
  std::uint64_t end = 0;
};

/// Records, and how many of them a packet has at most.
struct PacketShape {
  std::size_t record_bytes = 0;
  std::size_t records = 0;
};

/// Merges runs by a tree of losers; what they hold next is read, unpacked and given its keys on other threads.
class RunMerger {
 public:
  /// Bytes that a run takes at least.
  [[nodiscard]] static std::size_t least_memory(const PacketShape& shape);

  /// Begins to read. `memory`, at least least_memory for each run and aligned as MortonKey is, is where all buffers
  /// lie; it, file and key stay the caller's. The disk space of what was read is given back.
  RunMerger(TempFile& file, std::span<const Run> runs, const PacketShape& shape, const KeyFunction& key,
            std::span<std::byte> memory);
  RunMerger(const RunMerger&) = delete;
  RunMerger& operator=(const RunMerger&) = delete;
  ~RunMerger();

  /// Puts the next records into the fronts of both, in ascending order of keys, equal keys in the order of the runs;
  /// returns their number, below keys.size() only at the end.
  [[nodiscard]] Result<std::size_t> fill(std::span<std::byte> records, std::span<MortonKey> keys);

 private:
  struct Buffer {
    std::span<std::byte> records;
    std::span<MortonKey> keys;
    std::size_t count = 0;
  };
  struct Source {
    explicit Source(const PacketReader& packet_reader) : reader(packet_reader) {}

    PacketReader reader;
    std::array<Buffer, 2> buffers;  // in use; read ahead
    std::size_t position = 0;
    Status status;                    // of reading ahead
    std::atomic<bool> ready = false;  // that has been done
  };
  // A run's next key. Runs that have come to their end lose against all others.
  struct Entry {
    std::uint64_t high;
    std::uint64_t low;
    std::int64_t run;
  };

  Status start();
  void read_ahead(Source& source);
  Status advance(Source& source);
  void replay(std::int64_t run);

  std::size_t record_bytes_;
  const KeyFunction& key_;
  std::vector<std::unique_ptr<Source>> sources_;
  std::vector<Entry> tree_;  // losers; the winner at 0
  bool started_ = false;
  tbb::task_group reading_;
};

}  // namespace splatvol
