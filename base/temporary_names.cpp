#include "base/temporary_names.h"

#include <unistd.h>

#include <array>
#include <atomic>
#include <cstdlib>
#include <cstring>
#include <mutex>

namespace splatvol {
namespace {

// A handler may run at any moment and may not wait: so each name is a pointer that is set and taken at once. Threads
// wait for each other.
std::mutex mutex;
constinit std::array<std::atomic<char*>, 64> names{};
static_assert(std::atomic<char*>::is_always_lock_free);

}  // namespace

void note_temporary(const std::string& path) {
  const std::lock_guard lock(mutex);
  char* name = ::strdup(path.c_str());
  for (std::atomic<char*>& slot : names) {
    char* empty = nullptr;
    if (name && slot.compare_exchange_strong(empty, name)) return;
  }
  std::free(name);
}

void forget_temporary(const std::string& path) {
  const std::lock_guard lock(mutex);
  for (std::atomic<char*>& slot : names) {
    char* name = slot.load();
    if (!name || path != name || !slot.compare_exchange_strong(name, nullptr)) continue;
    std::free(name);
    return;
  }
}

void remove_temporaries() {
  for (std::atomic<char*>& slot : names) {
    char* name = slot.exchange(nullptr);  // nobody frees it meanwhile
    if (!name) continue;
    ::unlink(name);
    slot = name;
  }
}

}  // namespace splatvol
