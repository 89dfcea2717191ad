// The cut with the least expected error for its splats. Internal to the streamer.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
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
    std::uint32_t begin = 0;      // of its choices
    float floor = 0;              // the least error that it and its parts admit
    float hidden = 0;             // of that, what its own errors do not show
  };

  /// Fails as NodeTree::children_of, and with out_of_budget where it would hold more than max_bytes. The same index
  /// gives the same choice. Empty where nothing is visible.
  [[nodiscard]] Status choose(const ErrorGoal& goal, std::uint64_t max_bytes);
  [[nodiscard]] const std::vector<Item>& items() const { return items_; }

 private:
  /// An item's node, without where its points begin.
  struct Located {
    std::shared_ptr<const format::IndexPage> page;
    std::uint32_t index;
    Cube cube;
    std::size_t depth;
  };

  /// An item at one of its resolutions, from its first on.
  struct Choice {
    float splats = 0;  // that reach into the picture
    float error = 0;
    float seam = 0;
    float offer = 0;         // the cheapest cut of the item's cube, by the level of its parent's neighbourhood
    std::uint8_t level = 0;  // that the offer is for
    bool opens = false;      // whether the cheapest cut at this level opens the item
  };

  /// What the cheapest cut at a price comes to.
  struct Sum {
    std::uint64_t splats = 0;
    double error = 0;    // mean squared
    bool finest = true;  // no more splats would lessen the error
    int price = 0;       // see price_of
  };
  [[nodiscard]] std::uint32_t add(const Node& node);
  [[nodiscard]] Status expand(std::uint32_t item);
  [[nodiscard]] bool is_worth_opening(const Item& item, float price) const;
  void settle_costs(Item& item, float price);
  [[nodiscard]] Result<Sum> evaluate(int price);
  [[nodiscard]] static int step_to(const ErrorGoal& goal, const Sum& from);
  [[nodiscard]] Status bisect(const ErrorGoal& goal, Sum coarse, Sum fine);

  [[nodiscard]] std::span<Choice> choices(const Item& item);
  [[nodiscard]] std::span<const Choice> choices(const Item& item) const;

  const NodeTree& tree_;
  const ErrorModel model_;
  const std::size_t resolutions_;
  std::uint64_t max_bytes_ = 0;
  float least_gain_ = 0;  // splats: what is not worth more is not opened
  std::vector<Item> items_;
  std::vector<Located> nodes_;   // [item]
  std::vector<Choice> choices_;  // of all items, one after another
};

}  // namespace splatvol
