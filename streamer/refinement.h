// The cut with the least expected error for its splats. Internal to the streamer.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "base/error.h"
#include "streamer/cut.h"
#include "streamer/error_model.h"
#include "streamer/node_tree.h"

namespace splatvol {

/// Chooses for a whole view at once. At a price for a splat - so much squared error - every valid cut has a cost, its
/// expected error and its splats together, and the cheapest cut is found from the leaves up: a node is drawn at one of
/// its resolutions or opened, and pays for the steps between its own resolution and the one that its parent took as
/// the level of the neighbourhood. The price is then what meets the goal: the lower, the more splats.
class Refinement {
 public:
  /// Keeps a reference.
  explicit Refinement(const NodeTree& tree);

  /// Nodes that were looked at. What is chosen holds for those that are reached from the first, the root, through
  /// `children` of nodes that are opened.
  struct Item {
    std::array<std::uint32_t, 8> children{};  // by octant; 0: none, or nothing of it visible
    bool expanded = false;
    bool absent = false;  // the page of its children is not there: to be drawn at its first resolution, for now
    bool reached = false;
    bool wants_opening = false;  // at the price
    bool opened = false;
    bool is_leaf = false;
    std::uint8_t first_resolution = 0;
    std::uint8_t resolution = 0;  // where it is not opened
  };

  /// Fails as NodeTree::children_of. The same index gives the same choice. Empty where nothing is visible.
  [[nodiscard]] Status choose(const ErrorGoal& goal);
  [[nodiscard]] const std::vector<Item>& items() const { return items_; }
  [[nodiscard]] const Node& node(std::uint32_t item) const { return nodes_[item]; }

 private:
  /// What the cheapest cut at a price comes to.
  struct Sum {
    std::uint64_t splats = 0;
    double error = 0;    // mean squared
    bool finest = true;  // no more splats would lessen the error
    int price = 0;       // see price_of
  };
  [[nodiscard]] std::uint32_t add(const Node& node);
  [[nodiscard]] Status expand(std::uint32_t item);
  [[nodiscard]] bool is_worth_opening(std::uint32_t item, float price) const;
  void settle_costs(std::uint32_t item, float price);
  [[nodiscard]] Result<Sum> evaluate(int price);
  [[nodiscard]] static int step_to(const ErrorGoal& goal, const Sum& from);
  [[nodiscard]] Status bisect(const ErrorGoal& goal, Sum coarse, Sum fine);

  const NodeTree& tree_;
  const ErrorModel model_;
  const std::size_t resolutions_;
  float least_gain_ = 0;  // splats: what is not worth more is not opened
  std::vector<Item> items_;
  std::vector<Node> nodes_;    // [item]
  std::vector<float> floors_;  // [item]: the least error that it and its parts admit
  std::vector<float> hidden_;  // [item]: of that, what its own errors do not show

  // [item][resolution]
  std::vector<float> splats_;  // that reach into the picture
  std::vector<float> errors_;
  std::vector<float> seams_;
  std::vector<float> costs_;          // of the cheapest cut of the item's cell, by the level of its neighbourhood
  std::vector<float> offers_;         // the same, by the level of the parent's
  std::vector<std::uint8_t> levels_;  // that the offer is for
  std::vector<std::uint8_t> opens_;   // whether that cut opens the item
};

}  // namespace splatvol
