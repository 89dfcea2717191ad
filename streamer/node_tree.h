// The nodes of a volume's index as a view sees them. Internal to the streamer.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "format/octree.h"
#include "format/volume_info.h"
#include "scene/scene.h"
#include "streamer/cut.h"
#include "streamer/frustum.h"
#include "streamer/occlusion.h"
#include "streamer/splat.h"
#include "streamer/visibility.h"

namespace splatvol {

/// Where a node's points begin in each segment. Most files have few of them, and only those are copied.
class Begins {
 public:
  explicit Begins(std::size_t segments) : count_(segments) { std::fill_n(values_.begin(), count_, 0); }
  Begins(const Begins& other) : count_(other.count_) { std::copy_n(other.values_.begin(), count_, values_.begin()); }
  Begins& operator=(const Begins& other) {
    count_ = other.count_;
    std::copy_n(other.values_.begin(), count_, values_.begin());
    return *this;
  }

  [[nodiscard]] std::uint64_t& operator[](std::size_t segment) { return values_[segment]; }
  [[nodiscard]] std::uint64_t operator[](std::size_t segment) const { return values_[segment]; }

 private:
  std::size_t count_;
  std::array<std::uint64_t, format::max_resolutions> values_;  // from count_ on: not set
};

struct Node {
  std::shared_ptr<const format::IndexPage> page;
  std::uint32_t index;
  Cube cube;
  Begins begins;
  std::size_t depth;

  [[nodiscard]] std::uint8_t child_mask() const { return page->nodes.child_masks[index]; }
  [[nodiscard]] std::size_t first_resolution() const { return page->nodes.first_resolutions[index]; }
  [[nodiscard]] std::span<const std::uint64_t> counts() const { return page->nodes.counts_of(index); }
  [[nodiscard]] const format::ValueSummary& summary() const { return page->nodes.summaries[index]; }

  /// Points of resolution r.
  [[nodiscard]] std::uint64_t splat_count(std::size_t resolution) const;
};

/// Keeps references to all that it is made of.
class NodeTree {
 public:
  /// `size_bound`: which of the index's arrays of sizes is the kernel's.
  NodeTree(const format::VolumeInfo& info, IndexPages& index, const View& view, const ValueVisibility& visibility,
           KernelKind kernel, std::size_t size_bound);

  [[nodiscard]] Result<Node> root() const;

  /// By octant; nullopt where their page is not there. Fails where the tree is deeper than the format allows.
  using Children = std::array<std::optional<Node>, 8>;
  [[nodiscard]] Result<std::optional<Children>> children_of(const Node& node) const;

  [[nodiscard]] std::size_t finest() const { return info_.resolutions() - 1; }
  [[nodiscard]] const View& view() const { return view_; }
  [[nodiscard]] const ValueVisibility& visibility() const { return visibility_; }

  /// No splat of the node is larger; world units. Requires a resolution from the node's first on.
  [[nodiscard]] double splat_bound(const Node& node, std::size_t resolution) const;

  /// Base 2 logarithm of that bound over the edge of the node's cube.
  [[nodiscard]] double splat_bound_in_cube(const Node& node, std::size_t resolution) const;

  /// Percent of the image's shorter side that a splat of the node may cover.
  [[nodiscard]] double covered_percent(const Node& node, std::size_t resolution) const;

  /// Finds what hides other nodes, among those that are large in the picture, or takes what is in `kept` where that is
  /// what it would find; asks for the same pages in both cases. Null: keeps nothing. False where a page that would tell
  /// is not there. Fails as children_of.
  [[nodiscard]] Result<bool> find_hidden(const FilledNodes& filled, std::optional<KeptOcclusion>* kept);

  /// Whether something of the node may show.
  [[nodiscard]] bool is_visible(const Node& node) const;

  /// Whether the node's splats may reach into the picture; without a resolution: its cube.
  [[nodiscard]] bool is_within_reach(const Node& node) const { return frustum_.touches(node.cube, 0); }
  [[nodiscard]] bool is_within_reach(const Node& node, std::size_t resolution) const;

 private:
  struct Finding {
    const FilledNodes& filled;
    const format::IndexPage* root_page;
    std::vector<KeptOcclusion::Link> links;
    bool complete = true;
  };
  [[nodiscard]] Status hide_behind(Finding& finding, const Node& node, std::size_t page, bool parent_filled);
  [[nodiscard]] Result<bool> holds_still(const KeptOcclusion& kept) const;

  const format::VolumeInfo& info_;
  IndexPages& index_;
  const View& view_;
  const Frustum frustum_;
  const ValueVisibility& visibility_;
  const KernelKind kernel_;
  const std::size_t size_bound_;
  Occlusion occlusion_;
};

}  // namespace splatvol
