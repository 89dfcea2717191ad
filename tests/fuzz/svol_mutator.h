// Mutates .svol files so that their hashes, lengths and offsets stay correct.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace splatvol::fuzz {

/// Mutates one part of the .svol file of `size` bytes at `data`, and mends everything that depends on it. Now and then,
/// and if the parts cannot be found, mutates bytes without mending. Returns the new size, at most `max_size`.
[[nodiscard]] std::size_t mutate_volume(std::uint8_t* data, std::size_t size, std::size_t max_size, unsigned seed);

/// Writes to `out` the first file with one part of the second, or with several. Returns 0 if there is no such file.
[[nodiscard]] std::size_t cross_volumes(std::span<const std::byte> first, std::span<const std::byte> second,
                                        std::span<std::byte> out, unsigned seed);

}  // namespace splatvol::fuzz
