// To be preloaded: memory runs out. `operator new` refuses the n-th block that `main` and its threads ask for, and all
// later ones, where n is SPLATVOL_FAIL_AT. Blocks smaller than SPLATVOL_FAIL_LEAST bytes do not count. With
// SPLATVOL_FAIL_ONCE it refuses the n-th block only.
#include <dlfcn.h>

#include <atomic>
#include <cstddef>
#include <cstdlib>
#include <new>

namespace {

using Main = int (*)(int, char**, char**);
using StartMain = int (*)(Main, int, char**, void (*)(), void (*)(), void (*)(), void*);

Main program_main = nullptr;
std::atomic<bool> counts = false;
std::atomic<long> left = 0;
std::size_t least_bytes = 0;
bool once = false;

long number_of(const char* name, long otherwise) {
  const char* text = std::getenv(name);
  return text ? std::strtol(text, nullptr, 10) : otherwise;
}

// Libraries prepare themselves before `main`: no program can tell of an error there.
int counted_main(int argc, char** argv, char** environment) {
  left = number_of("SPLATVOL_FAIL_AT", 0x7fffffffL);
  least_bytes = static_cast<std::size_t>(number_of("SPLATVOL_FAIL_LEAST", 0));
  once = std::getenv("SPLATVOL_FAIL_ONCE") != nullptr;
  counts = true;
  const int code = program_main(argc, argv, environment);
  counts = false;
  return code;
}

bool is_refused(std::size_t bytes) {
  if (!counts || bytes < least_bytes) return false;
  const long before = left--;
  return once ? before == 0 : before <= 0;
}

void* allocate(std::size_t bytes, std::size_t alignment = 0) {
  if (is_refused(bytes)) return nullptr;
  if (bytes == 0) bytes = 1;
  return alignment == 0 ? std::malloc(bytes)
                        : std::aligned_alloc(alignment, (bytes + alignment - 1) & ~(alignment - 1));
}

void* allocate_or_throw(std::size_t bytes, std::size_t alignment = 0) {
  void* block = allocate(bytes, alignment);
  if (!block) throw std::bad_alloc();
  return block;
}

}  // namespace

extern "C" int __libc_start_main(Main main, int argc, char** argv, void (*init)(), void (*fini)(), void (*end)(),
                                 void* stack) {
  program_main = main;
  const auto start = reinterpret_cast<StartMain>(::dlsym(RTLD_NEXT, "__libc_start_main"));
  return start(counted_main, argc, argv, init, fini, end, stack);
}

void* operator new(std::size_t bytes) { return allocate_or_throw(bytes); }
void* operator new[](std::size_t bytes) { return allocate_or_throw(bytes); }
void* operator new(std::size_t bytes, const std::nothrow_t&) noexcept { return allocate(bytes); }
void* operator new[](std::size_t bytes, const std::nothrow_t&) noexcept { return allocate(bytes); }
void* operator new(std::size_t bytes, std::align_val_t alignment) {
  return allocate_or_throw(bytes, static_cast<std::size_t>(alignment));
}
void* operator new[](std::size_t bytes, std::align_val_t alignment) {
  return allocate_or_throw(bytes, static_cast<std::size_t>(alignment));
}
void operator delete(void* block) noexcept { std::free(block); }
void operator delete[](void* block) noexcept { std::free(block); }
void operator delete(void* block, std::size_t) noexcept { std::free(block); }
void operator delete[](void* block, std::size_t) noexcept { std::free(block); }
void operator delete(void* block, std::align_val_t) noexcept { std::free(block); }
void operator delete[](void* block, std::align_val_t) noexcept { std::free(block); }
void operator delete(void* block, std::size_t, std::align_val_t) noexcept { std::free(block); }
void operator delete[](void* block, std::size_t, std::align_val_t) noexcept { std::free(block); }
