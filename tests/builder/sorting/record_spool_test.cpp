#include "builder/sorting/record_spool.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "tests/format/allocation_counter.h"
#include "tests/support/bad_disk.h"

namespace splatvol::test {
namespace {

using Bytes = std::vector<std::byte>;

Bytes noise(std::size_t bytes) {
  std::mt19937 random(1);
  Bytes result(bytes);
  for (std::byte& b : result) b = static_cast<std::byte>(random());
  return result;
}

Bytes read_all(RecordSpool& spool) {
  Bytes all;
  for (;;) {
    const std::span<const std::byte> records = spool.next().value();
    if (records.empty()) return all;
    all.insert(all.end(), records.begin(), records.end());
  }
}

TEST(RecordSpool, GivesBackWhatWasAppended) {
  for (const std::size_t record_bytes : {1u, 12u, 17u, 232u, 5000u})
    for (const std::size_t memory : {0u, 10'000u, 200'000u, 10'000'000u})
      for (const std::size_t count : {0u, 1u, 129u, 500u}) {
        RecordSpool spool(record_bytes, memory, ::testing::TempDir());
        const Bytes records = noise(count * record_bytes);
        std::size_t added = 0;
        for (std::size_t piece = 1; added < records.size(); piece = piece * 3 % 101) {
          const std::size_t bytes = std::min(piece * record_bytes, records.size() - added);
          ASSERT_TRUE(spool.append(std::span(records).subspan(added, bytes)));
          added += bytes;
        }
        EXPECT_EQ(spool.count(), count);
        EXPECT_EQ(read_all(spool), records) << record_bytes << ", " << memory << ", " << count;
        EXPECT_TRUE(spool.next().value().empty());
      }
}

TEST(RecordSpool, NeedsNoFolderForWhatFitsIntoMemory) {
  RecordSpool spool(16, 100'000, "/nonexistent");
  ASSERT_TRUE(spool.append(noise(16 * 1000)));
  EXPECT_EQ(read_all(spool), noise(16 * 1000));

  RecordSpool larger(16, 100'000, "/nonexistent");
  const Status status = larger.append(noise(16 * 10'000));
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().code, ErrorCode::io);
  EXPECT_EQ(status.error().message.find("/nonexistent: "), 0u);
}

TEST(RecordSpool, HoldsNoMoreThanItMay) {
  const Bytes records = noise(32 * 50'000);
  for (const std::size_t memory : {10'000u, 100'000u, 1'000'000u}) {
    start_counting_allocations();
    RecordSpool spool(32, memory, ::testing::TempDir());
    ASSERT_TRUE(spool.append(records));
    while (!spool.next().value().empty()) {
    }
    EXPECT_LE(most_bytes_allocated(), memory + 16384);  // and what threads hold
  }
}

TEST(RecordSpool, ABadDiskIsSeen) {
  const Bytes records = noise(24 * 20'000);
  for (int eighth = 0; eighth < 8; ++eighth) {
    RecordSpool spool(24, 20'000, ::testing::TempDir());
    ASSERT_TRUE(spool.append(records));
    ASSERT_EQ(damage_temporary_files(eighth / 8.0), 1u);
    for (;;) {
      const auto next = spool.next();
      if (!next) {
        EXPECT_NE(next.error().message.find("is the disk faulty"), std::string::npos);
        break;
      }
      ASSERT_FALSE(next->empty()) << "nobody saw it: " << eighth;
    }
  }
}

// Differences of every width, and groups that are not full.
TEST(RecordPackets, PackEveryWidthOfDifferencesAndCount) {
  std::mt19937 random(2);
  for (unsigned width = 0; width <= 32; ++width)
    for (const std::size_t count : {1u, 2u, 3u, 127u, 128u, 129u, 1000u}) {
      const std::uint32_t mask = width == 32 ? ~0u : (1u << width) - 1;
      std::vector<std::uint32_t> numbers(count);
      for (std::uint32_t& number : numbers) number = (static_cast<std::uint32_t>(random()) & mask) + (1234567u & ~mask);
      const auto bytes = std::as_bytes(std::span(numbers));
      Bytes packed(packet_bound(count, 4));
      const auto locate = [&](std::size_t first, std::span<const std::byte*> located) {
        for (std::size_t i = 0; i < located.size(); ++i) located[i] = bytes.data() + 4 * (first + i);
      };
      const std::size_t size = pack_records(count, locate, 4, packed);
      ASSERT_LE(size + 8, packed.size());
      // A full group has its width, its minimum, and no more bits for each number than the width.
      EXPECT_TRUE(count != 128 || size <= 16 + 5 + 128 * width / 8) << width;

      auto file = TempFile::create(::testing::TempDir()).value();
      ASSERT_TRUE(file.append(std::span(packed).first(size)));
      Bytes buffer(packet_bound(count, 4)), unpacked(4 * count);
      PacketReader reader(file, 0, file.size(), 4, buffer);
      EXPECT_EQ(reader.next(unpacked).value(), count);
      EXPECT_EQ(std::memcmp(unpacked.data(), bytes.data(), bytes.size()), 0) << width << ", " << count;
      EXPECT_EQ(reader.next(unpacked).value(), 0u);
    }
}

// Floats of both signs, zeros, infinities and NaN come back with every bit.
TEST(RecordPackets, KeepEveryBit) {
  const float inf = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<float> values = {0.0f, -0.0f, inf, -inf, nan, -nan, 1e-45f, 3e38f, -1.0f, 1.0f};
  RecordSpool spool(20, 0, ::testing::TempDir());
  ASSERT_TRUE(spool.append(std::as_bytes(std::span(values))));
  const Bytes read = read_all(spool);
  ASSERT_EQ(read.size(), 40u);
  EXPECT_EQ(std::memcmp(read.data(), values.data(), 40), 0);
}

TEST(RecordPackets, RefuseOtherBytes) {
  auto file = TempFile::create(::testing::TempDir()).value();
  ASSERT_TRUE(file.append(Bytes(100, std::byte{0xFF})));
  Bytes buffer(1000), unpacked(1000);
  PacketReader reader(file, 0, file.size(), 4, buffer);
  EXPECT_FALSE(reader.next(unpacked));
}

}  // namespace
}  // namespace splatvol::test
