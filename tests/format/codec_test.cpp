#include "format/codec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

namespace splatvol::format {
namespace {

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
      const auto unpacked = unpack(packed, raw.size(), "test");
      ASSERT_TRUE(unpacked) << unpacked.error().message;
      EXPECT_EQ(*unpacked, raw);
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
    const auto unpacked = unpack(packed, length, "chunk 7");
    ASSERT_FALSE(unpacked);
    EXPECT_THAT(unpacked.error().message, testing::AllOf(HasSubstr("chunk 7"), HasSubstr("[R7]")));
  }
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

}  // namespace
}  // namespace splatvol::format
