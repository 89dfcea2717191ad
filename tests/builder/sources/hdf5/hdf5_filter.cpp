// A library that ends the process that loads it, in a folder of filters of HDF5.
#include <unistd.h>

namespace {
struct EndOfProcess {
  EndOfProcess() { ::_exit(77); }
} const end_of_process;
}  // namespace
