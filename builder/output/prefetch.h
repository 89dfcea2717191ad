// Memory that will be used soon.
#pragma once

#include <cstddef>

namespace splatvol {

/// Fetches memory into the cache, to be read or written soon.
inline void prefetch_lines(const void* begin, std::size_t bytes) {
  constexpr std::size_t line = 64;
  if (begin == nullptr) return;  // `bytes` may count elements that are still to be added
  for (std::size_t at = 0; at < bytes; at += line) __builtin_prefetch(static_cast<const char*>(begin) + at, 1);
}

}  // namespace splatvol
