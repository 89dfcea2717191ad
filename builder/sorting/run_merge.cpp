#include "builder/sorting/run_merge.h"

#include <algorithm>
#include <cstring>
#include <limits>

namespace splatvol {
namespace {

constexpr std::size_t most_read_bytes = std::size_t{1} << 20;  // at a time: more gains nothing, on rotating disks too
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
                     std::span<std::byte> memory)
    : record_bytes_(shape.record_bytes), key_(key), tree_(runs.size(), Entry{0, 0, -1}) {
  const std::size_t share = memory.size() / runs.size() / alignment * alignment;
  for (const Run& run : runs) {
    std::span<std::byte> rest = memory.subspan(sources_.size() * share, share);
    const auto take = [&](std::size_t bytes) {
      const std::span<std::byte> taken = rest.first(bytes);
      rest = rest.subspan(round_up(bytes));
      return taken;
    };
    std::array<Buffer, 2> buffers;
    for (Buffer& buffer : buffers) {
      buffer.records = take(shape.records * record_bytes_);
      const std::span<std::byte> keys = take(shape.records * sizeof(MortonKey));
      buffer.keys = {reinterpret_cast<MortonKey*>(keys.data()), shape.records};
    }
    const std::size_t read_bytes = std::max(packet_bound(shape.records, record_bytes_), most_read_bytes);
    sources_.push_back(std::make_unique<Source>(
        PacketReader(file, run.begin, run.end, record_bytes_, rest.first(std::min(rest.size(), read_bytes)))));
    sources_.back()->buffers = buffers;
  }
  for (const auto& source : sources_) read_ahead(*source);
}

RunMerger::~RunMerger() { reading_.wait(); }

void RunMerger::read_ahead(Source& source) {
  source.ready.store(false, std::memory_order_relaxed);
  reading_.run([this, &source] {
    Buffer& buffer = source.buffers[1];
    const Result<std::size_t> count = source.reader.next(buffer.records);
    if (count) {
      buffer.count = *count;
      key_(buffer.records.first(*count * record_bytes_), buffer.keys.first(*count));
    } else {
      source.status = tl::unexpected<Error>(count.error());
    }
    source.ready.store(true, std::memory_order_release);
  });
}

// To the packet that was read ahead.
Status RunMerger::advance(Source& source) {
  if (!source.ready.load(std::memory_order_acquire)) reading_.wait();
  SPLATVOL_TRY(source.status);
  std::swap(source.buffers[0], source.buffers[1]);
  source.position = 0;
  if (source.buffers[0].count > 0) read_ahead(source);
  return {};
}

// The run's new key goes up the tree, and against whom it loses stays its place's winner.
void RunMerger::replay(std::int64_t run) {
  constexpr std::uint64_t none = std::numeric_limits<std::uint64_t>::max();
  const Source& source = *sources_[static_cast<std::size_t>(run)];
  const Buffer& buffer = source.buffers[0];
  const MortonKey key = source.position < buffer.count ? buffer.keys[source.position] : MortonKey{none, none};
  Entry winner{key.high, key.low, run};
  for (std::size_t node = (static_cast<std::size_t>(run) + sources_.size()) / 2; node > 0; node /= 2) {
    // No branches: none of them could be foreseen.
    const Entry other = tree_[node];
    const bool loses = (other.high < winner.high) |
                       ((other.high == winner.high) &
                        ((other.low < winner.low) | ((other.low == winner.low) & (other.run < winner.run))));
    tree_[node] = loses ? winner : other;
    winner = loses ? other : winner;
  }
  tree_[0] = winner;
}

// The tree is full of entries that win always, each run's pushes one out.
Status RunMerger::start() {
  started_ = true;
  for (std::size_t run = 0; run < sources_.size(); ++run) {
    SPLATVOL_TRY(advance(*sources_[run]));
    replay(static_cast<std::int64_t>(run));
  }
  return {};
}

Result<std::size_t> RunMerger::fill(std::span<std::byte> records, std::span<MortonKey> keys) {
  if (!started_) SPLATVOL_TRY(start());
  std::byte* out = records.data();
  for (std::size_t filled = 0; filled < keys.size(); ++filled, out += record_bytes_) {
    const Entry& winner = tree_[0];
    Source& source = *sources_[static_cast<std::size_t>(winner.run)];
    const Buffer& buffer = source.buffers[0];
    if (source.position == buffer.count) return filled;
    std::memcpy(out, buffer.records.data() + source.position * record_bytes_, record_bytes_);
    keys[filled] = {winner.high, winner.low};
    if (++source.position == buffer.count) SPLATVOL_TRY(advance(source));
    replay(winner.run);
  }
  return keys.size();
}

}  // namespace splatvol
