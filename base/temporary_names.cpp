#include "base/temporary_names.h"

#include <fcntl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdint>
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

// As the kernel gives it: readdir() would allocate, which a handler may not.
struct FolderEntry {
  std::uint64_t inode;
  std::int64_t offset;
  std::uint16_t bytes;
  std::uint8_t type;
  char name[1];
};
static_assert(offsetof(FolderEntry, name) == 19);

// Removes a folder with its files.
void remove_folder(const char* path) {
  const int folder = ::open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder < 0) return;
  alignas(FolderEntry) std::array<char, 4096> entries;
  for (long end = 0; (end = ::syscall(SYS_getdents64, folder, entries.data(), entries.size())) > 0;)
    for (long at = 0; at < end;) {
      const auto* entry = reinterpret_cast<const FolderEntry*>(&entries[static_cast<std::size_t>(at)]);
      ::unlinkat(folder, entry->name, 0);  // fails for "." and ".."
      at += entry->bytes;
    }
  ::close(folder);
  ::rmdir(path);
}

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
    if (::unlink(name) != 0 && errno == EISDIR) remove_folder(name);
    slot = name;
  }
}

}  // namespace splatvol
