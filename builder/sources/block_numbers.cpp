#include "builder/sources/block_numbers.h"

#include <algorithm>
#include <span>

#include "format/codec.h"

namespace splatvol {

std::uint64_t block_number(std::uint64_t outer, std::string_view name, std::uint64_t repetition) {
  const std::uint64_t words[] = {outer, repetition, format::hash_bytes(std::as_bytes(std::span(name)))};
  return std::max<std::uint64_t>(format::hash_bytes(std::as_bytes(std::span(words))), 1);
}

std::uint64_t inner_block(std::uint64_t outer, std::uint64_t inner) {
  return outer == 0 || inner == 0 ? outer + inner : block_number(outer, {}, inner);
}

}  // namespace splatvol
