// The view-dependent cut (Meredith and Ma 2001, section 3.3): which node is drawn, and at which resolution.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "format/octree.h"
#include "format/volume_info.h"
#include "scene/scene.h"
#include "streamer/splat.h"
#include "streamer/visibility.h"

namespace splatvol {

class FilledNodes;
struct KeptOcclusion;

/// A cut by its expected error, instead of a tolerance.
struct ErrorGoal {
  /// Of the picture's RGB against the exact one (root mean square). No finer than this takes; 0: as fine as the splats
  /// allow.
  double max_error = 0;

  /// No more splats than these, unless even the coarsest cut has more.
  std::uint64_t max_splats = std::numeric_limits<std::uint64_t>::max();

  [[nodiscard]] bool operator==(const ErrorGoal&) const = default;
};

struct CutOptions {
  /// The largest share of the image's shorter side that one splat's size may cover, in percent. 0: all points;
  /// infinity: the coarsest.
  double tolerance_percent = 1;

  KernelKind kernel = KernelKind::moments;

  /// Draw everything at this resolution, whatever the tolerance.
  std::optional<std::size_t> resolution;

  /// Instead of both: where the expected error for each splat is largest, first.
  std::optional<ErrorGoal> goal;

  /// What may hide something: with it, nodes behind an opaque front are left out. Null: nothing is hidden.
  const FilledNodes* filled = nullptr;

  /// Where what hides is kept for the next choice, which need not find it again for the same view, values and pages.
  /// One is for one `filled` and kernel. Null: it is found each time.
  std::optional<KeptOcclusion>* kept_occlusion = nullptr;

  /// A node that would draw more splats than this is compared with its children, of which only some may need the detail
  /// or be in sight. At 0 the cut has the fewest splats of all valid cuts within the tolerance.
  std::uint64_t compare_above = 512;

  /// Give up where choosing for a goal would take more memory than this.
  std::uint64_t max_choice_bytes = std::numeric_limits<std::uint64_t>::max();

  /// Give up where the splats and their cut would take more memory than this.
  std::uint64_t max_bytes = std::numeric_limits<std::uint64_t>::max();
};

/// Positions [begin, begin + count) of the point array.
struct PointRange {
  std::uint64_t begin = 0;
  std::uint64_t count = 0;

  [[nodiscard]] bool operator==(const PointRange&) const = default;
};

/// A node to be drawn.
struct CutItem {
  Cube cube;
  std::uint64_t first_range;  // index into Cut::ranges: one for each segment 0 to resolution
  std::uint32_t resolution;
  float error;  // what goes first where it is largest: percent of the image that a splat covers, times the share of its
                // values that is visible; for an ErrorGoal, the squared error that a splat saves. 0: not worth reading,
                // what is wanted shows with an index page that is missing
};

/// Nodes and resolutions chosen for a view, back to front: no item hides one that comes after it.
struct Cut {
  std::vector<CutItem> items;
  std::vector<PointRange> ranges;
  std::uint64_t splats = 0;
  double squared_error = 0;  // expected, mean of the picture's RGB
  bool complete = true;      // no index page was missing

  [[nodiscard]] std::span<const PointRange> ranges_of(const CutItem& item) const {
    return std::span(ranges).subspan(item.first_range, item.resolution + 1);
  }

  [[nodiscard]] std::uint64_t memory_bytes() const {
    return items.size() * sizeof(CutItem) + ranges.size() * sizeof(PointRange);
  }

  /// Whether both draw the same points in the same order.
  [[nodiscard]] bool operator==(const Cut& other) const;
};

/// Where the cut gets index pages from.
class IndexPages {
 public:
  virtual ~IndexPages() = default;

  /// The page of the root node.
  [[nodiscard]] virtual Result<std::shared_ptr<const format::IndexPage>> root() = 0;

  /// The page that holds the children of `node`; null where it is not there yet, and the cut is not to wait. Requires
  /// page.links[node] != IndexPage::no_node.
  [[nodiscard]] virtual Result<std::shared_ptr<const format::IndexPage>> linked(const format::IndexPage& page,
                                                                                std::uint32_t node) = 0;
};

/// What can be drawn at once.
class Residency {
 public:
  virtual ~Residency() = default;

  /// Whether all visible splats of a node are there at resolution ranges.size() - 1.
  [[nodiscard]] virtual bool holds(std::span<const PointRange> ranges) = 0;
};

/// Chooses the cut from the index alone.
///
/// From the root down: nodes outside of the view or without anything visible in them are left out; a node is drawn at
/// the first resolution from its first_resolution on whose splats are within the tolerance, else its children are
/// asked; a leaf that never satisfies is drawn at the finest. Never more splats than that rule of the paper's gives. A
/// node whose splats may reach the eye's plane satisfies no tolerance but infinity. A node whose children are asked,
/// but in a page that is not there, counts at its first resolution. Fails with out_of_budget past max_bytes, with
/// invalid_data where the tree is deeper than the format allows, and with unsupported where the file has no sizes for
/// the kernel.
///
/// For an ErrorGoal: of all valid cuts about the one with the least expected error for its splats, by the model of
/// streamer/error_model.h: nodes without anything to gain stay coarse, whatever their size. The goal's splats are met
/// within some per cent from below, unless there is nothing left to gain or a step takes more; so is its error.
[[nodiscard]] Result<Cut> select_cut(const format::VolumeInfo& info, IndexPages& index, const View& view,
                                     const ValueVisibility& visibility, const CutOptions& options);

/// The best that can be drawn at once in place of what select_cut chooses; the same where all of that is there. A node
/// that is not there is drawn a little finer, or else coarser, or by its parent; so this is a valid cut, too. Requires
/// that the root's first resolution is there. Fails as select_cut, but for max_bytes counts what is drawn.
[[nodiscard]] Result<Cut> select_resident_cut(const format::VolumeInfo& info, IndexPages& index, Residency& residency,
                                              const View& view, const ValueVisibility& visibility,
                                              const CutOptions& options);

}  // namespace splatvol
