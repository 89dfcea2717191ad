#include "base/memory_limit.h"

#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <limits>

namespace splatvol {
namespace {

constexpr std::uint64_t no_limit = std::numeric_limits<std::uint64_t>::max();

std::uint64_t machine_bytes(const std::string& root) {
  std::ifstream file(root + "/proc/meminfo");
  std::string word;
  std::uint64_t kibibytes = 0;
  while (file >> word)
    if (word == "MemTotal:" && file >> kibibytes) return kibibytes << 10;
  return static_cast<std::uint64_t>(::sysconf(_SC_PHYS_PAGES)) * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
}

/// Returns the smallest number in the files `name` of all folders from `folder` / `group` up to `folder`. Folders may
/// be missing: in a container, the group's path may be that of the host. No std::filesystem::path: that of libstdc++ 12
/// frees twice if memory runs out.
std::uint64_t least_of_groups(const std::string& folder, std::string group, const std::string& name) {
  std::uint64_t least = no_limit;
  for (;; group.resize(std::min(group.rfind('/'), group.size() - 1))) {
    std::uint64_t bytes = 0;
    // "max" is not a number
    if (std::ifstream(fmt::format("{}/{}/{}", folder, group, name)) >> bytes) least = std::min(least, bytes);
    if (group.empty()) return least;
  }
}

/// Bytes of address space and of data that the process has. Zeros without /proc.
struct Taken {
  std::uint64_t all = 0, data = 0;
};

Taken taken_bytes(const std::string& root) {
  std::ifstream file(root + "/proc/self/statm");
  std::array<std::uint64_t, 6> pages{};  // size, resident, shared, text, always 0, data and stacks
  for (std::uint64_t& number : pages) file >> number;
  const auto page = static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
  return {pages[0] * page, pages[5] * page};
}

/// What a limit leaves beside the bytes that are taken.
std::uint64_t left_of(__rlimit_resource kind, std::uint64_t taken) {
  rlimit limit{};
  if (::getrlimit(kind, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) return no_limit;
  return limit.rlim_cur > taken ? limit.rlim_cur - taken : 0;
}

/// What the process itself may have.
std::uint64_t process_limit(const std::string& root) {
  const Taken taken = taken_bytes(root);
  return std::min(left_of(RLIMIT_AS, taken.all), left_of(RLIMIT_DATA, taken.data));
}

/// Whether "memory" is one of the names, which are separated by commas.
bool names_memory(const std::string& controllers) {
  return ("," + controllers + ",").find(",memory,") != std::string::npos;
}

}  // namespace

std::uint64_t memory_limit(const std::string& root) {
  std::uint64_t limit = std::min(machine_bytes(root), process_limit(root));
  const std::string groups = root + "/sys/fs/cgroup";
  std::ifstream file(root + "/proc/self/cgroup");
  for (std::string line; std::getline(file, line);) {  // hierarchy:controllers:group
    const std::size_t first = line.find(':'), second = line.find(':', first + 1);
    if (first == std::string::npos || second == std::string::npos) continue;
    const std::string controllers = line.substr(first + 1, second - first - 1), group = line.substr(second + 1);
    if (controllers.empty())
      for (const std::string& folder : {groups, groups + "/unified"})
        limit = std::min(limit, least_of_groups(folder, group, "memory.max"));
    if (names_memory(controllers))
      limit = std::min(limit, least_of_groups(groups + "/memory", group, "memory.limit_in_bytes"));
  }
  return limit;
}

std::uint64_t free_address_space() { return left_of(RLIMIT_AS, taken_bytes("").all); }

bool is_addressable(std::uint64_t bytes) {
  if (bytes == 0) return true;
  void* space = ::mmap(nullptr, bytes, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (space == MAP_FAILED) return false;
  ::munmap(space, bytes);
  return true;
}

}  // namespace splatvol
