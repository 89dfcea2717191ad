// Numbers in few bytes, for temporary files: corners of cells are mostly near each other.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/payload.h"

namespace splatvol {

/// Appends a number as LEB128.
inline void put_number(std::vector<std::byte>& bytes, std::uint64_t number) {
  for (; number >= 0x80; number >>= 7) bytes.push_back(static_cast<std::byte>(number | 0x80));
  bytes.push_back(static_cast<std::byte>(number));
}

/// Takes a number from the front of `bytes`. Requires that it is there.
inline std::uint64_t get_number(std::span<const std::byte>& bytes) {
  std::uint64_t number = 0;
  for (int shift = 0;; shift += 7) {
    const auto byte = std::to_integer<std::uint64_t>(bytes.front());
    bytes = bytes.subspan(1);
    number |= (byte & 0x7f) << shift;
    if (byte < 0x80) return number;
  }
}

/// The same for a number that is near `from`.
inline void put_difference(std::vector<std::byte>& bytes, std::uint64_t number, std::uint64_t from) {
  put_number(bytes, format::zigzag(static_cast<std::int64_t>(number - from)));
}
inline std::uint64_t get_difference(std::span<const std::byte>& bytes, std::uint64_t from) {
  return from + static_cast<std::uint64_t>(format::unzigzag(get_number(bytes)));
}

}  // namespace splatvol
