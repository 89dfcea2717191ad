// The kernel moments on tiles, for the instruction set of this machine. Internal to the tiles.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "renderer/cpu/frame.h"

namespace splatvol::tiles {

/// Computes the keys of a range's splats. Keys fall with what is sorted by. A splat that surely draws nothing gets
/// hidden_key, except by depth. Requires keys.size() == range.count.
void moments_keys(const FrameConstants& frame, const RangeInView& range, SortKey kind, std::span<std::uint32_t> keys);

/// Returns the front of a key by front.
[[nodiscard]] float front_of_key(std::uint32_t key);

/// Projects the splats with these numbers into the slots from the first on.
void project_moments(const FrameConstants& frame, const SplatNumbers& splats, std::span<const std::uint32_t> numbers,
                     const ScreenSplats& screen);

/// Blends splats, front first, behind what the tile's pixels hold. Returns whether nothing behind them can be seen.
bool blend_moments(const FrameConstants& frame, const ScreenSplats& screen, std::span<const std::uint32_t> slots,
                   const TileArea& area, TilePixels& pixels);

/// What mixing needs for a tile. Kept between tiles for its memory.
struct SlabWorkspace {
  struct Splat {
    float front, back;  // depths
    float weight, by_chord, kept;
    std::uint32_t slot;
    std::uint8_t grid;  // 2^grid: the spacing of its samples
    bool bounded;
    bool partial;  // surfaces may hide a part of it
  };
  std::vector<float> planes;
  std::vector<std::uint64_t> keys;
  std::vector<Splat> splats;          // by front
  std::vector<std::uint32_t> active;  // numbers of splats
  std::vector<Slab> slabs;

  [[nodiscard]] std::uint64_t memory_bytes() const {
    return sizeof(float) * planes.capacity() + sizeof(std::uint64_t) * keys.capacity() +
           sizeof(Splat) * splats.capacity() + sizeof(std::uint32_t) * active.capacity() +
           sizeof(Slab) * slabs.capacity();
  }
};

/// Mixes near splats in slabs of the tile within `depths`, and blends the slabs, front first, behind what the pixels
/// hold. Requires all splats of the tile within these depths. The order of the slots does not matter. Returns whether
/// nothing behind the slabs can be seen.
bool blend_slabs(const FrameConstants& frame, const ScreenSplats& screen, std::span<const std::uint32_t> slots,
                 const Slab& depths, const TileArea& area, SlabWorkspace& workspace, TilePixels& pixels);

/// Returns the name of the instruction set that is used.
const char* instruction_set();

}  // namespace splatvol::tiles
