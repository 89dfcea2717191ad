#include "tests/support/fault_source.h"

#include <gtest/gtest.h>

#include <thread>

#include "tests/support/memory_source.h"

namespace splatvol::test {
namespace {

std::unique_ptr<ByteSource> source_of(const std::string& text) {
  return memory_source(std::as_bytes(std::span(text)), "memory");
}

std::string read(ByteSource& source, std::uint64_t offset, std::size_t count) {
  std::string out(count, '?');
  const Status status = source.read(offset, std::as_writable_bytes(std::span(out)));
  return status ? out : "failed";
}

TEST(FaultSource, FailsCorruptsAndRecovers) {
  const std::string digits = "0123456789";
  const auto faults = std::make_shared<Faults>(source_of(digits));
  FaultSource source(faults);
  faults->fail_read(1);
  EXPECT_EQ(read(source, 0, 4), "0123");
  EXPECT_EQ(read(source, 0, 4), "failed");
  EXPECT_EQ(read(source, 0, 4), "0123");

  faults->fail_range(5, 6);
  EXPECT_EQ(read(source, 0, 5), "01234");
  EXPECT_EQ(read(source, 0, 6), "failed");
  EXPECT_EQ(read(source, 5, 1), "failed");
  EXPECT_EQ(read(source, 6, 4), "6789");

  faults->corrupt_range(7, 9);
  EXPECT_EQ(read(source, 6, 4), (std::string{'6', static_cast<char>(~'7'), static_cast<char>(~'8'), '9'}));
  EXPECT_EQ(faults->reads(), 8u);
  EXPECT_EQ(faults->bytes(), 12u + 5 + 6 + 1 + 4 + 4);

  faults->clear();
  EXPECT_EQ(read(source, 0, 10), digits);
  const std::string letters = "abcdefghij";
  faults->replace(source_of(letters));
  EXPECT_EQ(read(source, 2, 3), "cde");
}

TEST(FaultSource, HoldsReadsUntilTheyAreReleased) {
  const std::string digits = "0123456789";
  const auto faults = std::make_shared<Faults>(source_of(digits));
  FaultSource source(faults);
  faults->hold();
  std::string first, second;
  std::thread one([&] { first = read(source, 0, 2); });
  std::thread two([&] { second = read(source, 2, 2); });
  faults->wait_for_held(2);
  EXPECT_EQ(first + second, "");
  faults->release();
  one.join();
  two.join();
  EXPECT_EQ(first + second, "0123");
}

}  // namespace
}  // namespace splatvol::test
