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
#include "splat/splat.h"
#include "streamer/splats/visibility.h"

namespace splatvol {

class FilledNodes;
struct KeptOcclusion;

/// Chooses a cut by its expected error, instead of a tolerance.
struct ErrorGoal {
  /// Error of the picture's RGB against the exact one (root mean square), as the model expects it: a picture's own is
  /// up to ten times more or less (Quality::max_error). The cut is no finer than this error needs. 0: as fine as
  /// max_splats allows.
  double expected_error = 0;

  /// The most splats, unless even the coarsest cut has more.
  std::uint64_t max_splats = std::numeric_limits<std::uint64_t>::max();

  [[nodiscard]] bool operator==(const ErrorGoal&) const = default;
};

/// How a cut is chosen. Quality (splatvol/quality.h) says how fine a picture is.
struct Detail {
  /// The largest share of the image's shorter side that one splat's size may cover, in per cent. 0: all points.
  /// Infinity: the coarsest cut.
  double tolerance_percent = 1;

  /// Draws everything at this resolution, whatever the tolerance; at most the finest of the file.
  std::optional<std::size_t> resolution = std::nullopt;

  /// Used instead of tolerance and resolution.
  std::optional<ErrorGoal> goal = std::nullopt;

  /// For a device with memory of its own: the most splats that it holds, as Rasterizer::plan_picture tells. The
  /// streamer makes the rest coarser until it fits.
  std::uint64_t device_splats = std::numeric_limits<std::uint64_t>::max();

  [[nodiscard]] bool operator==(const Detail&) const = default;
};

struct CutOptions {
  Detail detail = {};
  KernelKind kernel = KernelKind::moments;

  /// Nodes that may hide others: leaves out nodes behind an opaque front. Null: nothing is hidden.
  const FilledNodes* filled = nullptr;

  /// Keeps the occlusion for the next choice, which reuses it for the same view, values and pages. Requires always the
  /// same `filled` and kernel. Null: finds the occlusion each time.
  std::optional<KeptOcclusion>* kept_occlusion = nullptr;

  /// If a node would draw more splats than this, compares it with its children: perhaps only some of them need the
  /// detail or are in view. At 0 the cut has the fewest splats of all valid cuts within the tolerance.
  std::uint64_t compare_above = 512;

  /// Fails if choosing for a goal needs more memory than this.
  std::uint64_t max_choice_bytes = std::numeric_limits<std::uint64_t>::max();

  /// Fails if the splats and their cut need more memory than this.
  std::uint64_t max_bytes = std::numeric_limits<std::uint64_t>::max();
};

/// The points with numbers [begin, begin + count).
struct PointRange {
  std::uint64_t begin = 0;
  std::uint64_t count = 0;

  [[nodiscard]] bool operator==(const PointRange&) const = default;
};

/// A node to be drawn, at a resolution.
struct CutItem {
  Cube cube;
  std::uint64_t first_range;  // index into Cut::ranges: one for each segment 0 to resolution
  std::uint32_t resolution;
  float error;  // items with a larger error are read first. Per cent of the image that a splat covers, times the share
                // of its values that is visible; for an ErrorGoal, the squared error that a splat saves. 0: not to be
                // read, because an index page is missing, and only the page tells what to read instead
  bool sliced = false;  // its splats may show on a slice of the view
};

/// Nodes and resolutions chosen for a view, back to front: no item hides one that comes after it.
struct Cut {
  std::vector<CutItem> items;
  std::vector<PointRange> ranges;
  std::uint64_t splats = 0;
  double squared_error = 0;       // expected, mean of the picture's RGB
  double squared_goal_error = 0;  // chosen for a goal: the same with what only parts of nodes tell, as a goal counts it
  bool finest = false;            // chosen for a goal, and more splats would not lessen the expected error
  bool complete = true;           // every index page that was asked for was there

  [[nodiscard]] std::span<const PointRange> ranges_of(const CutItem& item) const {
    return std::span(ranges).subspan(static_cast<std::size_t>(item.first_range), item.resolution + 1);
  }

  [[nodiscard]] std::uint64_t memory_bytes() const {
    return items.size() * sizeof(CutItem) + ranges.size() * sizeof(PointRange);
  }

  /// Whether both draw the same points, at the same resolutions, in the same order.
  [[nodiscard]] bool operator==(const Cut& other) const;
};

class IndexPages {
 public:
  virtual ~IndexPages() = default;

  [[nodiscard]] virtual Result<std::shared_ptr<const format::IndexPage>> root() = 0;

  /// Returns the page that holds the children of `node`. Returns null if the page is not there yet and nobody should
  /// wait for it. Requires page.links[node] != IndexPage::no_node.
  [[nodiscard]] virtual Result<std::shared_ptr<const format::IndexPage>> linked(const format::IndexPage& page,
                                                                                std::uint32_t node) = 0;
};

/// Tells which splats are resident: decoded in memory, so that they can be drawn at once.
class Residency {
 public:
  virtual ~Residency() = default;

  /// Whether all visible splats of a node are resident, at resolution ranges.size() - 1.
  [[nodiscard]] virtual bool holds(std::span<const PointRange> ranges) = 0;
};

/// Chooses the cut from the index alone.
///
/// Goes from the root down, by the rule of the paper:
/// - leaves out a node that is out of view or has nothing visible in it;
/// - draws a node at its coarsest resolution whose splats are within the tolerance, from first_resolution on;
/// - if there is none, goes on with the node's children; draws a leaf at the finest resolution.
/// The result never has more splats than this rule gives (see compare_above). A node whose splats may reach the eye's
/// plane is only within the tolerance infinity. Of the coarsest detail (that tolerance, the resolution 0, a goal of one
/// splat) nodes are drawn as they are, without reading what lies below or in front of them. If the page of a node's
/// children is not there, the node counts at its first resolution. Fails with out_of_budget past max_bytes, with
/// invalid_data if the tree is deeper than the format allows, and with unsupported if the file has no sizes for the
/// kernel.
///
/// With an ErrorGoal: chooses, of all valid cuts, about the one with the least expected error for its number of splats,
/// by the model of streamer/error_model.h. Nodes that have nothing to gain stay coarse, whatever their size. The number
/// of splats comes within some per cent of the goal's, from below, unless there is nothing left to gain, or the next
/// finer choice adds more. The same holds for the error.
[[nodiscard]] Result<Cut> select_cut(const format::VolumeInfo& info, IndexPages& index, const View& view,
                                     const ValueVisibility& visibility, const CutOptions& options);

/// Chooses the best resident substitute for the cut of select_cut, or this cut itself if all of it is resident. A node
/// that is not resident is drawn a little finer, or else coarser, or its parent is drawn; so the result is a valid cut
/// too. Requires that the root's first resolution is resident. Fails as select_cut, but compares the substitute with
/// max_bytes.
[[nodiscard]] Result<Cut> select_resident_cut(const format::VolumeInfo& info, IndexPages& index, Residency& residency,
                                              const View& view, const ValueVisibility& visibility,
                                              const CutOptions& options);

}  // namespace splatvol
