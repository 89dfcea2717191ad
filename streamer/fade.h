// Changes resolutions without a jump: for a while, draws a region both as it was and as it will be, with weights that
// add up to one.
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "base/math.h"
#include "scene/scene.h"
#include "streamer/cut.h"

namespace splatvol {

/// A region that fades: the cube of a node that one of the two cuts draws as a whole.
struct Fade {
  Cube cube;
  double weight;  // of the splats that come; those that leave have the rest
};

/// A cut with regions that are drawn from two cuts. Without fades it is an ordinary cut.
struct FadingCut {
  /// The role of an item.
  struct Role {
    std::uint32_t fade = no_fade;  // index into FadingCut::fades
    bool leaving = false;
  };
  static constexpr std::uint32_t no_fade = std::numeric_limits<std::uint32_t>::max();

  View view;                // that it was made for
  Cut cut;                  // back to front; of two items that overlap, the larger first
  std::vector<Role> roles;  // [item]; empty if there are no fades
  std::vector<Fade> fades;

  [[nodiscard]] float weight_of(std::size_t item) const;
};

struct FadeOptions {
  double change = 1;              // share of a change that this call makes, (0, 1]
  std::uint64_t most_splats = 0;  // most splats besides those of the next cut
};

/// Returns the cut to draw after `last`, on the way to `next`. Regions that differ begin to fade; regions that fade go
/// on. A region that should change again waits until its fades end. A region changes at once if:
/// - `last` does not show it, because it was out of view;
/// - there is no room for the splats of both cuts;
/// - its old splats are not resident any more.
///
/// If `next` stays the same, calls end in `next`. Requires that both cuts are of the same file, `root` is the cube of
/// its octree, and `next` is valid for `view`.
[[nodiscard]] FadingCut fade(const Cube& root, const View& view, const FadingCut& last, Cut next, Residency& residency,
                             const FadeOptions& options);

}  // namespace splatvol
