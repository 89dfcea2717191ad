#include "builder/distributed/ranks.h"

#include <mpi.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <string>
#include <thread>

namespace splatvol {
namespace {

constexpr int data_tag = 1, failure_tag = 2;
constexpr std::size_t most_message = std::size_t{1} << 28;  // bytes
constexpr std::chrono::milliseconds watch_interval{20};

int to_int(std::size_t number) { return static_cast<int>(number); }

std::vector<int> offsets_of(const std::vector<int>& counts) {
  std::vector<int> offsets(counts.size());
  for (std::size_t r = 1; r < counts.size(); ++r) offsets[r] = offsets[r - 1] + counts[r - 1];
  return offsets;
}

}  // namespace

// Waits for notices of failures. They have a communicator of their own, as they come at any time.
class Ranks::Watcher {
 public:
  Watcher() {
    MPI_Comm_dup(MPI_COMM_WORLD, &notices_);
    thread_ = std::jthread([this](const std::stop_token& end) { watch(end); });
  }
  ~Watcher() {
    thread_.request_stop();
    thread_.join();
    MPI_Comm_free(&notices_);
  }

  [[nodiscard]] std::stop_token stop() const { return stop_.get_token(); }

  void notify(int own, int size) {
    for (int r = 0; r < size; ++r)
      if (r != own) MPI_Send(nullptr, 0, MPI_BYTE, r, failure_tag, notices_);
  }

  // Waits until all notices that were sent have come: none may be left when MPI ends.
  void await(int notices) {
    expected_ += notices;
    while (received_ < expected_) std::this_thread::sleep_for(watch_interval);
  }

 private:
  void watch(const std::stop_token& end) {
    while (!end.stop_requested()) {
      int any = 0;
      MPI_Iprobe(MPI_ANY_SOURCE, failure_tag, notices_, &any, MPI_STATUS_IGNORE);
      if (any == 0) {
        std::this_thread::sleep_for(watch_interval);
        continue;
      }
      MPI_Recv(nullptr, 0, MPI_BYTE, MPI_ANY_SOURCE, failure_tag, notices_, MPI_STATUS_IGNORE);
      stop_.request_stop();
      ++received_;
    }
  }

