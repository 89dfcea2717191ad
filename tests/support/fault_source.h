// A source that fails, lies, waits or changes when a test says so.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/file.h"

namespace splatvol::test {

/// What happens to reads, and what has happened: the test's end of a FaultSource. Thread-safe; faults may come and go
/// while reads are under way.
class Faults {
 public:
  /// `content` answers the reads that nothing else happens to.
  explicit Faults(std::unique_ptr<ByteSource> content) : content_(std::move(content)) {}

  /// Read number `number` (0: the first ever) fails.
  void fail_read(std::uint64_t number);

  /// From now on, reads of any byte in [from, to) fail.
  void fail_range(std::uint64_t from, std::uint64_t to);

  /// From now on, the bytes in [from, to) come with all bits flipped.
  void corrupt_range(std::uint64_t from, std::uint64_t to);

  /// Takes back fail_read, fail_range and corrupt_range.
  void clear();

  /// From now on, reads wait; `release` lets them, and all after them, go on.
  void hold();
  void release();

  /// Returns when at least so many reads wait. Requires `hold`.
  void wait_for_held(std::size_t reads);

  /// From now on, reads are answered by other content; the source's size stays what it was.
  void replace(std::unique_ptr<ByteSource> content);

  /// Reads that have begun, failed ones too, and the bytes that they asked for.
  [[nodiscard]] std::uint64_t reads() const;
  [[nodiscard]] std::uint64_t bytes() const;

 private:
  friend class FaultSource;
  using Ranges = std::vector<std::pair<std::uint64_t, std::uint64_t>>;  // [from, to)
  [[nodiscard]] Status read(std::uint64_t offset, std::span<std::byte> out);

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::shared_ptr<ByteSource> content_;
  std::optional<std::uint64_t> failing_read_;
  Ranges failing_, corrupt_;
  bool holding_ = false;
  std::size_t held_ = 0;
  std::uint64_t reads_ = 0;
  std::uint64_t bytes_ = 0;
};

/// The reader's end. Has the size and the name of the content at the time it was made.
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
