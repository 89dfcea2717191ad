// splatvol-read: reads files for other programs, which start it (builder/sources/process/reader_process.h).
#include <tbb/cache_aligned_allocator.h>
#include <tbb/global_control.h>

#include <charconv>
#include <cstdio>
#include <memory>
#include <string_view>

#include "builder/opening/open_source.h"
#include "builder/sources/process/serve_sources.h"
#include "builder/sources/surfaces/surface_file.h"

namespace {

template <class T>
bool parse(std::string_view text, T& number) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc() && end == text.data() + text.size();
}

/// TBB loads a library at its first allocation. A confined process cannot.
void load_allocator_of_tbb() {
  tbb::cache_aligned_allocator<char> allocator;
  allocator.deallocate(allocator.allocate(1), 1);
}

}  // namespace

int main(int argc, char** argv) {
  using namespace splatvol;
  int socket = -1;
  ReaderLimits limits{};
  std::size_t threads = 0;
  if (argc != 4 || !parse(argv[1], socket) || !parse(argv[2], limits.memory) || !parse(argv[3], threads)) {
    std::fputs("splatvol-read: reads files for svbuild, svrender, svview, svtruth and svgen, which start it\n", stderr);
    return 2;
  }
  load_allocator_of_tbb();
  confine_reader(socket, limits);
  std::unique_ptr<tbb::global_control> limit;
  if (threads > 0) limit = std::make_unique<tbb::global_control>(tbb::global_control::max_allowed_parallelism, threads);
  serve_sources(socket, limits, open_source, list_arrays, read_surface_file);
  return 0;
}