  MPI_Comm notices_ = MPI_COMM_NULL;
  std::stop_source stop_;
  std::atomic<int> received_ = 0;
  int expected_ = 0;
  std::jthread thread_;
};

Ranks::Ranks() {
  int rank = 0, size = 1, neighbours = 1;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  MPI_Comm_size(MPI_COMM_WORLD, &size);
  MPI_Comm machine = MPI_COMM_NULL;
  MPI_Comm_split_type(MPI_COMM_WORLD, MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, &machine);
  MPI_Comm_size(machine, &neighbours);
  MPI_Comm_free(&machine);
  rank_ = static_cast<std::size_t>(rank);
  size_ = static_cast<std::size_t>(size);
  neighbours_ = static_cast<std::size_t>(neighbours);
  watcher_ = std::make_unique<Watcher>();
}

// A launcher ends all ranks once one has ended with an error: not before each has said what it has to say.
Ranks::~Ranks() {
  MPI_Barrier(MPI_COMM_WORLD);
  watcher_.reset();
  MPI_Finalize();
}

Result<std::unique_ptr<Ranks>> Ranks::start(int& argc, char**& argv) {
  int provided = MPI_THREAD_SINGLE;
  MPI_Init_thread(&argc, &argv, MPI_THREAD_MULTIPLE, &provided);
  if (provided < MPI_THREAD_MULTIPLE) {
    MPI_Finalize();
    return fail(ErrorCode::unsupported, "this MPI library serves one thread only; a rank needs two");
  }
  return std::unique_ptr<Ranks>(new Ranks);
}

void Ranks::abandon() {
  MPI_Abort(MPI_COMM_WORLD, 1);
  std::abort();
}

std::stop_token Ranks::stop() const { return watcher_->stop(); }

Status Ranks::agree(const Status& own) {
  const bool follows = !own && own.error().code == ErrorCode::cancelled && stop().stop_requested();
  const bool failed = !own && !follows;
  if (failed) watcher_->notify(to_int(rank_), to_int(size_));
  int first = failed ? to_int(rank_) : to_int(size_), count = failed ? 1 : 0;
  MPI_Allreduce(MPI_IN_PLACE, &first, 1, MPI_INT, MPI_MIN, MPI_COMM_WORLD);
  if (first == to_int(size_)) return {};
  MPI_Allreduce(MPI_IN_PLACE, &count, 1, MPI_INT, MPI_SUM, MPI_COMM_WORLD);
  watcher_->await(count - (failed ? 1 : 0));
  const bool is_first_failed = first == to_int(rank_);
  int code = is_first_failed ? static_cast<int>(own.error().code) : 0;
  std::string message = is_first_failed ? own.error().message : "";
  int length = to_int(message.size());
  MPI_Bcast(&code, 1, MPI_INT, first, MPI_COMM_WORLD);
  MPI_Bcast(&length, 1, MPI_INT, first, MPI_COMM_WORLD);
  message.resize(static_cast<std::size_t>(length));
  MPI_Bcast(message.data(), length, MPI_CHAR, first, MPI_COMM_WORLD);
  return tl::unexpected<Error>(Error{static_cast<ErrorCode>(code), message});
}

void Ranks::sum(std::span<std::uint64_t> numbers) {
  MPI_Allreduce(MPI_IN_PLACE, numbers.data(), to_int(numbers.size()), MPI_UINT64_T, MPI_SUM, MPI_COMM_WORLD);
}

void Ranks::largest(std::span<std::uint64_t> numbers) {
  MPI_Allreduce(MPI_IN_PLACE, numbers.data(), to_int(numbers.size()), MPI_UINT64_T, MPI_MAX, MPI_COMM_WORLD);
}

std::vector<Bytes> Ranks::gather_all(std::span<const std::byte> own) {
  const int count = to_int(own.size());
  std::vector<int> counts(size_);
  MPI_Allgather(&count, 1, MPI_INT, counts.data(), 1, MPI_INT, MPI_COMM_WORLD);
  const std::vector<int> offsets = offsets_of(counts);
  Bytes all(static_cast<std::size_t>(offsets.back() + counts.back()));
  MPI_Allgatherv(own.data(), count, MPI_BYTE, all.data(), counts.data(), offsets.data(), MPI_BYTE, MPI_COMM_WORLD);
  bytes_sent_ += own.size() * (size_ - 1);
  std::vector<Bytes> parts;
  for (std::size_t r = 0; r < size_; ++r)
    parts.emplace_back(all.begin() + offsets[r], all.begin() + offsets[r] + counts[r]);
  return parts;
}

Bytes Ranks::broadcast(Bytes bytes) {
  int count = to_int(bytes.size());
  MPI_Bcast(&count, 1, MPI_INT, 0, MPI_COMM_WORLD);
  bytes.resize(static_cast<std::size_t>(count));
  MPI_Bcast(bytes.data(), count, MPI_BYTE, 0, MPI_COMM_WORLD);
  if (is_first()) bytes_sent_ += bytes.size() * (size_ - 1);
  return bytes;
}

std::vector<std::uint64_t> Ranks::exchange(std::span<const std::byte> bytes, std::span<const std::uint64_t> counts,
                                           Bytes& received) {
  std::vector<int> sent(size_), got(size_);
  for (std::size_t r = 0; r < size_; ++r) sent[r] = to_int(counts[r]);
  MPI_Alltoall(sent.data(), 1, MPI_INT, got.data(), 1, MPI_INT, MPI_COMM_WORLD);
  const std::vector<int> sent_offsets = offsets_of(sent), got_offsets = offsets_of(got);
  received.resize(static_cast<std::size_t>(got_offsets.back() + got.back()));
  MPI_Alltoallv(bytes.data(), sent.data(), sent_offsets.data(), MPI_BYTE, received.data(), got.data(),
                got_offsets.data(), MPI_BYTE, MPI_COMM_WORLD);
  bytes_sent_ += bytes.size() - counts[rank_];
  return {got.begin(), got.end()};
}

void Ranks::send(std::size_t to, std::span<const std::byte> bytes) {
  const std::uint64_t count = bytes.size();
  MPI_Ssend(&count, 1, MPI_UINT64_T, to_int(to), data_tag, MPI_COMM_WORLD);
  bytes_sent_ += count;
  for (; !bytes.empty(); bytes = bytes.subspan(std::min(bytes.size(), most_message)))
    MPI_Ssend(bytes.data(), to_int(std::min(bytes.size(), most_message)), MPI_BYTE, to_int(to), data_tag,
              MPI_COMM_WORLD);
}

Bytes Ranks::receive(std::size_t from) {
  std::uint64_t count = 0;
  MPI_Recv(&count, 1, MPI_UINT64_T, to_int(from), data_tag, MPI_COMM_WORLD, MPI_STATUS_IGNORE);
  Bytes bytes(count);
  for (std::span<std::byte> rest = bytes; !rest.empty(); rest = rest.subspan(std::min(rest.size(), most_message)))
    MPI_Recv(rest.data(), to_int(std::min(rest.size(), most_message)), MPI_BYTE, to_int(from), data_tag, MPI_COMM_WORLD,
             MPI_STATUS_IGNORE);
  return bytes;
}

Status Ranks::gather_in_order(const Produce& produce, const Consume& consume) {
  if (!is_first()) {
    // An empty message ends the stream.
    const Status produced = produce([&](std::span<const std::byte> bytes) -> Status {
      if (!bytes.empty()) send(0, bytes);
      return {};
    });
    send(0, {});
    return agree(produced);
  }
  Status consumed = produce([&](std::span<const std::byte> bytes) { return consume(0, bytes); });
  for (std::size_t r = 1; r < size_; ++r)
    for (Bytes bytes = receive(r); !bytes.empty(); bytes = receive(r))
      if (consumed) consumed = consume(r, bytes);
  return agree(consumed);
}

}  // namespace splatvol
