#include "player/player_memory.h"

#include <algorithm>

#include "format/cell_reader.h"
#include "player/scene_surfaces.h"

namespace splatvol {
namespace {

// Patches have at most one part in so many, and streamlines have one.
constexpr std::uint64_t memory_per_patches = 4;
constexpr std::uint64_t memory_per_streamlines = 4;

}  // namespace

// The rest is divided in 32 parts. Where cells are drawn, splats only stand in for them.
PlayerMemory::Sizes PlayerMemory::sizes_of(std::uint64_t bytes, const format::Volume& volume, bool has_steps,
                                           DrawnParts drawn, bool has_streamlines) {
  Sizes sizes;
  sizes.patches = std::min(bytes / memory_per_patches, bytes_of_patches(volume));
  if (has_streamlines) sizes.streamlines = bytes / memory_per_streamlines;
  const std::uint64_t rest = bytes - sizes.patches - sizes.streamlines;
  if (drawn != DrawnParts::splats && format::CellReader::has_cells(volume)) {
    const bool only_cells = drawn == DrawnParts::cells;
    // One picture takes most cells once: what waits needs more room than they. Pictures that follow need them again.
    sizes.sweep = rest / 32 * (only_cells ? 18 : 12);
    sizes.cells = rest / 32 * (only_cells ? 10 : 12) / (has_steps ? 2 : 1);
    sizes.next_cells = has_steps ? sizes.cells : 0;
  }
  sizes.splats = rest - sizes.sweep - sizes.cells - sizes.next_cells;
  return sizes;
}

PlayerMemory::PlayerMemory(std::uint64_t bytes, const format::Volume& volume, bool has_steps, DrawnParts drawn,
                           bool has_streamlines)
    : PlayerMemory(bytes, sizes_of(bytes, volume, has_steps, drawn, has_streamlines)) {}

PlayerMemory::PlayerMemory(std::uint64_t bytes, const Sizes& sizes)
    : budget(bytes),
      splats(budget, sizes.splats),
      cells(budget, sizes.cells),
      next_cells(budget, sizes.next_cells),
      sweep(budget, sizes.sweep),
      patches(budget, sizes.patches),
      streamlines(budget, sizes.streamlines),
      table(budget) {}

}  // namespace splatvol
