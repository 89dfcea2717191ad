// Numbers of the blocks of an input: bodies, zones or parts that its files tell apart.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <utility>

namespace splatvol {

/// Returns the number of a block of a name within another block; 0 stands for none. Never returns 0.
[[nodiscard]] std::uint64_t block_number(std::uint64_t outer, std::string_view name, std::uint64_t repetition = 0);

/// Returns the number of a block within another one. 0 stands for no block, and gives the other number.
[[nodiscard]] std::uint64_t inner_block(std::uint64_t outer, std::uint64_t inner);

/// Numbers the blocks of one file. The numbers depend on the names alone, so they are the same in each file, step and
/// process that names the same blocks. Blocks of one name are told apart by their order.
class BlockNumbers {
 public:
  /// `outer`: the number of the block that holds it; 0: none does.
  [[nodiscard]] std::uint64_t next(const std::string& name, std::uint64_t outer = 0) {
    return block_number(outer, name, repetitions_[{outer, name}]++);
  }

 private:
  std::map<std::pair<std::uint64_t, std::string>, std::uint64_t> repetitions_;  // by outer block and name
};

}  // namespace splatvol
