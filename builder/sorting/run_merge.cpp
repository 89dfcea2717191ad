#include "builder/sorting/run_merge.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <thread>

namespace splatvol {
namespace {

constexpr std::size_t most_read_bytes = std::size_t{1}
                                        << 20;  // in one read; more gains nothing, even on rotating disks
constexpr std::size_t alignment = 16;

constexpr std::size_t round_up(std::size_t bytes) { return (bytes + alignment - 1) / alignment * alignment; }

std::size_t unpacked_bytes(const PacketShape& shape) {
  return round_up(shape.records * shape.record_bytes) + round_up(shape.records * sizeof(MortonKey));
}

}  // namespace

std::size_t RunMerger::least_memory(const PacketShape& shape) {
  return 2 * unpacked_bytes(shape) + round_up(packet_bound(shape.records, shape.record_bytes));
}

RunMerger::RunMerger(TempFile& file, std::span<const Run> runs, const PacketShape& shape, const KeyFunction& key,
                     std::span<std::byte> memory, bool keep)
    : record_bytes_(shape.record_bytes), key_(key), tree_(runs.size(), Entry{0, 0, -1}) {
  const std::size_t share = memory.size() / runs.size() / alignment * alignment;
  for (const Run& run : runs) {
    std::span<std::byte> rest = memory.subspan(inputs_.size() * share, share);
    const auto allocate = [&](std::size_t bytes) {
      const std::span<std::byte> part = rest.first(bytes);
      rest = rest.subspan(round_up(bytes));
      return part;
    };
    std::array<Buffer, 2> buffers;
    for (Buffer& buffer : buffers) {
      buffer.records = allocate(shape.records * record_bytes_);
      const std::span<std::byte> keys = allocate(shape.records * sizeof(MortonKey));
      buffer.keys = {reinterpret_cast<MortonKey*>(keys.data()), shape.records};
    }
    const std::size_t read_bytes = std::max(packet_bound(shape.records, record_bytes_), most_read_bytes);
    inputs_.push_back(std::make_unique<RunInput>(
        PacketReader(file, run.begin, run.end, record_bytes_, rest.first(std::min(rest.size(), read_bytes)), keep)));
    inputs_.back()->buffers = buffers;
  }
  for (const auto& input : inputs_) read_ahead(*input);
}

RunMerger::~RunMerger() { reading_.wait(); }

void RunMerger::read_ahead(RunInput& input) {
  input.ready.store(false, std::memory_order_relaxed);
  input.claimed.store(false, std::memory_order_release);
  reading_.run([this, &input] { read_if_unclaimed(input); });
}

void RunMerger::read_if_unclaimed(RunInput& input) {
  if (input.claimed.exchange(true, std::memory_order_acq_rel)) return;
  Buffer& buffer = input.buffers[1];
  const Result<std::size_t> count = input.reader.next(buffer.records);
  if (count) {
    buffer.count = *count;
    key_(buffer.records.first(*count * record_bytes_), buffer.keys.first(*count));
  } else {
    input.status = tl::unexpected<Error>(count.error());
  }
  input.ready.store(true, std::memory_order_release);
}

// Advances to the packet that was read ahead. A wait for TBB's tasks could take up any other task, also one that waits
// for this merge.
Status RunMerger::advance(RunInput& input) {
  read_if_unclaimed(input);
  while (!input.ready.load(std::memory_order_acquire)) std::this_thread::yield();
  SPLATVOL_TRY(input.status);
  std::swap(input.buffers[0], input.buffers[1]);
  input.next = 0;
  if (input.buffers[0].count > 0) read_ahead(input);
  return {};
}

// Replays the matches on the path from a run to the root, with the run's next key: in each match the smaller key moves
// up, and the larger one stays.
void RunMerger::replay(std::int64_t run) {
  constexpr std::uint64_t none = std::numeric_limits<std::uint64_t>::max();
  const RunInput& input = *inputs_[static_cast<std::size_t>(run)];
  const Buffer& buffer = input.buffers[0];
  const MortonKey key = input.next < buffer.count ? buffer.keys[input.next] : MortonKey{none, none};
  Entry winner{key.high, key.low, run};
  for (std::size_t match = (static_cast<std::size_t>(run) + inputs_.size()) / 2; match > 0; match /= 2) {
    // No branches, as the processor could not foresee them.
    const Entry other = tree_[match];
    const bool loses = (other.high < winner.high) |
                       ((other.high == winner.high) &
                        ((other.low < winner.low) | ((other.low == winner.low) & (other.run < winner.run))));
    tree_[match] = loses ? winner : other;
    winner = loses ? other : winner;
  }
  tree_[0] = winner;
}

// At first the tree is full of entries that always win. Each run's entry pushes one of them out.
Status RunMerger::start() {
  started_ = true;
  for (std::size_t run = 0; run < inputs_.size(); ++run) {
    SPLATVOL_TRY(advance(*inputs_[run]));
    replay(static_cast<std::int64_t>(run));
  }
  return {};
}

Result<std::size_t> RunMerger::fill(std::span<std::byte> records, std::span<MortonKey> keys) {
  if (!started_) SPLATVOL_TRY(start());
  std::byte* out = records.data();
  for (std::size_t filled = 0; filled < keys.size(); ++filled, out += record_bytes_) {
    const Entry& winner = tree_[0];
    RunInput& input = *inputs_[static_cast<std::size_t>(winner.run)];
    const Buffer& buffer = input.buffers[0];
    if (input.next == buffer.count) return filled;
    std::memcpy(out, buffer.records.data() + input.next * record_bytes_, record_bytes_);
    keys[filled] = {winner.high, winner.low};
    if (++input.next == buffer.count) SPLATVOL_TRY(advance(input));
    replay(winner.run);
  }
  return keys.size();
}

}  // namespace splatvol
