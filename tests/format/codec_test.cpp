#include "format/codec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <random>

#include "tests/support/results.h"

namespace splatvol::test {
namespace {

using namespace format;
using testing::HasSubstr;

Bytes random_bytes(std::size_t count, std::uint32_t seed, int values = 256) {
  std::mt19937 random(seed);
  Bytes bytes(count);
  for (std::byte& byte : bytes) byte = static_cast<std::byte>(random() % static_cast<unsigned>(values));
  return bytes;
}

TEST(Codec, HashIsXxh3OfSeedZero) {
  EXPECT_EQ(hash_bytes({}), 0x2D06800538D394C2u);  // the published value for no bytes
}

TEST(Codec, UnpackUndoesPack) {
  for (const std::size_t count : {0, 1, 2, 63, 64, 1000, 65536}) {
    for (const int values : {1, 2, 16, 256}) {
      const Bytes raw = random_bytes(count, static_cast<std::uint32_t>(count), values);
      const Bytes packed = pack(raw);
      EXPECT_LE(packed.size(), raw.size());
      const auto unpacked = value_of(unpack(packed, raw.size(), "test"));
      EXPECT_EQ(unpacked, raw);
    }
  }
}

TEST(Codec, CompressesWhatCanBeCompressedAndStoresWhatCannot) {
  const Bytes few_values = random_bytes(10000, 1, 4);
  EXPECT_LT(pack(few_values).size(), 3500u);
  const Bytes noise = random_bytes(10000, 1);
  EXPECT_EQ(pack(noise), noise);
}

TEST(Codec, NeverWritesAFrameThatTheRatioForbids) {
  for (const std::size_t count : {100u, 10'000u, 100'000u, 10'000'000u}) {
    const Bytes zeros(count);
    const Bytes packed = pack(zeros);
    EXPECT_TRUE(packed.size() == count || count <= 1024 * packed.size() + 64);
    EXPECT_TRUE(unpack(packed, count, "test"));
  }
}

TEST(Codec, RefusesLengthsBeyondTheRatio) {
  const Bytes packed = pack(Bytes(1000));
  const std::uint64_t most = 1024 * packed.size() + 64;
  for (const std::uint64_t length : {most + 1, std::uint64_t{1} << 40, ~std::uint64_t{0}}) {
    EXPECT_THAT(message_of(unpack(packed, length, "chunk 7")), testing::AllOf(HasSubstr("chunk 7"), HasSubstr("[R7]")));
  }
}

TEST(Codec, BlocksHaveTheirOwnStatistics) {
  Bytes raw = random_bytes(4000, 1, 4);
  for (std::size_t i = 2000; i < raw.size(); ++i) raw[i] |= std::byte{0xf0};
  const std::vector<std::vector<std::size_t>> ways = {{}, {2000}, {0, 0, 10, 2000, 2000, 3990, 4000, 4000}};
  std::vector<std::size_t> sizes;
  for (const std::vector<std::size_t>& ends : ways) {
    const Bytes packed = pack_blocks(raw, ends);
    sizes.push_back(packed.size());
    EXPECT_EQ(value_of(unpack(packed, raw.size(), "test")), raw);
  }
  EXPECT_LT(sizes[1], sizes[0]);
  EXPECT_EQ(sizes[2], sizes[1]);  // short blocks are joined
}

TEST(Codec, RefusesEveryOtherLengthThanTheFrames) {
  const Bytes packed = pack(Bytes(200));
  for (std::uint64_t length = packed.size() + 1; length < 400; ++length)
    EXPECT_EQ(unpack(packed, length, "test").has_value(), length == 200) << length;
  for (std::uint64_t length = 0; length < packed.size(); ++length) EXPECT_FALSE(unpack(packed, length, "test"));
}

TEST(Codec, RefusesEveryTruncationOfAFrame) {
  const Bytes raw = random_bytes(3000, 5, 8);
  const Bytes packed = pack(raw);
  for (std::size_t length = 0; length < packed.size(); ++length) {
    const Bytes part(packed.begin(), packed.begin() + static_cast<std::ptrdiff_t>(length));
    EXPECT_FALSE(unpack(part, raw.size(), "test")) << length;
  }
}

TEST(Codec, PlanesHoldTheLowestBytesFirst) {
  const std::vector<std::uint32_t> numbers = {0x04030201, 0x14131211};
  Bytes planes;
  append_planes<std::uint32_t>(planes, numbers, 3);
  EXPECT_EQ(planes, (Bytes{std::byte{0x01}, std::byte{0x11}, std::byte{0x02}, std::byte{0x12}, std::byte{0x03},
                           std::byte{0x13}}));
  std::vector<std::uint32_t> back(2, 0xFFFFFFFF);
  read_planes<std::uint32_t>(planes, back, 3);
  EXPECT_EQ(back, (std::vector<std::uint32_t>{0x030201, 0x131211}));
}

TEST(Codec, PlanesOfEveryWidthComeBack) {
  std::mt19937_64 random(3);
  for (std::size_t width = 0; width <= 8; ++width) {
    const std::uint64_t mask = width == 8 ? ~std::uint64_t{0} : (std::uint64_t{1} << (8 * width)) - 1;
    std::vector<std::uint64_t> numbers(100), back(100, 1);
    for (std::uint64_t& number : numbers) number = random() & mask;
    Bytes planes;
    append_planes<std::uint64_t>(planes, numbers, width);
    EXPECT_EQ(planes.size(), 100 * width);
    read_planes<std::uint64_t>(planes, back, width);
    EXPECT_EQ(back, numbers);
  }
}

// --- From front to back.

// A zstd frame of blocks that repeat a byte. `window`: its descriptor (RFC 8878); none: the window is all of it.
Bytes frame_of_runs(std::span<const std::byte> raw, std::optional<std::uint8_t> window) {
  Bytes frame;
  append_record(frame, std::uint32_t{0xFD2FB528});
  append_record(frame, static_cast<std::uint8_t>(window ? 0xC0 : 0xE0));
  if (window) append_record(frame, *window);
  append_record(frame, std::uint64_t{raw.size()});
  constexpr std::size_t longest = 1000;
  for (std::size_t at = 0, count = 0; at < raw.size(); at += count) {
    for (count = 1; count < longest && at + count < raw.size() && raw[at + count] == raw[at];) ++count;
    const auto head = static_cast<std::uint32_t>(count << 3 | 1U << 1 | (at + count == raw.size() ? 1 : 0));
    for (int byte = 0; byte < 3; ++byte) append_record(frame, static_cast<std::uint8_t>(head >> 8 * byte));
    frame.push_back(raw[at]);
  }
  return frame;
}

constexpr std::uint8_t window_of_8_mib = 0x68, window_of_16_mib = 0x70;

Result<Bytes> unpack_in_pieces(const Bytes& packed, std::size_t bytes, std::size_t piece) {
  Unpacker unpacker(packed, bytes, "test");
  Bytes raw(bytes);
  for (std::size_t at = 0; at < bytes; at += piece)
    SPLATVOL_TRY(unpacker.read(std::span(raw).subspan(at, std::min(piece, bytes - at))));
  SPLATVOL_TRY(unpacker.finish());
  return raw;
}

TEST(Unpacker, GivesWhatUnpackGives) {
  Bytes raw(300'000);
  for (std::size_t i = 0; i < raw.size(); ++i) raw[i] = static_cast<std::byte>(i / 7 % 251 * (i / 100'000));
  for (const Bytes& packed : {pack(raw), raw, frame_of_runs(raw, window_of_8_mib)}) {
    for (const std::size_t piece : {1, 1000, 131'072, 300'000})
      EXPECT_EQ(unpack_in_pieces(packed, raw.size(), piece), raw);
    Unpacker unpacker(packed, raw.size(), "test");
    Bytes part(100);
    for (const std::size_t at : {5, 105, 70'000, 299'900}) {
      ASSERT_TRUE(unpacker.skip_to(at));
      ASSERT_TRUE(unpacker.read(part));
      EXPECT_TRUE(std::ranges::equal(part, std::span(raw).subspan(at, part.size())));
    }
    EXPECT_TRUE(unpacker.finish());
    EXPECT_FALSE(unpacker.read(part)) << "behind the end";
  }
}

TEST(Unpacker, FindsDamage) {
  Bytes raw(3000, std::byte{1});
  raw[1500] = std::byte{7};
  const Bytes packed = pack(raw);
  ASSERT_LT(packed.size(), raw.size());
  for (std::size_t size = 0; size < packed.size(); ++size)
    EXPECT_FALSE(unpack_in_pieces(Bytes(packed.begin(), packed.begin() + static_cast<std::ptrdiff_t>(size)), 3000, 64));
  Bytes longer = packed;
  longer.push_back(std::byte{0});
  EXPECT_FALSE(unpack_in_pieces(longer, 3000, 64));
  longer = packed;
  longer.insert(longer.end(), packed.begin(), packed.end());
  EXPECT_FALSE(unpack_in_pieces(longer, 3000, 64)) << "two frames";
  EXPECT_FALSE(unpack_in_pieces(packed, 2999, 64));
  EXPECT_FALSE(unpack_in_pieces(packed, 3001, 64));
}

TEST(Unpacker, TakesNoLargeWindow) {
  const Bytes raw(std::size_t{17} << 20, std::byte{1});
  EXPECT_EQ(unpack_in_pieces(frame_of_runs(raw, window_of_8_mib), raw.size(), 1 << 20), raw);
  for (const auto window : {std::optional(window_of_16_mib), std::optional<std::uint8_t>()}) {
    EXPECT_NE(message_of(unpack_in_pieces(frame_of_runs(raw, window), raw.size(), 1 << 20)).find("window"),
              std::string::npos);
  }
}

}  // namespace
}  // namespace splatvol::test
