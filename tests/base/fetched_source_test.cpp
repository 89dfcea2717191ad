// Bytes that come between two tries.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <random>
#include <vector>

#include "base/fetched_source.h"
#include "tests/support/results.h"

namespace splatvol::test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

struct Fetched : testing::Test {
  [[nodiscard]] static std::vector<std::byte> content(const ByteRange& range) {
    std::vector<std::byte> bytes;
    for (std::uint64_t at = range.begin; at < range.end; ++at) bytes.push_back(static_cast<std::byte>(at % 251));
    return bytes;
  }
  void deliver(const ByteRange& range) { source.deliver(range, content(range)); }
  void deliver_all() {
    for (const ByteRange& range : source.take_wanted()) deliver(range);
  }
  [[nodiscard]] Status read(const ByteRange& range) {
    std::vector<std::byte> bytes(range.end - range.begin);
    const Status status = source.read(range.begin, bytes);
    if (status) EXPECT_EQ(bytes, content(range));
    return status;
  }
  [[nodiscard]] bool has(const ByteRange& range) { return !is_pending(read(range)); }

  FetchedSource source{"flow.svol", 10'000, 1000};
};

TEST_F(Fetched, AreWantedOnceAndReadWhenTheyHaveCome) {
  EXPECT_FALSE(has({100, 200}));
  EXPECT_FALSE(has({100, 200}));
  EXPECT_FALSE(has({150, 300})) << "a part is on its way";
  EXPECT_FALSE(source.prefetch(std::vector<ByteRange>{{0, 50}, {100, 120}}));
  EXPECT_THAT(source.take_wanted(), ElementsAre(ByteRange{100, 200}, ByteRange{200, 300}, ByteRange{0, 50}));
  EXPECT_TRUE(source.take_wanted().empty());
  EXPECT_TRUE(source.is_waiting());

  // In any order, also twice, or what nobody asked for.
  deliver({200, 300});
  EXPECT_FALSE(has({100, 300}));
  deliver({0, 50});
  deliver({100, 200});
  deliver({100, 200});
  deliver({5000, 5001});
  EXPECT_FALSE(source.is_waiting());
  EXPECT_TRUE(has({100, 300}));
  EXPECT_TRUE(has({110, 250}));
  EXPECT_TRUE(source.prefetch(std::vector<ByteRange>{{0, 50}, {100, 300}}));
  EXPECT_EQ(source.held_bytes(), 250U);
  EXPECT_TRUE(source.take_wanted().empty());

  EXPECT_FALSE(has({40, 110}));
  EXPECT_THAT(source.take_wanted(), ElementsAre(ByteRange{50, 100})) << "the gap";
  EXPECT_EQ(read({9'999, 10'001}).error().code, ErrorCode::invalid_data);
}

TEST_F(Fetched, StayWhileTheirOperationLives) {
  {
    FetchedBytes bytes;
    const FetchedBytes::Scope scope(&bytes);
    for (std::uint64_t begin = 0; begin < 5000; begin += 500) {
      EXPECT_FALSE(has({begin, begin + 500}));
      deliver_all();
    }
    EXPECT_EQ(source.held_bytes(), 5000U) << "more than is held else";
    EXPECT_TRUE(has({0, 5000}));
  }
  EXPECT_FALSE(has({6000, 6100}));
  deliver_all();
  EXPECT_EQ(source.held_bytes(), 600U) << "those that were used last, up to 1000";
  EXPECT_TRUE(has({6000, 6100}));
  EXPECT_TRUE(has({4500, 5000}));
  EXPECT_FALSE(has({0, 500}));
}

TEST_F(Fetched, FailOnce) {
  EXPECT_FALSE(has({0, 100}));
  const std::vector<ByteRange> wanted = source.take_wanted();
  source.refuse(wanted[0], {ErrorCode::io, "flow.svol: the server has gone"});
  EXPECT_FALSE(source.is_waiting());
  EXPECT_TRUE(source.prefetch(wanted)) << "a read tells the error";
  EXPECT_THAT(message_of(read({50, 60})), HasSubstr("the server has gone"));
  EXPECT_FALSE(has({50, 60}));
  deliver_all();
  EXPECT_TRUE(has({50, 60}));
}

// Against a plain list of the bytes that have come.
TEST_F(Fetched, AreThoseOfTheFile) {
  std::mt19937 random(1);
  FetchedBytes bytes;
  const FetchedBytes::Scope scope(&bytes);
  std::vector<bool> is_there(10'000);
  std::vector<ByteRange> on_their_way;
  for (int i = 0; i < 3000; ++i) {
    const std::uint64_t begin = random() % 9'900, end = begin + 1 + random() % 100;
    bool has_all = true;
    for (std::uint64_t at = begin; at < end; ++at) has_all = has_all && is_there[at];
    ASSERT_EQ(has({begin, end}), has_all) << begin << " to " << end;
    for (const ByteRange& range : source.take_wanted()) on_their_way.push_back(range);
    if (on_their_way.empty() || i % 3 != 0) continue;
    std::swap(on_their_way[random() % on_their_way.size()], on_their_way.back());
    const ByteRange range = on_their_way.back();
    on_their_way.pop_back();
    for (std::uint64_t at = range.begin; at < range.end; ++at) {
      ASSERT_FALSE(is_there[at]) << "none is fetched twice";
      is_there[at] = true;
    }
    deliver(range);
  }
}

}  // namespace
}  // namespace splatvol::test
