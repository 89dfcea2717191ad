#include "builder/sorting/external_sort.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>
#include <tbb/task_group.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <optional>
#include <vector>

#include "builder/sorting/record_packets.h"
#include "builder/sorting/run_merge.h"

namespace splatvol {
namespace {

constexpr std::size_t most_packet_bytes = std::size_t{1} << 17;
constexpr std::size_t most_work_bytes = std::size_t{1} << 22;
constexpr std::size_t most_records = std::numeric_limits<std::uint32_t>::max() - 1;  // in a run made in memory
constexpr std::size_t alignment = 16;
constexpr std::size_t records_at_once = 512;  // copied by one task
constexpr std::size_t records_ahead = 16;     // fetched into the cache before their turn

constexpr std::size_t round_up(std::size_t bytes) { return (bytes + alignment - 1) / alignment * alignment; }
constexpr std::size_t round_down(std::size_t bytes) { return bytes / alignment * alignment; }

// One allocation; pages that are never used take no memory.
class Memory {
 public:
  explicit Memory(std::size_t bytes) : bytes_(bytes), data_(std::make_unique_for_overwrite<std::byte[]>(bytes)) {}
  [[nodiscard]] std::span<std::byte> span() const { return {data_.get(), bytes_}; }

 private:
  std::size_t bytes_;
  std::unique_ptr<std::byte[]> data_;
};

// Shares of the memory.
struct Plan {
  PacketShape packet;
  std::size_t work_bytes;        // until finish(): packets being packed, or the outputs
  std::size_t first_run;         // records; as many as fit, as they may be all
  std::size_t later_runs;        // records in each of two buffers, one being filled and one being sorted
  std::size_t merge_work_bytes;  // from finish() on: the outputs; as much again for packets being packed
  std::size_t runs_at_once;      // most runs in one merge

  explicit Plan(const SortOptions& options) {
    const std::size_t least = std::min(options.memory, options.merge_memory);
    packet.record_bytes = options.record_bytes;
    packet.records = std::min(least / 64, most_packet_bytes) / options.record_bytes;
    packet.records = std::max<std::size_t>(packet.records, 1);
    // Both outputs hold a packet at least, also if its one record is longer than most_work_bytes.
    const std::size_t most_work = std::max(most_work_bytes, 4 * packet_bound(packet.records, options.record_bytes));
    work_bytes = round_down(std::min(options.memory / 8, most_work));
    merge_work_bytes = round_down(std::min(options.merge_memory / 8, most_work));
    const std::size_t rest = options.memory - work_bytes - 2 * alignment;  // each of two spans may lose `alignment`
    first_run = std::min(rest / (options.record_bytes + sizeof(std::uint64_t)), most_records);
    later_runs = std::min(rest / (2 * options.record_bytes + sizeof(std::uint64_t)), most_records);
    runs_at_once = (options.merge_memory - 2 * merge_work_bytes) / RunMerger::least_memory(packet);
  }
};

// Sorted records for the caller of next(): the ones returned last, or the ones made ahead.
struct Output {
  std::span<std::byte> records;
  std::span<MortonKey> keys;
  std::size_t count = 0;
  Status status;
};

// Makes two outputs in `memory`, each for whole packets.
std::array<Output, 2> make_outputs(const PacketShape& packet, std::span<std::byte> memory) {
  const std::size_t half = round_down(memory.size() / 2);
  const std::size_t fit = (half - alignment) / (packet.record_bytes + sizeof(MortonKey));
  const std::size_t count = fit / packet.records * packet.records;
  std::array<Output, 2> outputs;
  for (std::size_t i = 0; i < 2; ++i) {
    const std::span<std::byte> part = memory.subspan(i * half, half);
    outputs[i].records = part.first(count * packet.record_bytes);
    outputs[i].keys = {reinterpret_cast<MortonKey*>(part.data() + round_up(outputs[i].records.size())), count};
  }
  return outputs;
}

}  // namespace

class ExternalSorter::Impl {
 public:
  explicit Impl(SortOptions options)
      : options_(std::move(options)), plan_(options_), memory_(std::in_place, options_.memory) {
    use_first_layout();
  }
  ~Impl() {
    producing_.wait();
    spilling_.wait();
  }

