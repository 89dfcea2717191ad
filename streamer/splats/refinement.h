// Chooses the cut with the least expected error for its number of splats. Internal to the streamer.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "base/error.h"
#include "streamer/splats/cut.h"
#include "streamer/splats/error_model.h"
#include "streamer/splats/node_tree.h"

namespace splatvol {

/// Chooses for a whole view at once. A splat has a price, in squared error. The cost of a valid cut is its expected
/// error plus the price of its splats, and a pass from the leaves up finds the cheapest cut. A node is either drawn at
/// one of its resolutions or opened. Besides, it pays for seams: one for each resolution between its own and that of
/// its surroundings, which its parent chooses. A lower price gives more splats; the search looks for the price that
/// meets the goal.
class Refinement {
 public:
  /// Keeps a reference.
  explicit Refinement(const NodeTree& tree);

  /// A node that was considered. The chosen cut consists of the items that are reached from the first, the root,
  /// through the children of opened items, and are not opened themselves.
  struct Item {
    std::array<std::uint32_t, 8> children{};  // by octant; 0: no child, or nothing of it is visible
    bool expanded = false;
    bool absent = false;  // the page of its children is not there: it is drawn at its first resolution for now
    bool reached = false;
    bool wants_opening = false;  // at the current price
    bool opened = false;
    bool is_leaf = false;
    std::uint8_t first_resolution = 0;
    std::uint8_t resolution = 0;  // if it is not opened
    std::uint32_t begin = 0;      // index of its first choice
    float floor = 0;              // the least error of it and its parts, at any resolution
    float hidden = 0;             // the part of it that its own errors do not show
  };

  /// Chooses a cut; there are no items if nothing is visible. Fails as NodeTree::children_of, and with out_of_budget if
  /// it would hold more than max_bytes. The choice depends only on the goal and the index.
  [[nodiscard]] Status choose(const ErrorGoal& goal, std::uint64_t max_bytes);
  [[nodiscard]] const std::vector<Item>& items() const { return items_; }

  /// Returns the expected error of an item at a resolution, from its first on; 0 if none of its splats reach into the
  /// picture.
  [[nodiscard]] double error_of(const Item& item, std::size_t resolution) const {
    return static_cast<double>(choices(item)[resolution - item.first_resolution].error);
  }

  /// Returns the expected error of the chosen cut, mean squared.
  [[nodiscard]] double error() const { return last_.error; }

  /// Returns whether more splats than those of the chosen cut would not lessen its expected error.
  [[nodiscard]] bool is_finest() const { return last_.finest; }

 private:
  /// The node of an item, without the numbers of its first points.
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
    float offer = 0;              // cost of the cheapest cut of the item if its surroundings have this resolution
    std::uint8_t resolution = 0;  // that this cut begins with, which may be another
    bool opens = false;           // whether the cheapest cut that begins with the own resolution opens the item
  };

  /// The cheapest cut at a price.
  struct Sum {
    std::uint64_t splats = 0;
    double error = 0;    // mean squared
    bool finest = true;  // more splats would not lessen the error
    int price = 0;       // see price_of
  };
  [[nodiscard]] std::uint32_t add(const Node& node);
  [[nodiscard]] Status expand(std::uint32_t item);
  [[nodiscard]] bool is_worth_opening(const Item& item, float price) const;
  [[nodiscard]] float sum_children(const Item& item, std::span<float> offers) const;
  void settle_costs(Item& item, float price);
  [[nodiscard]] Sum choose_at(int price);
  [[nodiscard]] Result<Sum> evaluate(int price);
  [[nodiscard]] static int price_drop(const ErrorGoal& goal, const std::optional<Sum>& before, const Sum& from);
  [[nodiscard]] Status bisect(const ErrorGoal& goal, Sum coarse, Sum fine);

  [[nodiscard]] std::span<Choice> choices(const Item& item);
  [[nodiscard]] std::span<const Choice> choices(const Item& item) const;

  const NodeTree& tree_;
  const ErrorModel model_;
  const std::size_t resolutions_;
  std::uint64_t max_bytes_ = 0;
  Sum last_;              // the chosen cut's, once there is one
  float least_gain_ = 0;  // splats; an item is opened only if this may save more
  std::vector<Item> items_;
  std::vector<Located> nodes_;   // [item]
  std::vector<Choice> choices_;  // of all items, one after another
};

}  // namespace splatvol
