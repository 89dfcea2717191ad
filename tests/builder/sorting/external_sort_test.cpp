#include "builder/sorting/external_sort.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <functional>
#include <random>
#include <thread>
#include <vector>

#include "tests/format/allocation_counter.h"
#include "tests/support/results.h"

namespace splatvol::test {
namespace {

using Bytes = std::vector<std::byte>;

constexpr Cube cube{dvec3(0), 1};

// A record begins with three floats, its position. The other bytes are noise that tells records apart.
dvec3 position_of(const std::byte* record) {
  std::array<float, 3> p;
  std::memcpy(p.data(), record, sizeof p);
  return {p[0], p[1], p[2]};
}

KeyFunction key_of(std::size_t record_bytes) {
  return [record_bytes](std::span<const std::byte> records, std::span<MortonKey> keys) {
    ASSERT_EQ(records.size(), keys.size() * record_bytes);
    for (std::size_t i = 0; i < keys.size(); ++i)
      keys[i] = morton_key(position_of(records.data() + i * record_bytes), cube);
  };
}

Bytes make_records(std::size_t count, std::size_t record_bytes, const std::function<dvec3(std::mt19937&)>& position) {
  std::mt19937 random(1);
  Bytes records(count * record_bytes);
  for (std::size_t i = 0; i < count; ++i) {
    const dvec3 p = position(random);
    const std::array<float, 3> stored = {float(p.x), float(p.y), float(p.z)};
    std::byte* record = records.data() + i * record_bytes;
    std::memcpy(record, stored.data(), sizeof stored);
    for (std::size_t b = sizeof stored; b < record_bytes; ++b) record[b] = static_cast<std::byte>(random());
  }
  return records;
}

dvec3 anywhere(std::mt19937& random) {
  std::uniform_real_distribution<double> uniform(0, 1);
  return {uniform(random), uniform(random), uniform(random)};
}

// Half of the points lie in a billionth of the volume, at the cube's corner, where floats still tell them apart.
dvec3 clustered(std::mt19937& random) { return (random() % 2 == 0 ? 1e-3 : 1.0) * anywhere(random); }

// Twelve decades of distance to a corner: all bits of the keys count.
dvec3 graded(std::mt19937& random) {
  std::uniform_real_distribution<double> exponent(-12, 0);
  return std::pow(10.0, exponent(random)) * anywhere(random);
}

// At so few positions that most keys occur often.
dvec3 at_few_positions(std::mt19937& random) { return dvec3(random() % 10, random() % 10, 3) / 10.0; }

Bytes sort_in_memory(const Bytes& records, std::size_t record_bytes) {
  std::vector<std::pair<MortonKey, std::size_t>> order;
  for (std::size_t i = 0; i < records.size() / record_bytes; ++i)
    order.emplace_back(morton_key(position_of(records.data() + i * record_bytes), cube), i);
  std::ranges::stable_sort(order, {}, &std::pair<MortonKey, std::size_t>::first);
  Bytes sorted;
  sorted.reserve(records.size());
  for (const auto& [key, i] : order)
    sorted.insert(sorted.end(), records.data() + i * record_bytes, records.data() + (i + 1) * record_bytes);
  return sorted;
}

SortOptions options_for(std::size_t record_bytes, std::size_t memory) {
  return {record_bytes, key_of(record_bytes), memory, memory, ::testing::TempDir()};
}

// The bytes on the disk of this process's files without a name. A merge shrinks one file while another grows. The sum
// is too large if it is preempted between the one that shrinks and the one that grows; in the other order it is too
// small.
std::uint64_t unnamed_bytes() {
  std::vector<std::filesystem::path> paths;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) paths.push_back(entry.path());
  const auto sum = [&] {
    std::uint64_t bytes = 0;
    for (const std::filesystem::path& path : paths) {
      struct stat status {};
      if (::stat(path.c_str(), &status) == 0 && S_ISREG(status.st_mode) && status.st_nlink == 0)
        bytes += static_cast<std::uint64_t>(status.st_blocks) * 512;
    }
    return bytes;
  };
  const std::uint64_t forward = sum();
  std::reverse(paths.begin(), paths.end());
  return std::min(forward, sum());
}

struct Sorted {
  Bytes records;
  bool in_file = false;  // records were in a temporary file
};

// Adds the records in pieces of uneven sizes. Checks the keys that come with the sorted records.
Sorted sort_records(const Bytes& records, SortOptions options) {
  const std::size_t record_bytes = options.record_bytes;
  const std::uint64_t other_files = unnamed_bytes();
  auto sorter = ExternalSorter::create(std::move(options)).value();
  std::size_t added = 0;
  for (std::size_t piece = 1; added < records.size(); piece = piece * 3 % 10007) {
    const std::size_t bytes = std::min(piece * record_bytes, records.size() - added);
    EXPECT_TRUE(sorter.add(std::span(records).subspan(added, bytes)));
    added += bytes;
  }
  EXPECT_EQ(sorter.count(), records.size() / record_bytes);
  EXPECT_TRUE(sorter.finish());
  Sorted sorted;
  sorted.in_file = unnamed_bytes() > other_files;
  for (;;) {
    const SortedRecords packet = sorter.next().value();
    if (packet.keys.empty()) break;
    EXPECT_EQ(packet.records.size(), packet.keys.size() * record_bytes);
    for (std::size_t i = 0; i < packet.keys.size(); ++i)
      EXPECT_EQ(packet.keys[i], morton_key(position_of(packet.records.data() + i * record_bytes), cube));
    sorted.records.insert(sorted.records.end(), packet.records.begin(), packet.records.end());
  }
  EXPECT_TRUE(sorter.next().value().keys.empty());
  return sorted;
}

void expect_sorted(const Bytes& records, std::size_t record_bytes, std::initializer_list<std::size_t> memories) {
  const Bytes expected = sort_in_memory(records, record_bytes);
  for (const std::size_t memory : memories) {
    const Sorted sorted = sort_records(records, options_for(record_bytes, memory));
    EXPECT_EQ(sorted.in_file, records.size() > memory) << memory;
    EXPECT_TRUE(sorted.records == expected) << record_bytes << " bytes a record, memory of " << memory;
  }
}

TEST(ExternalSort, SameAsStableSortForEverySizeOfRecord) {
  for (const std::size_t record_bytes : {12u, 13u, 16u, 31u, 32u, 232u, 5000u}) {
    const std::size_t count = 4'000'000 / record_bytes;
    const std::size_t least = ExternalSorter::least_memory(record_bytes);
    expect_sorted(make_records(count, record_bytes, anywhere), record_bytes, {least, 1'500'000, 64'000'000});
  }
}

TEST(ExternalSort, StartsAgain) {
  constexpr std::size_t record_bytes = 32;
  const Bytes records = make_records(100'000, record_bytes, at_few_positions);
  const Bytes expected = sort_in_memory(records, record_bytes);
  for (const std::size_t memory : {100'000, 64'000'000}) {
    SortOptions options = options_for(record_bytes, memory);
    options.rewinds = true;
    auto sorter = ExternalSorter::create(std::move(options)).value();
    ASSERT_TRUE(sorter.add(records));
    ASSERT_TRUE(sorter.finish());
    for (int pass = 0; pass < 2; ++pass) {
      Bytes sorted;
      for (SortedRecords packet = sorter.next().value(); !packet.keys.empty(); packet = sorter.next().value())
        sorted.insert(sorted.end(), packet.records.begin(), packet.records.end());
      EXPECT_TRUE(sorted == expected) << "pass " << pass << ", memory of " << memory;
      if (pass == 0) {
        ASSERT_TRUE(sorter.rewind());
      }
    }
  }
}

// Points of a mesh with 60,000 attributes.
TEST(ExternalSort, RecordsOfMegabytes) {
  for (const std::size_t record_bytes : {std::size_t{2'200'000}, std::size_t{5'000'000}}) {
    const std::size_t least = ExternalSorter::least_memory(record_bytes);
    expect_sorted(make_records(8, record_bytes, anywhere), record_bytes, {least});
  }
}

TEST(ExternalSort, SameAsStableSortHoweverPointsLie) {
  for (const auto& position : {clustered, graded, at_few_positions})
    expect_sorted(make_records(300'000, 16, position), 16, {1 << 16, 1 << 20, 1 << 24});
}

// Equal keys keep their order through runs and several passes, and the sort takes no quadratic time.
TEST(ExternalSort, LeavesRecordsOfOneKeyInTheirOrder) {
  const Bytes records = make_records(1'000'000, 16, [](std::mt19937&) { return dvec3(0.3); });
  for (const std::size_t memory : {std::size_t{1} << 16, std::size_t{1} << 21, std::size_t{1} << 26})
    EXPECT_TRUE(sort_records(records, options_for(16, memory)).records == records) << memory;
}

TEST(ExternalSort, RecordsInOrderOrInReverse) {
  const Bytes forwards = sort_in_memory(make_records(200'000, 16, anywhere), 16);
  Bytes backwards;
  for (std::size_t i = forwards.size(); i > 0; i -= 16)
    backwards.insert(backwards.end(), forwards.data() + i - 16, forwards.data() + i);
  expect_sorted(forwards, 16, {1 << 17, 1 << 24});
  expect_sorted(backwards, 16, {1 << 17, 1 << 24});
}

TEST(ExternalSort, NothingAndOneRecord) {
  for (const std::size_t count : {0u, 1u}) {
    const Bytes records = make_records(count, 12, anywhere);
    const Sorted sorted = sort_records(records, options_for(12, 1 << 16));
    EXPECT_EQ(sorted.records, records);
    EXPECT_FALSE(sorted.in_file);
  }
}

// 64 KiB for 8 MB: some 200 runs, of which 9 can be merged at a time: every record is written three times.
TEST(ExternalSort, MergesInSeveralPasses) {
  const Bytes records = make_records(500'000, 16, anywhere);
  EXPECT_TRUE(sort_records(records, options_for(16, 1 << 16)).records == sort_in_memory(records, 16));
}

// The memory holds all records, but only until finish().
TEST(ExternalSort, WritesWhatTheMergeMayNotHold) {
  const Bytes records = make_records(100'000, 16, anywhere);
  SortOptions options = options_for(16, 1 << 24);
  EXPECT_FALSE(sort_records(records, options).in_file);
  options.merge_memory = 1 << 20;
  const Sorted sorted = sort_records(records, options);
  EXPECT_TRUE(sorted.in_file);
  EXPECT_TRUE(sorted.records == sort_in_memory(records, 16));
}

TEST(ExternalSort, SameForAnyNumberOfThreads) {
  const Bytes records = make_records(300'000, 32, clustered);
  const Bytes expected = sort_in_memory(records, 32);
  for (const std::size_t threads : {1u, 2u, 7u}) {
    const tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
    for (const std::size_t memory : {std::size_t{1} << 17, std::size_t{1} << 25})
      EXPECT_TRUE(sort_records(records, options_for(32, memory)).records == expected) << threads << ", " << memory;
  }
}

// Counts what operator new returns. Beyond the budget come small objects of runs and tasks, 200 bytes for each run.
TEST(ExternalSort, HoldsNoMoreThanItMay) {
  for (const std::size_t memory : {std::size_t{1} << 16, std::size_t{1} << 19, std::size_t{1} << 23})
    for (const std::size_t count : {20'000u, 80'000u, 320'000u}) {
      const Bytes records = make_records(count, 32, anywhere);
      const tbb::global_control control(tbb::global_control::max_allowed_parallelism, 2);
      auto sorter = ExternalSorter::create(options_for(32, memory / 2));  // so that TBB has its own memory already
      start_counting_allocations();
      sorter = ExternalSorter::create(options_for(32, memory));
      ASSERT_TRUE(sorter->add(records));
      ASSERT_TRUE(sorter->finish());
      while (!sorter->next().value().keys.empty()) {
      }
      EXPECT_LE(most_bytes_allocated(), memory + memory / 8 + 16384) << memory << ", " << count;
    }
}

TEST(ExternalSort, RefusesMemoryThatIsNotEnough) {
  SortOptions options = options_for(5000, ExternalSorter::least_memory(5000));
  EXPECT_TRUE(ExternalSorter::create(options));
  options.merge_memory -= 1;
  EXPECT_THAT(ExternalSorter::create(options), FailsWith(ErrorCode::out_of_budget));
}

// Sorts the records; returns the first error, of any call.
Status sort_all(const Bytes& records, SortOptions options) {
  SPLATVOL_TRY_ASSIGN(sorter, ExternalSorter::create(std::move(options)));
  SPLATVOL_TRY(sorter.add(records));
  SPLATVOL_TRY(sorter.finish());
  for (;;) {
    SPLATVOL_TRY_ASSIGN(packet, sorter.next());
    if (packet.keys.empty()) return {};
  }
}

TEST(ExternalSort, SaysInOneLineWhichFolderIsNone) {
  SortOptions options = options_for(16, 1 << 16);
  options.folder = "/nonexistent";
  EXPECT_TRUE(sort_all(make_records(1000, 16, anywhere), options));  // fits into memory
  const Status status = sort_all(make_records(100'000, 16, anywhere), options);
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().code, ErrorCode::io);
  EXPECT_EQ(status.error().message.find("/nonexistent: "), 0u);
  EXPECT_EQ(status.error().message.find('\n'), std::string::npos);
}

// A limit on the size of files has the same effect as a full disk.
TEST(ExternalSort, SaysThatTheDiskIsFull) {
  const Bytes records = make_records(500'000, 16, anywhere);
  rlimit old{};
  ::getrlimit(RLIMIT_FSIZE, &old);
  const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
  for (const rlim_t limit : {1'000'000u, 4'000'000u}) {
    const rlimit lowered{limit, old.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &lowered);
    const Status status = sort_all(records, options_for(16, 1 << 18));
    ::setrlimit(RLIMIT_FSIZE, &old);
    ASSERT_FALSE(status);
    EXPECT_EQ(status.error().code, ErrorCode::io);
  }
  std::signal(SIGXFSZ, old_handler);
}

TEST(ExternalSort, MayBeDroppedAtAnyTime) {
  const Bytes records = make_records(200'000, 16, anywhere);
  for (int steps = 0; steps < 4; ++steps) {
    auto sorter = ExternalSorter::create(options_for(16, 1 << 18)).value();
    EXPECT_TRUE(steps < 1 || sorter.add(records));
    EXPECT_TRUE(steps < 2 || sorter.finish());
    EXPECT_TRUE(steps < 3 || sorter.next());
  }
}

// This holds while it merges in passes too. Disk space is released as records are read: towards the end, most of it.
TEST(ExternalSort, TakesAndGivesBackTheDiskSpaceThatItSays) {
  const std::size_t count = 2'000'000;
  const Bytes records = make_records(count, 16, anywhere);
  for (const std::size_t memory : {std::size_t{1} << 18, std::size_t{1} << 23}) {
    auto sorter = ExternalSorter::create(options_for(16, memory)).value();
    EXPECT_EQ(sorter.temp_bytes(1000), 0u);
    EXPECT_LT(sorter.temp_bytes(count), count * 20);
    ASSERT_TRUE(sorter.add(records));
    std::uint64_t most = 0;
    {
      std::atomic<bool> done = false;
      std::thread watcher([&] {
        while (!done) most = std::max(most, unnamed_bytes());
      });
      EXPECT_TRUE(sorter.finish());
      done = true;
      watcher.join();
    }
    most = std::max(most, unnamed_bytes());  // the watcher may have come too late for a short finish()
    EXPECT_GT(most + memory, count * 12);  // the noise does not pack; what fits into memory is read ahead, and released
    EXPECT_LE(most, sorter.temp_bytes(count));
    for (std::size_t read = 0; read < count * 3 / 4;) read += sorter.next().value().keys.size();
    EXPECT_LT(unnamed_bytes(), most / 2);
  }
}

}  // namespace
}  // namespace splatvol::test
