// Reads of a view's size from a file that the system has not cached: positional reads by threads, and io_uring.
#include <benchmark/benchmark.h>
#include <fcntl.h>
#include <linux/io_uring.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <random>
#include <span>
#include <string>
#include <thread>
#include <vector>

namespace {

// A view of a large file reads some hundreds of ranges, of a few chunks each.
constexpr std::size_t reads = 1000;
constexpr std::size_t read_bytes = 16u << 10;

struct Read {
  std::uint64_t offset;
  std::byte* out;
};

// The file that SPLATVOL_READ_BENCH names, such as a large .svol.
class ColdFile {
 public:
  ColdFile() {
    const char* path = std::getenv("SPLATVOL_READ_BENCH");
    descriptor_ = path ? ::open(path, O_RDONLY | O_CLOEXEC) : -1;
    const auto size = descriptor_ >= 0 ? ::lseek(descriptor_, 0, SEEK_END) : 0;
    if (size < static_cast<off_t>(read_bytes)) return;
    std::mt19937_64 random(1);
    for (std::size_t i = 0; i < reads; ++i)
      list_.push_back({random() % (static_cast<std::uint64_t>(size) - read_bytes), memory_.data() + i * read_bytes});
  }
  ~ColdFile() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  ColdFile(const ColdFile&) = delete;
  ColdFile& operator=(const ColdFile&) = delete;

  [[nodiscard]] int descriptor() const { return descriptor_; }
  [[nodiscard]] std::span<const Read> list() const { return list_; }
  void forget() const { ::posix_fadvise(descriptor_, 0, 0, POSIX_FADV_DONTNEED); }

 private:
  int descriptor_;
  std::vector<std::byte> memory_ = std::vector<std::byte>(reads * read_bytes);
  std::vector<Read> list_;
};

bool read_by_threads(const ColdFile& file, std::size_t threads) {
  std::atomic<std::size_t> next = 0;
  std::atomic<bool> failed = false;
  {
    std::vector<std::jthread> pool;
    for (std::size_t t = 0; t < threads; ++t)
      pool.emplace_back([&] {
        for (std::size_t i = next++; i < reads; i = next++)
          if (::pread(file.descriptor(), file.list()[i].out, read_bytes, static_cast<off_t>(file.list()[i].offset)) !=
              static_cast<ssize_t>(read_bytes))
            failed = true;
      });
  }
  return !failed;
}

// A ring for `depth` reads at once, without liburing.
class Ring {
 public:
  explicit Ring(unsigned depth) {
    descriptor_ = static_cast<int>(::syscall(SYS_io_uring_setup, depth, &params_));
    if (descriptor_ < 0) return;
    const std::size_t submissions = params_.sq_off.array + params_.sq_entries * sizeof(std::uint32_t);
    const std::size_t completions = params_.cq_off.cqes + params_.cq_entries * sizeof(io_uring_cqe);
    submissions_ = map(submissions, IORING_OFF_SQ_RING);
    completions_ = map(completions, IORING_OFF_CQ_RING);
    entries_ = static_cast<io_uring_sqe*>(map(params_.sq_entries * sizeof(io_uring_sqe), IORING_OFF_SQES));
  }
  ~Ring() {
    for (const auto& [address, bytes] : maps_) ::munmap(address, bytes);
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  Ring(const Ring&) = delete;
  Ring& operator=(const Ring&) = delete;

  [[nodiscard]] bool usable() const { return descriptor_ >= 0 && entries_; }
  [[nodiscard]] unsigned depth() const { return params_.sq_entries; }

  void submit(int file, const Read& read) {
    auto* tail = number(submissions_, params_.sq_off.tail);
    const std::uint32_t slot = *tail & (params_.sq_entries - 1);
    io_uring_sqe& entry = entries_[slot];
    std::memset(&entry, 0, sizeof(entry));
    entry.opcode = IORING_OP_READ;
    entry.fd = file;
    entry.off = read.offset;
    entry.addr = reinterpret_cast<std::uint64_t>(read.out);
    entry.len = read_bytes;
    number(submissions_, params_.sq_off.array)[slot] = slot;
    std::atomic_ref(*tail).store(*tail + 1, std::memory_order_release);
    ++pending_;
  }

  // Hands the submitted reads to the kernel and waits for at least one. Returns the number of finished reads, or -1 if
  // one has failed.
  int complete() {
    ::syscall(SYS_io_uring_enter, descriptor_, pending_, 1, IORING_ENTER_GETEVENTS, nullptr, 0);
    pending_ = 0;
    auto* head = number(completions_, params_.cq_off.head);
    const std::uint32_t tail =
        std::atomic_ref(*number(completions_, params_.cq_off.tail)).load(std::memory_order_acquire);
    const auto* done =
        reinterpret_cast<const io_uring_cqe*>(static_cast<std::byte*>(completions_) + params_.cq_off.cqes);
    int count = 0;
    bool failed = false;
    for (; *head != tail; ++*head, ++count)
      failed = failed || done[*head & (params_.cq_entries - 1)].res != static_cast<int>(read_bytes);
    return failed ? -1 : count;
  }

 private:
  static std::uint32_t* number(void* ring, std::uint32_t offset) {
    return reinterpret_cast<std::uint32_t*>(static_cast<std::byte*>(ring) + offset);
  }
  void* map(std::size_t bytes, off_t what) {
    void* address = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, descriptor_, what);
    if (address == MAP_FAILED) return nullptr;
    maps_.emplace_back(address, bytes);
    return address;
  }

  io_uring_params params_{};
  int descriptor_ = -1;
  std::vector<std::pair<void*, std::size_t>> maps_;
  void* submissions_ = nullptr;
  void* completions_ = nullptr;
  io_uring_sqe* entries_ = nullptr;
  unsigned pending_ = 0;
};

bool read_by_ring(const ColdFile& file, Ring& ring) {
  std::size_t submitted = 0, done = 0;
  while (done < reads) {
    for (; submitted < reads && submitted - done < ring.depth(); ++submitted)
      ring.submit(file.descriptor(), file.list()[submitted]);
    const int count = ring.complete();
    if (count < 0) return false;
    done += static_cast<std::size_t>(count);
  }
  return true;
}

void measure(benchmark::State& state, const ColdFile& file, const auto& read) {
  if (file.list().empty()) {
    state.SkipWithError("SPLATVOL_READ_BENCH must name a file of some GiB");
    return;
  }
  for (auto _ : state) {
    state.PauseTiming();
    file.forget();
    state.ResumeTiming();
    if (read()) continue;
    state.SkipWithError("a read failed");
    break;
  }
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations() * reads * read_bytes));
}

void threads(benchmark::State& state) {
  const ColdFile file;
  measure(state, file, [&] { return read_by_threads(file, static_cast<std::size_t>(state.range(0))); });
}
BENCHMARK(threads)->RangeMultiplier(2)->Range(1, 32)->MeasureProcessCPUTime()->UseRealTime()->Unit(
    benchmark::kMillisecond);

void io_uring(benchmark::State& state) {
  const ColdFile file;
  Ring ring(static_cast<unsigned>(state.range(0)));
  if (!ring.usable()) {
    state.SkipWithError("no io_uring on this system");
    return;
  }
  measure(state, file, [&] { return read_by_ring(file, ring); });
}
BENCHMARK(io_uring)->RangeMultiplier(2)->Range(1, 32)->MeasureProcessCPUTime()->UseRealTime()->Unit(
    benchmark::kMillisecond);

}  // namespace

BENCHMARK_MAIN();
