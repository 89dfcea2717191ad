// The kernel octant on tiles, for the instruction set of this machine. Internal to the tiles.
#pragma once

#include <cstdint>
#include <span>

#include "renderer/cpu/frame.h"

namespace splatvol::tiles {

/// As moments_keys.
void octant_keys(const FrameConstants& frame, const SplatNumbers& splats, std::uint32_t begin, SortKey kind,
                 std::span<std::uint32_t> keys);

/// As project_moments.
void project_octant(const FrameConstants& frame, const SplatNumbers& splats, std::span<const std::uint32_t> numbers,
                    const ScreenSplats& screen);

/// As blend_moments.
bool blend_octant(const FrameConstants& frame, const ScreenSplats& screen, std::span<const std::uint32_t> slots,
                  const TileArea& area, TilePixels& pixels);

}  // namespace splatvol::tiles
