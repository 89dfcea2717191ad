// Numbers of the blocks of an input: bodies, zones or parts that its files tell apart.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>

namespace splatvol {

/// Returns the number of a block of a name within another block; 0 stands for none. Never returns 0.
[[nodiscard]] std::uint64_t block_number(std::uint64_t outer, std::string_view name, std::uint64_t repetition = 0);

/// Returns the number of a block within another one. 0 stands for no block, and gives the other number.
[[nodiscard]] std::uint64_t inner_block(std::uint64_t outer, std::uint64_t inner);

/// Numbers the blocks of one file. The numbers depend on the names alone, so they are the same in each file, step and
/// process that names the same blocks. Blocks of one name are told apart by their order.
class BlockNumbers {
 public:
  [[nodiscard]] std::uint64_t next(const std::string& name) { return block_number(0, name, repetitions_[name]++); }

 private:
  std::map<std::string, std::uint64_t> repetitions_;
};

}  // namespace splatvol
