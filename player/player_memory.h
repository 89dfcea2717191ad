// How a player's memory is divided.
#pragma once

#include <cstdint>

#include "base/memory_budget.h"
#include "base/part_table.h"
#include "format/volume.h"

namespace splatvol {

/// What a player draws of a file.
enum class DrawnParts { any, splats, cells };

/// The memory for everything that is read of a file and held, in shares. Each share has its bytes whatever the others
/// hold, so that a picture depends on the memory only, and not on what was drawn before.
class PlayerMemory {
 public:
  /// The shares depend on what the file has, whether it is one of several steps, and on what is drawn of it.
  PlayerMemory(std::uint64_t bytes, const format::Volume& volume, bool has_steps, DrawnParts drawn,
               bool has_streamlines);

  MemoryBudget budget;
  MemoryShare splats;       // pages, rows and draw lists
  MemoryShare cells;        // decoded cells, and parts that they are made of
  MemoryShare next_cells;   // those of the next step of a series
  MemoryShare sweep;        // what waits while cells are drawn
  MemoryShare patches;      // of the boundary
  MemoryShare streamlines;  // lines, their tubes, and cells that they wait for
  PartTable table;

 private:
  struct Sizes {
    std::uint64_t splats = 0, cells = 0, next_cells = 0, sweep = 0, patches = 0, streamlines = 0;
  };
  [[nodiscard]] static Sizes sizes_of(std::uint64_t bytes, const format::Volume& volume, bool has_steps,
                                      DrawnParts drawn, bool has_streamlines);
  PlayerMemory(std::uint64_t bytes, const Sizes& sizes);
};

}  // namespace splatvol
