#include "format/read_ahead.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "tests/support/results.h"

namespace splatvol::format {
namespace {

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

class Counted final : public ByteSource {
 public:
  explicit Counted(std::uint64_t& reads) : reads_(reads) {}
  [[nodiscard]] std::uint64_t size() const override { return 1 << 20; }
  [[nodiscard]] const std::string& name() const override { return name_; }
  [[nodiscard]] Status read(std::uint64_t offset, std::span<std::byte> out) override {
    ++reads_;
    for (std::byte& byte : out) byte = static_cast<std::byte>(offset++ % 251);
    return {};
  }

 private:
  std::uint64_t& reads_;
  std::string name_ = "counted";
};

TEST(BytesAhead, AreTakenFromMemoryWhileTheyLive) {
  std::uint64_t reads = 0;
  const auto source = std::make_shared<CountedSource>(std::make_unique<Counted>(reads));
  const auto read = [&](std::uint64_t offset, std::size_t count) {
    Bytes bytes(count);
    EXPECT_TRUE(source->read(offset, bytes));
    for (const std::byte byte : bytes) EXPECT_EQ(byte, static_cast<std::byte>(offset++ % 251));
  };
  auto ahead = test::value_of(BytesAhead::read(source, {{100, 200}, {5000, 6000}}, 2000));
  EXPECT_EQ(reads, 2U);
  EXPECT_EQ(source->bytes_read(), 1100U);
  read(100, 100), read(150, 50), read(5999, 1), read(5000, 1000);
  EXPECT_EQ(reads, 2U);
  read(99, 2), read(199, 2), read(4999, 1), read(6000, 1), read(150, 5000);
  EXPECT_EQ(reads, 7U);
  ahead.reset();
  read(150, 10);
  EXPECT_EQ(reads, 8U);
  EXPECT_EQ(test::value_of(BytesAhead::read(source, {{100, 200}, {5000, 6000}}, 1000)), nullptr) << "too much";
  EXPECT_EQ(reads, 8U);
}

}  // namespace
}  // namespace splatvol::format
