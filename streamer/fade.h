// Changes of resolution without a jump: for a while, what changes is drawn as it was and as it will be, by weights that
// add up to one.
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "base/math.h"
#include "scene/scene.h"
#include "streamer/cut.h"

namespace splatvol {

/// A region that is changing: a node's cube, drawn as one node in one of two cuts.
struct Fade {
  Cube cube;
  double weight;  // of what comes; what leaves has the rest
};

/// A cut of which regions are drawn from two cuts. Without fades it is a cut like another.
struct FadingCut {
  /// What an item is part of.
  struct Part {
    std::uint32_t fade = no_fade;
    bool leaving = false;
  };
  static constexpr std::uint32_t no_fade = std::numeric_limits<std::uint32_t>::max();

  View view;                // for which it was made
  Cut cut;                  // back to front; where two of its items overlap, the larger first
  std::vector<Part> parts;  // [item]; none where there are no fades
  std::vector<Fade> fades;

  [[nodiscard]] float weight_of(std::size_t item) const;
};

struct FadeOptions {
  double change = 1;              // share of a change that is made now, (0, 1]
  std::uint64_t most_splats = 0;  // that may be drawn besides those of the next cut
};

/// What is drawn after `last` where `next` is to be: regions that differ begin to fade, those that fade go on. A region
/// that is to change again waits for its fades to end. What `last` does not show, out of sight as it was, is shown at
/// once; and so is a region for whose splats there is no room, or whose old splats are not there any more. With steady
/// `next` it ends in `next`. Both are of the same file, `root` the cube of its octree, and `next` valid for `view`.
[[nodiscard]] FadingCut fade(const Cube& root, const View& view, const FadingCut& last, Cut next, Residency& residency,
                             const FadeOptions& options);

}  // namespace splatvol
