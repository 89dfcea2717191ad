#include "base/temporary_names.h"

#include <fcntl.h>
#include <fmt/format.h>
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
#include <new>
#include <random>

#include "base/file.h"

namespace splatvol {
namespace {

// A handler may run at any moment and may not wait: so each name is a pointer that is set and taken at once, and the
// list only grows. Threads wait for each other.
struct Slot {
  std::atomic<char*> name;
  Slot* next;
};
std::mutex mutex;
constinit std::atomic<Slot*> slots{};
static_assert(std::atomic<char*>::is_always_lock_free && std::atomic<Slot*>::is_always_lock_free);

#ifdef __linux__
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
#else
void remove_folder(const char* path) { ::rmdir(path); }
#endif

}  // namespace

std::string temporary_name_beside(const std::string& path) {
  std::random_device random;
  return fmt::format("{}/.splatvol-{:08x}{:08x}", folder_of(path), random(), random());
}

void note_temporary(const std::string& path) {
  const std::lock_guard lock(mutex);
  char* name = ::strdup(path.c_str());
  if (!name) return;
  for (Slot* slot = slots; slot; slot = slot->next) {
    char* empty = nullptr;
    if (slot->name.compare_exchange_strong(empty, name)) return;
  }
  Slot* slot = new (std::nothrow) Slot{name, slots};
  if (slot)
    slots = slot;
  else
    std::free(name);
}

void forget_temporary(const std::string& path) {
  const std::lock_guard lock(mutex);
  for (Slot* slot = slots; slot; slot = slot->next) {
    char* name = slot->name.load();
    if (!name || path != name || !slot->name.compare_exchange_strong(name, nullptr)) continue;
    std::free(name);
    return;
  }
}

bool is_noted_temporary(const std::string& path) {
  const std::lock_guard lock(mutex);
  for (Slot* slot = slots; slot; slot = slot->next)
    if (const char* name = slot->name; name && path == name) return true;
  return false;
}

void remove_temporaries() {
  for (Slot* slot = slots; slot; slot = slot->next) {
    char* name = slot->name.exchange(nullptr);  // nobody frees it meanwhile
    if (!name) continue;
    if (::unlink(name) != 0 && errno == EISDIR) remove_folder(name);
    slot->name = name;
  }
}

}  // namespace splatvol
