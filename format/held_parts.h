// Decoded parts of a file that several threads use.
#pragma once

#include <compare>
#include <cstdint>
#include <memory>
#include <mutex>
#include <utility>

#include "base/error.h"
#include "format/last_used.h"

namespace splatvol::format {

/// Holds parts that were used last. Each is read once while it is held, whoever asks for it first. Thread-safe.
class HeldParts {
 public:
  /// Names a part. Parts of one kind have one type.
  struct Key {
    int kind;
    std::uint64_t number;

    [[nodiscard]] auto operator<=>(const Key&) const = default;
  };

  /// `memory`: bytes to hold, besides parts in use.
  explicit HeldParts(std::uint64_t memory) : memory_(memory) {}

  /// Returns a part. `bytes`: that it takes. `read`: returns Result<Part>.
  template <class Part, class Read>
  [[nodiscard]] Result<std::shared_ptr<const Part>> get(const Key& key, std::uint64_t bytes, const Read& read) {
    const std::shared_ptr<Slot> slot = slot_of(key, bytes);
    const std::scoped_lock lock(slot->mutex);
    if (!slot->part) {
      SPLATVOL_TRY_ASSIGN(part, read());
      slot->part = std::make_shared<const Part>(std::move(part));
    }
    return std::static_pointer_cast<const Part>(slot->part);
  }

  /// Whether a part is held: get() does not read it.
  [[nodiscard]] bool holds(const Key& key) {
    const std::scoped_lock lock(mutex_);
    return slots_.find(key) != nullptr;
  }

 private:
  struct Slot {
    std::mutex mutex;  // the first thread reads, others wait
    std::shared_ptr<const void> part;
  };

  std::shared_ptr<Slot> slot_of(const Key& key, std::uint64_t bytes) {
    const std::scoped_lock lock(mutex_);
    if (const auto* held = slots_.find(key)) return *held;
    return slots_.add(key, std::make_shared<Slot>(), bytes, memory_);
  }

  std::uint64_t memory_;
  std::mutex mutex_;
  LastUsed<Key, std::shared_ptr<Slot>> slots_;
};

}  // namespace splatvol::format
