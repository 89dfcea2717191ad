// To be preloaded: the system lets so many threads besides `main` live at a time as SPLATVOL_THREADS says.
#include <dlfcn.h>
#include <pthread.h>

#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <new>

namespace {

using Create = int (*)(pthread_t*, const pthread_attr_t*, void* (*)(void*), void*);

struct Work {
  void* (*run)(void*);
  void* argument;
};

// Libraries start threads before this one has prepared itself.
std::atomic<long>& left() {
  static std::atomic<long> number = [] {
    const char* text = std::getenv("SPLATVOL_THREADS");
    return text ? std::strtol(text, nullptr, 10) : 0;
  }();
  return number;
}

void* run_counted(void* memory) {
  const Work work = *static_cast<Work*>(memory);
  delete static_cast<Work*>(memory);
  void* result = work.run(work.argument);
  ++left();
  return result;
}

}  // namespace

extern "C" int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*run)(void*),
                              void* argument) {
  static const auto create = reinterpret_cast<Create>(::dlsym(RTLD_NEXT, "pthread_create"));
  if (left()-- <= 0) {
    ++left();
    return EAGAIN;
  }
  Work* const work = new (std::nothrow) Work{run, argument};
  return work ? create(thread, attributes, run_counted, work) : EAGAIN;
}
