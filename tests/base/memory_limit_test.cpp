#include "base/memory_limit.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include "tests/support/sanitizers.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

constexpr std::uint64_t gibibyte = std::uint64_t{1} << 30;

/// A folder with /proc and /sys of a machine of 8 GiB.
struct MemoryLimit : FolderTest {
  MemoryLimit() { write("proc/meminfo", "MemTotal:        8388608 kB\nMemFree:         1000 kB\n"); }
};

TEST_F(MemoryLimit, IsTheMachinesMemoryWithoutGroups) {
  EXPECT_EQ(memory_limit(folder_), 8 * gibibyte);
  write("proc/self/cgroup", "0::/user/session\nnonsense\n:\n");
  EXPECT_EQ(memory_limit(folder_), 8 * gibibyte);
  write("sys/fs/cgroup/user/session/memory.max", "max\n");
  EXPECT_EQ(memory_limit(folder_), 8 * gibibyte);
}

TEST_F(MemoryLimit, IsTheLeastOfTheGroupsAbove) {
  write("proc/self/cgroup", "0::/user/session/job\n");
  write("sys/fs/cgroup/user/session/job/memory.max", "max\n");
  write("sys/fs/cgroup/user/session/memory.max", "2147483648\n");
  write("sys/fs/cgroup/user/memory.max", "3221225472\n");
  write("sys/fs/cgroup/other/memory.max", "4096\n");
  EXPECT_EQ(memory_limit(folder_), 2 * gibibyte);
  write("sys/fs/cgroup/user/session/job/memory.max", "1073741824\n");
  EXPECT_EQ(memory_limit(folder_), gibibyte);
}

TEST_F(MemoryLimit, KnowsTheFirstVersionOfGroups) {
  write("proc/self/cgroup", "9:name=systemd:/\n4:cpuset,memory:/job\n1:cpu:/small\n0::/job\n");
  write("sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n");
  write("sys/fs/cgroup/memory/small/memory.limit_in_bytes", "4096\n");
  EXPECT_EQ(memory_limit(folder_), 8 * gibibyte) << "what stands for no limit is above the machine's memory";
  write("sys/fs/cgroup/memory/job/memory.limit_in_bytes", "3221225472\n");
  EXPECT_EQ(memory_limit(folder_), 3 * gibibyte);
  write("sys/fs/cgroup/unified/job/memory.max", "1073741824\n");
  EXPECT_EQ(memory_limit(folder_), gibibyte) << "both versions at once";
}

TEST_F(MemoryLimit, AContainerSeesItsOwnGroupAsTheRoot) {
  write("proc/self/cgroup", "4:memory:/docker/0123456789abcdef\n");
  write("sys/fs/cgroup/memory/memory.limit_in_bytes", "1073741824\n");
  EXPECT_EQ(memory_limit(folder_), gibibyte);
}

TEST(MemoryLimitHere, IsNoMoreThanTheMachineHas) {
  const auto pages = static_cast<std::uint64_t>(::sysconf(_SC_PHYS_PAGES));
  EXPECT_LE(memory_limit(), pages * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE)) + gibibyte / 1024);
  EXPECT_GT(memory_limit(), 16u << 20);
}

TEST_F(MemoryLimit, TheProcessesOwnLimitsCount) {
  if (is_sanitized) GTEST_SKIP() << "sanitizers take more than the limit";
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_DATA, &before), 0);
  rlimit lower = before;
  lower.rlim_cur = gibibyte / 2;
  ASSERT_EQ(::setrlimit(RLIMIT_DATA, &lower), 0);
  const std::uint64_t limit = memory_limit(folder_);
  ASSERT_EQ(::setrlimit(RLIMIT_DATA, &before), 0);
  EXPECT_EQ(limit, gibibyte / 2);
}

TEST_F(MemoryLimit, WhatTheProgramTakesIsNotLeft) {
  if (is_sanitized) GTEST_SKIP() << "sanitizers take more than the limit";
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_DATA, &before), 0);
  rlimit lower = before;
  lower.rlim_cur = gibibyte;
  ASSERT_EQ(::setrlimit(RLIMIT_DATA, &lower), 0);
  const auto page = static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
  write("proc/self/statm", "900 5 5 5 0 100 0\n");
  const std::uint64_t limit = memory_limit(folder_);
  write("proc/self/statm", "9000000 5 5 5 0 1000000 0\n");
  const std::uint64_t nothing = memory_limit(folder_);
  ASSERT_EQ(::setrlimit(RLIMIT_DATA, &before), 0);
  EXPECT_EQ(limit, gibibyte - 100 * page);
  EXPECT_EQ(nothing, 0u);
}

TEST(Addressable, EndsWithTheAddressSpace) {
  EXPECT_TRUE(is_addressable(0));
  EXPECT_TRUE(is_addressable(gibibyte));
  EXPECT_FALSE(is_addressable(std::uint64_t{1} << 60));
}

}  // namespace
}  // namespace splatvol::test
