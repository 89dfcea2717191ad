// A streamer's data on a frame, and on its target cut. Internal to the streamer.
#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "streamer/splats/clip.h"
#include "streamer/splats/streamer.h"

namespace splatvol {

struct Streamer::Frame {
  Cut cut;
  ValueVisibility visibility;
  ClipRegion clip;
  std::vector<Slice> slices;
  Reservation reservation;
  std::vector<PartPointer> rows;              // held
  std::map<RangeName, ClippedRange> clipped;  // with a clip region: of all ranges in or near it
  std::vector<std::uint32_t> range_items;     // [range of the list]: of the cut
  std::vector<std::uint32_t> drawn_items;     // items that have splats
  FrameSplats splats;

  /// Bytes of the list and of clipped rows.
  [[nodiscard]] std::uint64_t memory_bytes() const;
};

/// The cut that a view should be drawn with, chosen from the index pages that are there.
struct Streamer::TargetCut {
  View view;
  ValueVisibility visibility;
  Detail asked;
  Choice choice;
};

}  // namespace splatvol
