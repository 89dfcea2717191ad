// Compresses and hashes bytes: zstd frames, byte planes, XXH3-64.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "base/error.h"

struct XXH3_state_s;

namespace splatvol::format {

using Bytes = std::vector<std::byte>;

/// Returns the XXH3-64 hash with seed 0.
[[nodiscard]] std::uint64_t hash_bytes(std::span<const std::byte> bytes);

/// The same of bytes that come in parts.
class StreamHash {
 public:
  StreamHash();
  ~StreamHash();
  StreamHash(const StreamHash&) = delete;
  StreamHash& operator=(const StreamHash&) = delete;
  void add(std::span<const std::byte> part);
  [[nodiscard]] std::uint64_t value() const;

 private:
  XXH3_state_s* state_;
};

/// Hashes bytes that come in parts: the hash is that of the hashes of all parts.
class PartsHash {
 public:
  void add(std::span<const std::byte> part) { add(hash_bytes(part)); }
  void add(std::uint64_t hash) {
    const std::uint64_t both[] = {hash_, hash};
    hash_ = hash_bytes(std::as_bytes(std::span(both)));
  }
  [[nodiscard]] std::uint64_t value() const { return hash_; }

 private:
  std::uint64_t hash_ = 0;
};

/// Returns a zstd frame of `raw`, or `raw` itself if the frame is not smaller or breaks the ratio of spec rule R7. A
/// result as long as `raw` is `raw`. Deterministic. Thread-safe.
[[nodiscard]] Bytes pack(std::span<const std::byte> raw);

/// As `pack`, but blocks of the frame end at `ends`, which ascend. Each has its own statistics. Short ones are joined.
[[nodiscard]] Bytes pack_blocks(std::span<const std::byte> raw, std::span<const std::size_t> ends);

/// Undoes `pack` into exactly `unpacked_bytes` bytes. `what` begins the message of an error. Safe on untrusted input:
/// allocates at most about 1024 times the packed size. Thread-safe.
[[nodiscard]] Result<Bytes> unpack(std::span<const std::byte> packed, std::uint64_t unpacked_bytes,
                                   std::string_view what);

/// As `unpack`, but the bytes are `packed` itself or lie in memory of the calling thread, which its next call writes
/// anew.
[[nodiscard]] Result<std::span<const std::byte>> unpack_here(std::span<const std::byte> packed,
                                                             std::uint64_t unpacked_bytes, std::string_view what);

/// Undoes `pack` from front to back, in little memory: at most about 8 MiB, whatever the packed bytes say. Safe on
/// untrusted input.
class Unpacker {
 public:
  /// `packed` outlives it. `what` begins the messages of errors.
  Unpacker(std::span<const std::byte> packed, std::uint64_t unpacked_bytes, std::string_view what);
  Unpacker(Unpacker&&) noexcept;
  Unpacker& operator=(Unpacker&&) noexcept;
  ~Unpacker();

  /// Unpacks the next bytes. Fails if there are not so many, if the frame is damaged, or if it needs a window of more
  /// than 8 MiB.
  [[nodiscard]] Status read(std::span<std::byte> out);

  /// Goes on to an offset of the unpacked bytes, which is not behind. Can be interrupted. Fails as `read`.
  [[nodiscard]] Status skip_to(std::uint64_t offset);

  /// Fails unless all bytes were read, and no more are packed.
  [[nodiscard]] Status finish();

 private:
  struct Frame;
  std::span<const std::byte> packed_;
  std::uint64_t unpacked_bytes_, at_ = 0;
  std::string what_;
  std::unique_ptr<Frame> frame_;  // null: the bytes are not packed
};

/// Fails unless `packed_bytes` may hold `unpacked_bytes`, by rule R7.
[[nodiscard]] Status check_ratio(std::uint64_t packed_bytes, std::uint64_t unpacked_bytes, std::string_view what);

/// Checks length and hash of the packed bytes that `entry` describes (a section, a chunk, a patch or an index page
/// part).
template <class Entry>
[[nodiscard]] Status check_packed(const Entry& entry, std::span<const std::byte> packed, std::string_view what) {
  if (packed.size() != entry.packed_bytes || hash_bytes(packed) != entry.hash)
    return fail(ErrorCode::invalid_data, "{}: checksum mismatch", what);
  return {};
}

/// The same, then unpacks them. Otherwise as `unpack`.
template <class Entry>
[[nodiscard]] Result<Bytes> unpack_checked(const Entry& entry, std::span<const std::byte> packed,
                                           std::string_view what) {
  SPLATVOL_TRY(check_packed(entry, packed, what));
  return unpack(packed, entry.unpacked_bytes, what);
}

/// Appends the bytes of a record, as they are in memory.
template <class T>
requires std::is_trivially_copyable_v<T>
void append_record(Bytes& bytes, const T& record) {
  const auto raw = std::as_bytes(std::span(&record, 1));
  bytes.insert(bytes.end(), raw.begin(), raw.end());
}

/// Copies a record out of `bytes`. Requires offset + sizeof(T) <= bytes.size().
template <class T>
requires std::is_trivially_copyable_v<T>
[[nodiscard]] T read_record(std::span<const std::byte> bytes, std::size_t offset) {
  T record;
  std::memcpy(&record, bytes.data() + offset, sizeof(T));
  return record;
}

/// Appends the lowest `width` bytes of every number as `width` planes, lowest byte first.
template <class T>
requires std::is_trivially_copyable_v<T>
void append_planes(Bytes& bytes, std::span<const T> numbers, std::size_t width = sizeof(T)) {
  if (numbers.empty()) return;  // data() may be null, which bears no offset
  const std::size_t start = bytes.size();
  bytes.insert(bytes.end(), numbers.size() * width, std::byte{0});
  for (std::size_t plane = 0; plane < width; ++plane) {
    std::byte* out = bytes.data() + start + plane * numbers.size();
    const auto* in = reinterpret_cast<const std::byte*>(numbers.data()) + plane;
    for (std::size_t i = 0; i < numbers.size(); ++i) out[i] = in[i * sizeof(T)];
  }
}

namespace detail {

template <std::size_t bytes>
using Unsigned = std::conditional_t<
    bytes == 1, std::uint8_t,
    std::conditional_t<bytes == 2, std::uint16_t, std::conditional_t<bytes == 4, std::uint32_t, std::uint64_t>>>;

// The width is a constant, so that compilers make vectors of the loop.
template <std::size_t width, class T>
void read_planes_of(const std::byte* __restrict planes, std::span<T> numbers) {
  using Number = Unsigned<sizeof(T)>;
  static_assert(sizeof(Number) == sizeof(T));
  const std::size_t count = numbers.size();
  T* __restrict out = numbers.data();
  for (std::size_t i = 0; i < count; ++i) {
    Number number = 0;
    for (std::size_t k = 0; k < width; ++k)
      number = static_cast<Number>(number | static_cast<Number>(planes[k * count + i]) << 8 * k);
    out[i] = std::bit_cast<T>(number);
  }
}

}  // namespace detail

/// Reads `width` planes into numbers; bytes above are zero. Requires planes.size() >= numbers.size() * width and
/// width <= sizeof(T).
template <class T>
requires std::is_trivially_copyable_v<T>
void read_planes(std::span<const std::byte> planes, std::span<T> numbers, std::size_t width = sizeof(T)) {
  [&]<std::size_t... widths>(std::index_sequence<widths...>) {
    ((width == widths ? detail::read_planes_of<widths>(planes.data(), numbers) : void()), ...);
  }
  (std::make_index_sequence<sizeof(T) + 1>());
}

}  // namespace splatvol::format
