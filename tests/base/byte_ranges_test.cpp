#include "base/byte_ranges.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <random>
#include <vector>

#include "base/part_table.h"
#include "tests/support/fault_source.h"
#include "tests/support/memory_source.h"
#include "tests/support/results.h"

namespace splatvol::test {
namespace {

using Bytes = std::vector<std::byte>;
using Ranges = std::vector<ByteRange>;
constexpr std::uint64_t kib = 1024;

TEST(JoinRanges, ThatAreNear) {
  EXPECT_EQ(join_ranges({}, 10), Ranges());
  EXPECT_EQ(join_ranges({{30, 40}, {0, 10}, {5, 12}, {7, 7}}, 0), (Ranges{{0, 12}, {30, 40}}));
  EXPECT_EQ(join_ranges({{0, 10}, {20, 30}, {41, 50}}, 10), (Ranges{{0, 30}, {41, 50}}));
  EXPECT_EQ(join_ranges({{0, 90}, {10, 20}, {95, 99}}, 5), (Ranges{{0, 99}}));
}

TEST(JoinRanges, ToFew) {
  EXPECT_EQ(join_to_few({{0, 10}, {1000 * kib, 1001 * kib}}), (Ranges{{0, 10}, {1000 * kib, 1001 * kib}}));
  EXPECT_EQ(join_to_few({{0, 10}, {20, 30}, {1000 * kib, 1001 * kib}}), (Ranges{{0, 30}, {1000 * kib, 1001 * kib}}));
  // Each 256 KiB may be a request.
  EXPECT_EQ(join_to_few({{0, 300 * kib}, {301 * kib, 302 * kib}, {400 * kib, 401 * kib}}).size(), 3U);
  std::mt19937 random(1);
  for (int run = 0; run < 200; ++run) {
    Ranges ranges;
    std::uint64_t end = 0, bytes = 0;
    for (int i = 0; i < 60; ++i) {
      const std::uint64_t begin = end + random() % (20 * kib);
      end = begin + 1 + random() % (10 * kib);
      ranges.push_back({begin, end});
    }
    const Ranges joined = join_to_few(ranges);
    for (const ByteRange& range : joined) bytes += range.end - range.begin;
    EXPECT_LE(joined.size(), 2 + bytes / (256 * kib));
    for (const ByteRange& range : ranges)
      EXPECT_TRUE(std::ranges::any_of(
          joined, [&](const ByteRange& all) { return all.begin <= range.begin && range.end <= all.end; }));
    for (std::size_t i = 1; i < joined.size(); ++i) EXPECT_GT(joined[i].begin, joined[i - 1].end);
  }
}

TEST(CountedSource, TellsWhatIsReadAgain) {
  const Bytes all(1000);
  CountedSource source(memory_source(all, "counted"));
  const auto read = [&](std::uint64_t offset, std::size_t count) {
    Bytes bytes(count);
    EXPECT_TRUE(source.read(offset, bytes));
  };
  read(100, 100), read(300, 100), read(200, 100);
  EXPECT_EQ(source.bytes_read_again(), 0U);
  read(100, 300);
  EXPECT_EQ(source.bytes_read_again(), 300U);
  read(50, 100), read(390, 20), read(0, 0), read(900, 100);
  EXPECT_EQ(source.bytes_read_again(), 360U);
  read(0, 1000);
  EXPECT_EQ(source.bytes_read_again(), 360U + 350 + 10 + 100);
  EXPECT_EQ(source.bytes_read(), 300U + 300 + 220 + 1000);
}

TEST(BytesAhead, AreTakenFromMemoryWhileTheyLive) {
  Bytes all(1 << 20);
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = static_cast<std::byte>(i % 251);
  const auto faults = std::make_shared<Faults>(memory_source(all, "counted"));
  const auto source = std::make_shared<CountedSource>(std::make_unique<FaultSource>(faults));
  const auto read = [&](std::uint64_t offset, std::size_t count) {
    Bytes bytes(count);
    EXPECT_TRUE(source->read(offset, bytes));
    for (const std::byte byte : bytes) EXPECT_EQ(byte, static_cast<std::byte>(offset++ % 251));
  };
  const PartRoom large = own_room(8000), small = own_room(4000);
  auto ahead = value_of(BytesAhead::read(source, {{100, 200}, {5000, 6000}}, *large.share));
  EXPECT_EQ(large.share->used(), 1100U);
  EXPECT_EQ(source->requests(), 2U);
  EXPECT_EQ(faults->reads(), 2U);
  EXPECT_EQ(source->bytes_read(), 1100U);
  read(100, 100), read(150, 50), read(5999, 1), read(5000, 1000);
  EXPECT_EQ(faults->reads(), 2U);
  read(99, 2), read(199, 2), read(4999, 1), read(6000, 1), read(150, 5000);
  EXPECT_EQ(faults->reads(), 7U);
  ahead.reset();
  EXPECT_EQ(large.share->used(), 0U);
  read(150, 10);
  EXPECT_EQ(faults->reads(), 8U);
  EXPECT_EQ(value_of(BytesAhead::read(source, {{100, 200}, {5000, 6000}}, *small.share)), nullptr) << "too much";
  EXPECT_EQ(faults->reads(), 8U);
}

// A range by itself is one request. Others beside it are joined only if the source can.
TEST(BytesAhead, AreReadOnceFromASourceThatKnowsNoParts) {
  constexpr std::uint64_t mib = 1024 * kib;
  const Bytes all(8 * mib);
  const auto source = std::make_shared<CountedSource>(memory_source(all, "plain"));
  const PartRoom room = own_room(32 * mib);
  const auto ahead =
      value_of(BytesAhead::read(source, {{0, 2 * mib}, {5 * mib, 5 * mib + 9}, {7 * mib, 7 * mib + 9}}, *room.share));
  EXPECT_EQ(source->requests(), 3U);
  EXPECT_EQ(source->bytes_read(), 2 * mib + 18);
  EXPECT_EQ(source->bytes_read_again(), 0U);
}

// Where requests cannot be joined, what lies far apart stays apart.
TEST(JoinToFew, ReadsNoLargeGaps) {
  const std::uint64_t far = std::uint64_t{1} << 30;
  const std::vector<ByteRange> ranges{{0, 10}, {far, far + 10}, {2 * far, 2 * far + 10}};
  EXPECT_EQ(join_to_few(ranges), ranges);
}

TEST(BytesAhead, AreReadTogetherOverSmallGaps) {
  const Bytes all(1 << 20);
  const auto source = std::make_shared<CountedSource>(memory_source(all, "near"));
  const auto together = value_of(BytesAhead::read_together(source, {{0, 100}, {150, 200}, {900, 1000}}, 64));
  EXPECT_EQ(source->requests(), 2U);
  EXPECT_EQ(source->bytes_read(), 300U);
  Bytes bytes(50);
  EXPECT_TRUE(source->read(150, bytes));
  EXPECT_EQ(source->requests(), 2U) << "they are there";
}

}  // namespace
}  // namespace splatvol::test