  Status add(std::span<const std::byte> records) {
    while (!records.empty()) {
      if (filled_ * record_bytes() == filling_.size()) SPLATVOL_TRY(make_room());
      const std::span<std::byte> room = filling_.subspan(filled_ * record_bytes());
      const std::size_t bytes = std::min(room.size(), records.size());
      std::memcpy(room.data(), records.data(), bytes);
      filled_ += bytes / record_bytes();
      count_ += bytes / record_bytes();
      records = records.subspan(bytes);
    }
    return {};
  }

  Status finish() {
    spilling_.wait();
    SPLATVOL_TRY(spilled_);
    if (!file_ && stays_in_memory(count_)) {
      sort_by_key(filled_records(), options_.key, words_.first(filled_));
      outputs_ = make_outputs(plan_.packet, work());
      producing_.run([this] { produce(); });
      return {};
    }
    SPLATVOL_TRY(spill(filled_records()));
    memory_.reset();
    memory_.emplace(options_.merge_memory);
    outputs_ = make_outputs(plan_.packet, memory_->span().first(plan_.merge_work_bytes));
    while (runs_.size() > plan_.runs_at_once) SPLATVOL_TRY(merge_some());
    start_merging(runs_, options_.rewinds);
    return {};
  }

  Result<SortedRecords> next() {
    producing_.wait();
    std::swap(outputs_[0], outputs_[1]);
    const Output& output = outputs_[0];
    SPLATVOL_TRY(output.status);
    if (output.count > 0)
      producing_.run([this] { produce(); });
    else
      outputs_[1].count = 0;  // later calls return nothing either
    return SortedRecords{output.records.first(output.count * record_bytes()), output.keys.first(output.count)};
  }

  Status rewind() {
    producing_.wait();
    for (Output& output : outputs_) output.count = 0;
    copied_ = 0;
    if (merger_)
      start_merging(runs_);
    else
      producing_.run([this] { produce(); });
    return {};
  }

  std::uint64_t count() const { return count_; }
  std::uint64_t temp_bytes(std::uint64_t count) const {
    if (stays_in_memory(count)) return 0;
    constexpr std::uint64_t pages = 8192;  // bytes at the ends of a run that cannot be released
    const std::uint64_t runs = 2 + count / plan_.later_runs, packets = runs + count / plan_.packet.records;
    return packets * packet_bound(plan_.packet.records, record_bytes()) + runs * pages;
  }

 private:
  std::size_t record_bytes() const { return options_.record_bytes; }
  std::span<std::byte> work() const { return memory_->span().last(plan_.work_bytes); }
  bool stays_in_memory(std::uint64_t count) const {
    return count <= plan_.first_run &&
           count * (record_bytes() + sizeof(std::uint64_t)) + plan_.work_bytes + 2 * alignment <= options_.merge_memory;
  }

  // Until the first run is full: one buffer for records, then words, then work.
  void use_first_layout() {
    const std::size_t bytes = plan_.first_run * record_bytes();
    filling_ = memory_->span().first(bytes);
    words_ = {reinterpret_cast<std::uint64_t*>(memory_->span().data() + round_up(bytes)), plan_.first_run};
  }

  // For later runs: one buffer that add() fills, and one that is sorted and written at the same time; then words, work.
  void use_later_layout() {
    const std::size_t bytes = plan_.later_runs * record_bytes();
    filling_ = memory_->span().first(bytes);
    other_ = memory_->span().subspan(bytes, bytes);
    words_ = {reinterpret_cast<std::uint64_t*>(memory_->span().data() + round_up(2 * bytes)), plan_.later_runs};
  }

