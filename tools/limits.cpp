#include "tools/limits.h"

#include <malloc.h>
#include <pthread.h>
#include <sys/resource.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "base/memory_limit.h"

namespace splatvol {
namespace {

constexpr std::uint64_t mebibyte = std::uint64_t{1} << 20;
constexpr std::uint64_t least_bytes = 16 * mebibyte;  // that must be free
constexpr std::uint64_t much = 1024 * mebibyte;
constexpr std::size_t tried_stack = mebibyte / 8;
constexpr std::size_t small_stack = 2 * mebibyte;     // of all other threads, if address space is scarce
constexpr std::uint64_t worker_bytes = 8 * mebibyte;  // its stack, and what it keeps for itself
constexpr std::size_t other_threads = 12;             // that read, and those of a graphics driver

// Whether a control group that this process is in, or one above it, limits the number of threads.
bool group_limits_threads() {
  namespace fs = std::filesystem;
  std::ifstream groups("/proc/self/cgroup");
  for (std::string line; std::getline(groups, line);) {  // NUMBER:CONTROLLERS:PATH; version 2 names no controllers
    const std::size_t controllers = line.find(':') + 1, path = line.find(':', controllers) + 1;
    const bool is_v1 = line.compare(controllers, path - controllers, "pids:") == 0;
    if (!is_v1 && path - controllers != 1) continue;
    const fs::path root = is_v1 ? "/sys/fs/cgroup/pids" : "/sys/fs/cgroup";
    for (fs::path group = line.substr(path); !group.empty(); group = group == "/" ? fs::path() : group.parent_path()) {
      std::uint64_t most = 0;
      if (std::ifstream(root / group.relative_path() / "pids.max") >> most) return true;  // it says "max" without one
    }
  }
  return false;
}

bool are_threads_limited() {
  rlimit limit{};
  return ::getrlimit(RLIMIT_NPROC, &limit) != 0 || limit.rlim_cur != RLIM_INFINITY || group_limits_threads();
}

void* wait_for_unlock(void* mutex) {
  const std::lock_guard lock(*static_cast<std::mutex*>(mutex));
  return nullptr;
}

// Starts so many threads at once, or as many as the system allows, and returns their number. glibc keeps the stacks of
// ended threads, so these are small.
std::size_t startable_threads(std::size_t wanted) {
  std::mutex running;
  std::vector<pthread_t> threads;
  threads.reserve(wanted);
  pthread_attr_t attributes;
  ::pthread_attr_init(&attributes);
  ::pthread_attr_setstacksize(&attributes, tried_stack);
  {
    const std::lock_guard lock(running);
    for (pthread_t thread{}; threads.size() < wanted; threads.push_back(thread))
      if (::pthread_create(&thread, &attributes, wait_for_unlock, &running) != 0) break;
  }
  for (const pthread_t thread : threads) ::pthread_join(thread, nullptr);
  ::pthread_attr_destroy(&attributes);
  return threads.size();
}

// glibc takes 64 MiB of address space for each thread's pool, and 8 MiB for its stack.
void save_address_space(std::uint64_t free) {
  ::mallopt(M_ARENA_MAX, static_cast<int>(std::clamp<std::uint64_t>(free / much, 1, 1024)));
  if (free > much) return;
  pthread_attr_t attributes;
  ::pthread_attr_init(&attributes);
  ::pthread_attr_setstacksize(&attributes, small_stack);
  ::pthread_setattr_default_np(&attributes);
  ::pthread_attr_destroy(&attributes);
}

// TBB starts its threads when they are needed, and ends the program if one does not start.
void limit_workers(std::size_t workers) {
  static const auto* const limit = new tbb::global_control(tbb::global_control::max_allowed_parallelism,
                                                           workers + 1);  // for the program's whole life
  (void)limit;
}

}  // namespace

Status heed_limits(unsigned most_threads) {
  const std::uint64_t free = free_address_space();
  std::size_t workers = std::max(1u, std::thread::hardware_concurrency()) - 1;
  const std::size_t wanted = workers;
  if (free != unlimited_address_space) {
    if (free < least_bytes)
      return fail(ErrorCode::out_of_budget, "{} MiB more of address space are needed: raise the limit (ulimit -v)",
                  (least_bytes - free + mebibyte - 1) / mebibyte);
    save_address_space(free);
    // An eighth of the space: the rest is for data.
    workers = std::min<std::size_t>(workers, free / 8 / worker_bytes);
  }
  if (are_threads_limited()) {
    const std::size_t started = startable_threads(workers + other_threads);
    if (started < workers + other_threads) workers = std::min(workers, started / 4);
  }
  if (most_threads > 0) workers = std::min<std::size_t>(workers, most_threads - 1);
  if (workers < wanted) limit_workers(workers);
  return {};
}

}  // namespace splatvol
