// The change from one step of a time series to the next: step_bench FILE.svol...
// Prints, for each file and tolerance, medians over all steps: bytes read, milliseconds and processor milliseconds from
// the change until the splats of the next step's view are there, without reading ahead and with it.
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <thread>
#include <vector>

#include "base/file.h"
#include "streamer/first/default_scene.h"
#include "streamer/streamer.h"

namespace splatvol {
namespace {

struct Change {
  double bytes, milliseconds, processor_milliseconds;
};

double processor_milliseconds() {
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  const auto of = [](const timeval& time) {
    return 1e3 * static_cast<double>(time.tv_sec) + 1e-3 * static_cast<double>(time.tv_usec);
  };
  return of(usage.ru_utime) + of(usage.ru_stime);
}

double median(std::vector<Change> changes, double Change::*of) {
  std::ranges::sort(changes, {}, of);
  return changes[changes.size() / 2].*of;
}

// The system forgets the file, so that it is read from the disk.
void forget(const std::string& path) {
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  ::posix_fadvise(descriptor, 0, 0, POSIX_FADV_DONTNEED);
  ::close(descriptor);
}

Result<std::vector<Change>> play(const std::string& path, double tolerance, bool ahead) {
  SPLATVOL_TRY_ASSIGN(source, open_file(path));
  SPLATVOL_TRY_ASSIGN(volume, format::Volume::open(std::move(source)));
  if (!volume->series()) return fail(ErrorCode::invalid_argument, "{}: no time series", path);
  SPLATVOL_TRY_ASSIGN(scene, default_scene(*volume, ""));
  SPLATVOL_TRY_ASSIGN(view, make_view(scene));
  const std::size_t steps = volume->series()->steps.size();
  SPLATVOL_TRY_ASSIGN(streamer, Streamer::open(std::move(volume), {std::uint64_t{512} << 20, scene.attribute}));
  const DetailOptions detail{tolerance};
  SPLATVOL_TRY(streamer->set_step(0));
  SPLATVOL_TRY(streamer->request(view, scene.transfer_function, detail));
  std::vector<Change> changes;
  for (std::size_t step = 1; step < steps; ++step) {
    forget(path);
    if (ahead) streamer->prefetch_step(step);
    while (streamer->is_prefetching()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    const std::uint64_t bytes = streamer->statistics().bytes_read;
    const double processor = processor_milliseconds();
    const auto start = std::chrono::steady_clock::now();
    SPLATVOL_TRY(streamer->set_step(step));
    SPLATVOL_TRY(streamer->request(view, scene.transfer_function, detail));
    const std::chrono::duration<double, std::milli> milliseconds = std::chrono::steady_clock::now() - start;
    changes.push_back({static_cast<double>(streamer->statistics().bytes_read - bytes), milliseconds.count(),
                       processor_milliseconds() - processor});
  }
  return changes;
}

}  // namespace
}  // namespace splatvol

int main(int argc, char** argv) {
  fmt::print("| file | tolerance % | read ahead | bytes read | ms | processor ms |\n|---|---|---|---|---|---|\n");
  for (int i = 1; i < argc; ++i)
    for (const double tolerance : {1.0, 4.0})
      for (const bool ahead : {false, true}) {
        const auto changes = splatvol::play(argv[i], tolerance, ahead);
        if (!changes) return fmt::print(stderr, "step_bench: {}\n", changes.error().message), 1;
        using splatvol::Change;
        fmt::print("| {} | {} | {} | {:.0f} | {:.1f} | {:.1f} |\n", argv[i], tolerance, ahead ? "yes" : "no",
                   median(*changes, &Change::bytes), median(*changes, &Change::milliseconds),
                   median(*changes, &Change::processor_milliseconds));
      }
}