  // Makes filling_ empty.
  Status make_room() {
    if (other_.empty()) {
      SPLATVOL_TRY(spill(filled_records()));
      use_later_layout();
    } else {
      spilling_.wait();
      SPLATVOL_TRY(spilled_);
      spilling_.run([this, records = filled_records()] { spilled_ = spill(records); });
      std::swap(filling_, other_);
    }
    filled_ = 0;
    return {};
  }

  RecordSpan filled_records() const { return {filling_.data(), filled_, record_bytes()}; }

  // Sorts the records and writes them as a run.
  Status spill(const RecordSpan& records) {
    if (!file_) SPLATVOL_TRY_SET(file_, TempFile::create(options_.folder));
    const std::span<std::uint64_t> words = words_.first(records.count);
    sort_by_key(records, options_.key, words);
    Run run{file_->size(), 0};
    const auto locate = [&, mask = index_mask(records.count)](std::size_t first, std::span<const std::byte*> located) {
      for (std::size_t i = 0; i < located.size(); ++i) {
        located[i] = records[words[first + i] & mask];
        __builtin_prefetch(located[i]);
      }
    };
    SPLATVOL_TRY(append_packets(*file_, records.count, locate, work()));
    run.end = file_->size();
    runs_.push_back(run);
    return {};
  }

  // Appends records as packets; packs as many packets at the same time as fit into `memory`.
  Status append_packets(TempFile& file, std::size_t count, const LocateRecords& locate, std::span<std::byte> memory) {
    const std::size_t records = plan_.packet.records, bound = packet_bound(records, record_bytes());
    const std::size_t packets = (count + records - 1) / records, at_once = memory.size() / bound;
    std::vector<std::size_t> bytes(at_once);
    for (std::size_t begin = 0; begin < packets; begin += at_once) {
      const std::size_t end = std::min(begin + at_once, packets);
      tbb::parallel_for(begin, end, [&](std::size_t packet) {
        const auto locate_in_packet = [&](std::size_t first, std::span<const std::byte*> located) {
          locate(packet * records + first, located);
        };
        bytes[packet - begin] = pack_records(std::min(records, count - packet * records), locate_in_packet,
                                             record_bytes(), memory.subspan((packet - begin) * bound, bound));
      });
      for (std::size_t i = 0; i < end - begin; ++i) SPLATVOL_TRY(file.append(memory.subspan(i * bound, bytes[i])));
    }
    return {};
  }

  // Merges groups of neighbouring runs, so that equal keys stay in their order. Makes as few groups as possible.
  Status merge_some() {
    const std::size_t groups = (runs_.size() + plan_.runs_at_once - 1) / plan_.runs_at_once;
    SPLATVOL_TRY_ASSIGN(merged, TempFile::create(options_.folder));
    std::vector<Run> merged_runs;
    for (std::size_t group = 0; group < groups; ++group) {
      const std::size_t begin = runs_.size() * group / groups, end = runs_.size() * (group + 1) / groups;
      const std::uint64_t offset = merged.size();
      SPLATVOL_TRY(merge_into(merged, std::span(runs_).subspan(begin, end - begin)));
      merged_runs.push_back({offset, merged.size()});
    }
    merger_.reset();
    file_ = std::move(merged);
    runs_ = std::move(merged_runs);
    return {};
  }

  Status merge_into(TempFile& file, std::span<const Run> runs) {
    const std::span<std::byte> packing = memory_->span().subspan(plan_.merge_work_bytes, plan_.merge_work_bytes);
    start_merging(runs);
    for (;;) {
      SPLATVOL_TRY_ASSIGN(packet, next());
      if (packet.keys.empty()) return {};
      const auto locate = [&](std::size_t first, std::span<const std::byte*> located) {
        for (std::size_t i = 0; i < located.size(); ++i)
          located[i] = packet.records.data() + (first + i) * record_bytes();
      };
      SPLATVOL_TRY(append_packets(file, packet.keys.size(), locate, packing));
    }
  }

