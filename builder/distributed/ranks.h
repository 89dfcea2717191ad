// The processes of a build that work together: MPI behind a narrow face. Nothing else sees mpi.h.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <memory>
#include <span>
#include <stop_token>
#include <type_traits>
#include <vector>

#include "base/error.h"
#include "format/codec.h"

namespace splatvol {

using format::Bytes;

/// The failure of a result, if it is one.
template <class T>
[[nodiscard]] Status status_of(const Result<T>& result) {
  return result ? Status{} : Status(tl::unexpected<Error>(result.error()));
}

/// The ranks 0 to size() - 1 of one MPI job. Functions marked "collective" are called by all ranks, in one order; they
/// wait for each other. One thread at a time may call. If a rank dies, MPI ends all of them.
class Ranks {
 public:
  /// Starts MPI in this process. Called once, before other threads start. Fails if the library cannot serve a second
  /// thread.
  [[nodiscard]] static Result<std::unique_ptr<Ranks>> start(int& argc, char**& argv);
  ~Ranks();  // ends MPI
  Ranks(const Ranks&) = delete;
  Ranks& operator=(const Ranks&) = delete;

  [[nodiscard]] std::size_t rank() const { return rank_; }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] bool is_first() const { return rank_ == 0; }

  /// Ranks on this machine.
  [[nodiscard]] std::size_t neighbours() const { return neighbours_; }
  [[nodiscard]] bool on_one_machine() const { return neighbours_ == size_; }

  /// Ends all ranks, this one too, for a program that cannot go on by the rules: others may wait for it.
  [[noreturn]] static void abandon();

  /// Requests a stop as soon as another rank has failed: long work of this rank then ends with ErrorCode::cancelled
  /// (base/interruption.h), and agree() returns the error of the other rank.
  [[nodiscard]] std::stop_token stop() const;

  /// Collective: returns the same on all ranks. Fails with the error of the first rank whose status is a failure.
  [[nodiscard]] Status agree(const Status& own);

  /// Collective: returns what this rank has made, if all ranks have made theirs. Fails as agree().
  template <class T>
  [[nodiscard]] Result<T> agree_on(Result<T> own) {
    SPLATVOL_TRY(agree(status_of(own)));
    return own;
  }

  /// Collective: replaces each number by its sum, or its largest, over all ranks.
  void sum(std::span<std::uint64_t> numbers);
  void largest(std::span<std::uint64_t> numbers);

  /// Collective: returns the bytes of each rank, on all ranks.
  [[nodiscard]] std::vector<Bytes> gather_all(std::span<const std::byte> own);

  /// Collective: returns the bytes of rank 0.
  [[nodiscard]] Bytes broadcast(Bytes bytes);

  /// Collective: sends `counts[r]` bytes of `bytes` to each rank r, which lie side by side. Returns what the others
  /// sent, by rank, in `received`, and how many bytes each sent. No rank may send or get 2^31 bytes.
  [[nodiscard]] std::vector<std::uint64_t> exchange(std::span<const std::byte> bytes,
                                                    std::span<const std::uint64_t> counts, Bytes& received);

  /// Sends bytes to a rank, which receives them. Waits until it does.
  void send(std::size_t to, std::span<const std::byte> bytes);
  [[nodiscard]] Bytes receive(std::size_t from);

  /// Collective: rank after rank, calls produce(emit) on it, and consume(rank, bytes) on rank 0 for each call of
  /// emit(bytes), in order. Messages wait for their receiver, so that no rank gets more than one at a time. Agrees on
  /// the status.
  using Emit = std::function<Status(std::span<const std::byte>)>;
  using Produce = std::function<Status(const Emit&)>;
  using Consume = std::function<Status(std::size_t rank, std::span<const std::byte>)>;
  [[nodiscard]] Status gather_in_order(const Produce& produce, const Consume& consume);

  /// Bytes that this rank sent to others so far.
  [[nodiscard]] std::uint64_t bytes_sent() const { return bytes_sent_; }

 private:
  class Watcher;
  Ranks();

  std::size_t rank_ = 0, size_ = 1, neighbours_ = 1;
  std::uint64_t bytes_sent_ = 0;
  std::unique_ptr<Watcher> watcher_;
};

/// Collective: returns the values of each rank.
template <class T>
requires std::is_trivially_copyable_v<T>
[[nodiscard]] std::vector<std::vector<T>> gather_arrays(Ranks& ranks, std::span<const T> own) {
  std::vector<std::vector<T>> arrays;
  for (const Bytes& bytes : ranks.gather_all(std::as_bytes(own))) {
    std::vector<T>& array = arrays.emplace_back(bytes.size() / sizeof(T));
    if (!bytes.empty()) std::memcpy(array.data(), bytes.data(), bytes.size());
  }
  return arrays;
}

/// Collective: returns a value of each rank.
template <class T>
[[nodiscard]] std::vector<T> gather_values(Ranks& ranks, const T& own) {
  std::vector<T> values;
  for (const std::vector<T>& one : gather_arrays(ranks, std::span(&own, 1))) values.push_back(one[0]);
  return values;
}

}  // namespace splatvol
