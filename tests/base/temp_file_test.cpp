#include "base/temp_file.h"

#include <gtest/gtest.h>

#include <array>
#include <vector>

#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

std::vector<std::byte> bytes_from(std::uint8_t first, std::size_t count) {
  std::vector<std::byte> bytes(count);
  for (std::size_t i = 0; i < count; ++i) bytes[i] = static_cast<std::byte>(first + i);
  return bytes;
}

TEST(TempFile, GivesBackWhatWasAppended) {
  auto file = value_of(TempFile::create(::testing::TempDir()));
  ASSERT_TRUE(file.append(bytes_from(1, 100)));
  ASSERT_TRUE(file.append(bytes_from(101, 50)));
  EXPECT_EQ(file.size(), 150u);
  std::vector<std::byte> read(20);
  ASSERT_TRUE(file.read(90, read));
  EXPECT_EQ(read, bytes_from(91, 20));
  EXPECT_FALSE(file.read(131, read));
  EXPECT_FALSE(file.read(~std::uint64_t{0}, read));
}

TEST(TempFile, HasNoName) {
  const TempFolder folder;
  auto file = value_of(TempFile::create(folder.path()));
  ASSERT_TRUE(file.append(bytes_from(0, 10)));
  EXPECT_TRUE(folder.names().empty());
}

TEST(TempFile, WhatWasReleasedReadsAsZerosAndTheRestStays) {
  auto file = value_of(TempFile::create(::testing::TempDir()));
  const std::vector<std::byte> part(1 << 16, std::byte{7});
  for (int i = 0; i < 4; ++i) ASSERT_TRUE(file.append(part));
  file.release(1 << 16, 1 << 16);
  EXPECT_EQ(file.size(), std::uint64_t{4} << 16);
  std::array<std::byte, 1> before, within, behind;
  ASSERT_TRUE(file.read((1 << 16) - 1, before));
  ASSERT_TRUE(file.read(1 << 16, within));
  ASSERT_TRUE(file.read(2 << 16, behind));
  EXPECT_EQ(before[0], std::byte{7});
  EXPECT_EQ(behind[0], std::byte{7});
  EXPECT_TRUE(within[0] == std::byte{0} || within[0] == std::byte{7});  // 7: the file system cannot
}

TEST(TempFile, FailsWithOneLineWhereItCannotBe) {
  const auto file = TempFile::create("/nonexistent");
  ASSERT_FALSE(file);
  EXPECT_EQ(file.error().code, ErrorCode::io);
  EXPECT_NE(file.error().message.find("/nonexistent"), std::string::npos);
  EXPECT_FALSE(free_disk_bytes("/nonexistent"));
  EXPECT_GT(free_disk_bytes(::testing::TempDir()).value(), 0u);
}

}  // namespace
}  // namespace splatvol::test
