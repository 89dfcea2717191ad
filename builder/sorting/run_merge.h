// Merges sorted runs of a file into one sorted stream.
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

/// The size of a record, and the most records in a packet.
struct PacketShape {
  std::size_t record_bytes = 0;
  std::size_t records = 0;
};

/// Merges runs by a tree of losers. Other threads read and unpack the next packet of each run, and make its keys.
class RunMerger {
 public:
  /// Returns the least bytes of memory for each run.
  [[nodiscard]] static std::size_t least_memory(const PacketShape& shape);

  /// Begins to read, and releases the disk space of packets that it has read, unless `keep`. All buffers lie in
  /// `memory`: at least least_memory for each run, aligned as MortonKey is. File, key and memory must outlive this.
  RunMerger(TempFile& file, std::span<const Run> runs, const PacketShape& shape, const KeyFunction& key,
            std::span<std::byte> memory, bool keep = false);
  RunMerger(const RunMerger&) = delete;
  RunMerger& operator=(const RunMerger&) = delete;
  ~RunMerger();

  /// Puts the next records into `records`, and their keys into `keys`: in ascending order of keys, equal keys in the
  /// order of the runs. Returns their number, which is below keys.size() only after the last.
  [[nodiscard]] Result<std::size_t> fill(std::span<std::byte> records, std::span<MortonKey> keys);

 private:
  struct Buffer {
    std::span<std::byte> records;
    std::span<MortonKey> keys;
    std::size_t count = 0;
  };
  struct RunInput {
    explicit RunInput(const PacketReader& packet_reader) : reader(packet_reader) {}

    PacketReader reader;
    std::array<Buffer, 2> buffers;     // being merged; read ahead
    std::size_t next = 0;              // record of buffers[0]
    Status status;                     // of the packet read ahead
    std::atomic<bool> claimed = true;  // a thread reads the packet, or has read it
    std::atomic<bool> ready = false;   // the packet has been read ahead
  };
  // A run with its next key. A run that has ended loses against all others.
  struct Entry {
    std::uint64_t high;
    std::uint64_t low;
    std::int64_t run;
  };

  Status start();
  void read_ahead(RunInput& input);
  void read_if_unclaimed(RunInput& input);
  Status advance(RunInput& input);
  void replay(std::int64_t run);

  std::size_t record_bytes_;
  const KeyFunction& key_;
  std::vector<std::unique_ptr<RunInput>> inputs_;
  std::vector<Entry> tree_;  // the loser of each match; the winner of all at 0
  bool started_ = false;
  tbb::task_group reading_;
};

}  // namespace splatvol
