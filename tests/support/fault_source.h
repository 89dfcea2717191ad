// A source that fails, lies, waits or changes when a test wants it.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/file.h"

namespace splatvol::test {

/// The test's side of a FaultSource: sets the faults of reads, and counts reads. Thread-safe; faults may change during
/// reads.
class Faults {
 public:
  /// `content` answers reads without a fault.
  explicit Faults(std::unique_ptr<ByteSource> content) : content_(std::move(content)) {}

  /// Makes read `number` fail (0: the first of all).
  void fail_read(std::uint64_t number);

  /// Makes reads of any byte in [from, to) fail.
  void fail_range(std::uint64_t from, std::uint64_t to);

  /// Makes reads return the bytes in [from, to) with all bits flipped.
  void corrupt_range(std::uint64_t from, std::uint64_t to);

  /// Ends the faults of fail_read, fail_range and corrupt_range.
  void clear();

  /// Makes reads wait until `release`, or until they are interrupted.
  void hold();
  void release();

  /// Waits until at least this many reads wait. Requires `hold`.
  void wait_for_held(std::size_t reads);
  [[nodiscard]] std::size_t held() const;

  /// Answers reads from other content. The source keeps its size.
  void replace(std::unique_ptr<ByteSource> content);

  /// Return the number of reads that have begun, failed reads too, and the bytes that they asked for.
  [[nodiscard]] std::uint64_t reads() const;
  [[nodiscard]] std::uint64_t bytes() const;

  /// Returns the number of reads that have asked for bytes in [from, to).
  [[nodiscard]] std::ptrdiff_t reads_of(std::uint64_t from, std::uint64_t to) const;

 private:
  friend class FaultSource;
  using Ranges = std::vector<std::pair<std::uint64_t, std::uint64_t>>;  // [from, to)
  [[nodiscard]] Status read(std::uint64_t offset, std::span<std::byte> out);

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::shared_ptr<ByteSource> content_;
  std::optional<std::uint64_t> failing_read_;
  Ranges failing_, corrupt_;
  Ranges ranges_;  // [read]
  bool holding_ = false;
  std::size_t held_ = 0;
  std::uint64_t bytes_ = 0;
};

/// The reader's side. Has the size and the name of the content at the time when it was made.
class FaultSource final : public ByteSource {
 public:
  explicit FaultSource(std::shared_ptr<Faults> faults);
  [[nodiscard]] std::uint64_t size() const override { return size_; }
  [[nodiscard]] const std::string& name() const override { return name_; }
  [[nodiscard]] Status read(std::uint64_t offset, std::span<std::byte> out) override {
    return faults_->read(offset, out);
  }

 private:
  std::shared_ptr<Faults> faults_;
  std::uint64_t size_;
  std::string name_;
};

}  // namespace splatvol::test
