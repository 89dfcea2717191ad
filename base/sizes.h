// Numbers of a file as numbers of memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <string_view>

#include "base/error.h"

namespace splatvol {

/// Returns a number that a file states as one of memory. Fails if memory has no such number: where std::size_t has 32
/// bits, from 4 GiB on. `what` begins the message. Numbers that are known to be small need no check.
[[nodiscard]] inline Result<std::size_t> as_size(std::uint64_t number, std::string_view what) {
  constexpr std::uint64_t most = std::numeric_limits<std::size_t>::max();
  if (number > most)
    return fail(ErrorCode::out_of_budget, "{}: {} bytes at once are more than this program can address", what, number);
  return static_cast<std::size_t>(number);
}

}  // namespace splatvol
