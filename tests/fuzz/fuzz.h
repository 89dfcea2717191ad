// What the fuzzers share. A fuzzer ends the program where a library breaks a promise; libFuzzer then keeps the input.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <span>
#include <string>
#include <type_traits>

#include "base/error.h"
#include "format/codec.h"

// libFuzzer calls these.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);
extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                               unsigned seed);
extern "C" std::size_t LLVMFuzzerCustomCrossOver(const std::uint8_t* data1, std::size_t size1,
                                                 const std::uint8_t* data2, std::size_t size2, std::uint8_t* out,
                                                 std::size_t max_size, unsigned seed);
// A fuzzer calls this one.
extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t max_size);

namespace splatvol::fuzz {

/// Ends the program unless a promise holds.
inline void require(bool holds, const std::string& promise) {
  if (holds) return;
  static_cast<void>(std::fprintf(stderr, "fuzz: broken promise: %s\n", promise.c_str()));
  std::abort();
}

/// Ends the program if there is an error.
template <class T>
void require_ok(const Result<T>& result, const std::string& what) {
  require(result.has_value(), result ? what : what + ": " + result.error().message);
}

[[nodiscard]] inline std::span<const std::byte> bytes_of(const std::uint8_t* data, std::size_t size) {
  return std::as_bytes(std::span(data, size));
}

/// Takes settings from the front of an input; behind its end they are 0.
class Input {
 public:
  explicit Input(std::span<const std::byte> bytes) : rest_(bytes) {}

  template <class T>
  requires std::is_trivially_copyable_v<T> T take() {
    T value{};
    const auto taken = rest_.first(std::min(sizeof(T), rest_.size()));
    std::ranges::copy(taken, reinterpret_cast<std::byte*>(&value));
    rest_ = rest_.subspan(taken.size());
    return value;
  }

  /// Returns a number in [least, most].
  std::uint32_t take_in(std::uint32_t least, std::uint32_t most) {
    return least + take<std::uint16_t>() % (most - least + 1);
  }

  [[nodiscard]] std::span<const std::byte> rest() const { return rest_; }
  [[nodiscard]] std::string text() const { return {reinterpret_cast<const char*>(rest_.data()), rest_.size()}; }

 private:
  std::span<const std::byte> rest_;
};

/// A file in memory, for libraries that open files by name.
class NamedBytes {
 public:
  explicit NamedBytes(std::span<const std::byte> bytes);
  NamedBytes(const NamedBytes&) = delete;
  NamedBytes& operator=(const NamedBytes&) = delete;
  ~NamedBytes();

  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  int descriptor_;
  std::string path_;
};

}  // namespace splatvol::fuzz
