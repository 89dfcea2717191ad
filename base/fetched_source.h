// Bytes of a file that come between two tries of an operation: where no read may wait.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "base/byte_ranges.h"
#include "base/error.h"
#include "base/file.h"

namespace splatvol {

/// The bytes that an operation needs. They stay while it lives, so that they are there when it is tried again.
class FetchedBytes {
 public:
  /// Returns those of the operation whose reads this thread makes; null: of none.
  [[nodiscard]] static FetchedBytes* of_thread();

  /// While it lives, reads of this thread are those of the operation.
  class Scope {
   public:
    explicit Scope(FetchedBytes* bytes);
    Scope(const Scope&) = delete;
    Scope& operator=(const Scope&) = delete;
    ~Scope();

   private:
    FetchedBytes* before_;
  };

 private:
  friend class FetchedSource;
  using Block = std::vector<std::byte>;
  struct Blocks {
    std::mutex mutex = {};
    std::set<std::shared_ptr<const Block>> blocks = {};

    void add(const std::shared_ptr<const Block>& block) {
      const std::scoped_lock lock(mutex);
      blocks.insert(block);
    }
  };
  std::shared_ptr<Blocks> blocks_ = std::make_shared<Blocks>();
};

/// A file whose bytes its owner fetches. Thread-safe.
///
/// A read of bytes that are not there wants them, and fails with ErrorCode::pending. The owner takes what is wanted,
/// fetches it in any order, and gives it back; then the operation that failed is tried again.
class FetchedSource final : public ByteSource {
 public:
  /// `most_bytes`: that are held besides those of operations.
  FetchedSource(std::string name, std::uint64_t size, std::uint64_t most_bytes);

  [[nodiscard]] std::uint64_t size() const override { return size_; }
  [[nodiscard]] const std::string& name() const override { return name_; }
  [[nodiscard]] std::uint64_t cheap_gap() const override { return std::uint64_t{64} << 10; }
  [[nodiscard]] bool waits() const override { return false; }
  [[nodiscard]] Status read(std::uint64_t offset, std::span<std::byte> out) override;
  [[nodiscard]] bool prefetch(std::span<const ByteRange> ranges) override;

  /// Returns a source that reads from `source`, for those who own theirs.
  [[nodiscard]] static std::unique_ptr<ByteSource> share(std::shared_ptr<FetchedSource> source);

  /// Returns the ranges that have been wanted since the last call, in the order of need. None is wanted again before it
  /// was delivered or refused.
  [[nodiscard]] std::vector<ByteRange> take_wanted();

  /// Takes over bytes. Ignores those that nobody has asked for, or that have come before.
  void deliver(const ByteRange& range, std::vector<std::byte> bytes);

  /// Lets the next read of these bytes fail with this error. They are wanted again after that.
  void refuse(const ByteRange& range, Error error);

  /// Whether there are ranges that were taken and neither delivered nor refused, or that are still to be taken.
  [[nodiscard]] bool is_waiting() const;

  /// Returns the bytes that are held.
  [[nodiscard]] std::uint64_t held_bytes() const;

 private:
  using Block = FetchedBytes::Block;
  struct Held {
    std::shared_ptr<const Block> bytes;
    std::uint64_t used = 0;  // when: the last has the largest
  };
  struct Asked {
    std::uint64_t end = 0;
    bool is_taken = false;
    std::vector<std::weak_ptr<FetchedBytes::Blocks>> by = {};
    std::optional<Error> error = {};
  };
  [[nodiscard]] std::vector<ByteRange> missing_in(const ByteRange& range) const;
  [[nodiscard]] bool want(const ByteRange& range);
  [[nodiscard]] std::optional<Error> take_error(const ByteRange& range);
  void use(const ByteRange& range, std::span<std::byte> out);
  void drop_unused();

  const std::string name_;
  const std::uint64_t size_, most_bytes_;
  mutable std::mutex mutex_;
  std::map<std::uint64_t, Held> held_;    // by their offsets; none overlaps another
  std::map<std::uint64_t, Asked> asked_;  // likewise, and none overlaps one that is held
  std::vector<ByteRange> wanted_;         // of these, those that were not taken
  std::uint64_t held_bytes_ = 0, uses_ = 0;
};

}  // namespace splatvol
