// The nodes of a volume's index for a view: their children, sizes and visibility. Internal to the streamer.
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
#include "splat/splat.h"
#include "streamer/splats/cut.h"
#include "streamer/splats/frustum.h"
#include "streamer/splats/occlusion.h"
#include "streamer/splats/visibility.h"

namespace splatvol {

/// The number of a node's first point in each segment. Most files have few segments; copies only as many numbers.
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
  std::array<std::uint64_t, format::max_resolutions> values_;  // not set from count_ on
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
  [[nodiscard]] ShownValues values() const {
    const auto& opacity = page->nodes.opacity_summaries;
    return {summary(), opacity.empty() ? nullptr : &opacity[index]};
  }

  /// Returns how many splats the node has at a resolution.
  [[nodiscard]] std::uint64_t splat_count(std::size_t resolution) const;
};

/// The octree of a volume. Keeps references to the arguments of its constructor.
class NodeTree {
 public:
  /// `size_bound`: index of the kernel's name in VolumeInfo::size_bounds.
  NodeTree(const format::VolumeInfo& info, IndexPages& index, const View& view, const ValueVisibility& visibility,
           KernelKind kernel, std::size_t size_bound);

  [[nodiscard]] Result<Node> root() const;

  /// Returns the children by octant, or nullopt if their page is not there. Fails if the tree is deeper than the format
  /// allows.
  using Children = std::array<std::optional<Node>, 8>;
  [[nodiscard]] Result<std::optional<Children>> children_of(const Node& node) const;

  [[nodiscard]] std::size_t finest() const { return info_.resolutions() - 1; }
  [[nodiscard]] const View& view() const { return view_; }
  [[nodiscard]] const ValueVisibility& visibility() const { return visibility_; }

  /// Returns the bound on the size of the node's splats, world units. Requires a resolution from the node's first on.
  [[nodiscard]] double splat_bound(const Node& node, std::size_t resolution) const;

  /// Returns the logarithm to base 2 of this bound over the edge of the node's cube.
  [[nodiscard]] double splat_bound_in_cube(const Node& node, std::size_t resolution) const;

  /// Returns the largest share of the image's shorter side that a splat of the node may cover, in per cent.
  [[nodiscard]] double covered_percent(const Node& node, std::size_t resolution) const;

  /// Finds the nodes that hide others, among those that are large in the picture. Reuses the occlusion in `kept` if it
  /// is still the same, and else replaces it; asks for the same pages in both cases. Null `kept`: keeps nothing.
  /// Returns false if a page that it asked for is not there. Fails as children_of.
  [[nodiscard]] Result<bool> find_hidden(const FilledNodes& filled, std::optional<KeptOcclusion>* kept);

  /// Whether something of the node may be visible.
  [[nodiscard]] bool is_visible(const Node& node) const;

  /// Returns the sum of the squared opacities of the slices on which splats of the node may show, each times the
  /// area that they cover there, in faces of the cube.
  [[nodiscard]] double slice_weight(const Node& node, std::size_t resolution) const;

  /// Whether the node's cube may reach into the picture, or its splats at a resolution. A node without visible values
  /// must also meet a slice.
  [[nodiscard]] bool is_within_reach(const Node& node) const;
  [[nodiscard]] bool is_within_reach(const Node& node, std::size_t resolution) const;

 private:
  struct Finding {
    const FilledNodes& filled;
    const format::IndexPage* root_page;
    std::vector<KeptOcclusion::Link> links;
    bool complete = true;
  };
  [[nodiscard]] Status hide_behind(Finding& finding, const Node& node, std::size_t page, bool parent_filled);
  [[nodiscard]] bool shows(const Node& node) const;
  [[nodiscard]] double reach_of(const Node& node, std::size_t resolution) const;
  [[nodiscard]] double weight_within(const Node& node, double reach) const;
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