  void start_merging(std::span<const Run> runs, bool keep = false) {
    merger_.reset();  // its threads use the memory
    merger_ = std::make_unique<RunMerger>(*file_, runs, plan_.packet, options_.key,
                                          memory_->span().subspan(2 * plan_.merge_work_bytes), keep);
    producing_.run([this] { produce(); });
  }

  // Makes the output that next() will return. Takes up no other tasks: one of them might wait for this one.
  void produce() {
    Output& output = outputs_[1];
    if (!merger_) {
      tbb::this_task_arena::isolate([&] { copy_sorted(output); });
    } else if (const Result<std::size_t> count = merger_->fill(output.records, output.keys); count) {
      output.count = *count;
    } else {
      output.status = tl::unexpected<Error>(count.error());
    }
  }

  void copy_sorted(Output& output) {
    output.count = std::min(output.keys.size(), filled_ - copied_);
    const RecordSpan records = filled_records();
    const auto record = [&, mask = index_mask(filled_)](std::size_t i) { return records[words_[i] & mask]; };
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, output.count, records_at_once),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                        std::byte* out = output.records.data() + range.begin() * record_bytes();
                        for (std::size_t i = copied_ + range.begin(); i < copied_ + range.end(); ++i) {
                          __builtin_prefetch(record(std::min(i + records_ahead, filled_ - 1)));
                          std::memcpy(out, record(i), record_bytes());
                          out += record_bytes();
                        }
                        options_.key(
                            output.records.subspan(range.begin() * record_bytes(), range.size() * record_bytes()),
                            output.keys.subspan(range.begin(), range.size()));
                      });
    copied_ += output.count;
  }

  SortOptions options_;
  Plan plan_;
  std::optional<Memory> memory_;
  std::uint64_t count_ = 0;

  // Until finish().
  std::span<std::byte> filling_, other_;  // room for records; other_ is empty until the first run is written
  std::size_t filled_ = 0;                // records in filling_
  std::span<std::uint64_t> words_;
  tbb::task_group spilling_;
  Status spilled_;

  std::optional<TempFile> file_;
  std::vector<Run> runs_;

  // From finish() on.
  std::array<Output, 2> outputs_;      // returned last; made ahead
  std::size_t copied_ = 0;             // sorted records that are in an output already, if all stay in memory
  std::unique_ptr<RunMerger> merger_;  // if they do not
  tbb::task_group producing_;
};

std::size_t ExternalSorter::least_memory(std::size_t record_bytes) {
  return std::max<std::size_t>(64 * (record_bytes + sizeof(MortonKey)), std::size_t{1} << 16);
}

Result<ExternalSorter> ExternalSorter::create(SortOptions options) {
  const std::size_t least = least_memory(options.record_bytes);
  if (std::min(options.memory, options.merge_memory) < least)
    return fail(ErrorCode::out_of_budget, "sorting records of {} bytes takes {} bytes of memory", options.record_bytes,
                least);
  options.memory = round_down(options.memory);
  options.merge_memory = round_down(options.merge_memory);
  return ExternalSorter(std::make_unique<Impl>(std::move(options)));
}

ExternalSorter::ExternalSorter(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ExternalSorter::ExternalSorter(ExternalSorter&&) noexcept = default;
ExternalSorter& ExternalSorter::operator=(ExternalSorter&&) noexcept = default;
ExternalSorter::~ExternalSorter() = default;

Status ExternalSorter::add(std::span<const std::byte> records) { return impl_->add(records); }
Status ExternalSorter::finish() { return impl_->finish(); }
Result<SortedRecords> ExternalSorter::next() { return impl_->next(); }
Status ExternalSorter::rewind() { return impl_->rewind(); }
std::uint64_t ExternalSorter::count() const { return impl_->count(); }
std::uint64_t ExternalSorter::temp_bytes(std::uint64_t count) const { return impl_->temp_bytes(count); }

}  // namespace splatvol
