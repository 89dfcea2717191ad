// The kernel moments on tiles, for the instruction set of this machine. Internal to the tiles.
#pragma once

#include <cstdint>
#include <span>

#include "renderer/cpu/frame.h"

namespace splatvol::tiles {

/// Computes the keys of splats with successive numbers, from `begin` on. Keys fall with what is sorted by. A splat that
/// surely draws nothing gets hidden_key, except by depth.
void moments_keys(const FrameConstants& frame, const SplatNumbers& splats, std::uint32_t begin, SortKey kind,
                  std::span<std::uint32_t> keys);

/// Projects the splats with these numbers into the slots from the first on.
void project_moments(const FrameConstants& frame, const SplatNumbers& splats, std::span<const std::uint32_t> numbers,
                     const ScreenSplats& screen);

/// Blends splats, front first, behind what the tile's pixels hold. Returns whether nothing behind them can be seen.
bool blend_moments(const FrameConstants& frame, const ScreenSplats& screen, std::span<const std::uint32_t> slots,
                   const TileArea& area, TilePixels& pixels);

/// Returns the name of the instruction set that is used.
const char* instruction_set();

}  // namespace splatvol::tiles
