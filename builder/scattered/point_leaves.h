// Space cut into boxes with few points each.
#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/mesh/lanes.h"

namespace splatvol {

/// Cuts space round some thousand points into boxes, the *leaves*, of about the points' spacing: by halving, so that
/// leaves are not thin. A leaf has few points, or none. It is a part of a *block* with some more points; space where
/// there are none has no leaves. Finds points near a leaf. Keeps its memory.
class PointLeaves {
 public:
  /// A distinct point, as one vector, compared and moved as a whole.
  struct Entry {
    Lanes lanes;  // the position; then the point's index

    double operator[](int axis) const { return lanes[axis]; }
    [[nodiscard]] dvec3 position() const { return {lanes[0], lanes[1], lanes[2]}; }
    [[nodiscard]] std::uint32_t point() const { return static_cast<std::uint32_t>(lanes[3]); }
  };

  /// `own`: the first points of `positions`, of which there is at least one. The other points matter only where they
  /// are near to these. Of coincident points the first is kept. `domain` is cut; it has all positions.
  void build(std::span<const dvec3> positions, std::uint32_t own, const Box& domain);

  static constexpr std::uint32_t none = 0xffffffffU;

  struct Leaf {
    Box box;
    std::uint32_t block;
    bool has_points;
  };
  /// Leaves of a block follow each other.
  [[nodiscard]] std::span<const Leaf> leaves() const { return leaves_; }
  [[nodiscard]] std::span<const Box> blocks() const { return blocks_; }

  /// Whether a point is the first at its position.
  [[nodiscard]] bool is_kept(std::uint32_t point) const { return kept_[point] != 0; }

  /// Returns the entry nearest to a location, of those nearer than `distance`; null if there is none. The entry of
  /// point `but` does not count.
  [[nodiscard]] const Entry* nearest(const dvec3& from, double distance = std::numeric_limits<double>::infinity(),
                                     std::uint32_t but = none) const;

  /// Appends the entries in a box.
  void find(const Box& box, std::vector<Entry>& found) const;

 private:
  // A node of the tree of entries: a cache line. Its lower child follows it.
  struct Node {
    // Of its entries. Then, of a leaf, where its entries begin and end; else its upper child, and 0.
    Lanes low, high;

    [[nodiscard]] bool is_leaf() const { return high[3] != 0; }
    [[nodiscard]] std::uint32_t begin() const { return static_cast<std::uint32_t>(low[3]); }
    [[nodiscard]] std::uint32_t end() const { return static_cast<std::uint32_t>(high[3]); }
    [[nodiscard]] std::uint32_t upper() const { return begin(); }
  };
  // Where leaves come from.
  struct Origin {
    bool wanted;  // or left out
    std::uint32_t block;
  };
  void split(std::uint32_t begin, std::uint32_t end, Box cell, Origin origin);
  // A plane across an axis.
  struct Cut {
    int axis;
    double at;
  };
  Cut choose_cut(const Box& entries, Box& cell, const Origin& origin);
  void cut_to_entries(const Box& entries, Box& cell, const Origin& origin);
  void add_leaf(const Box& cell, const Origin& origin, bool has_points = false);
  std::uint32_t keep_distinct(std::uint32_t begin, std::uint32_t end, const Box& box);
  struct Search {
    Lanes from;
    std::uint32_t but;
    double square;  // of the distance of the best one
    const Entry* best;
  };
  void search(std::uint32_t number, Search& search) const;
  void find(std::uint32_t number, const Entry& low, const Entry& high, std::vector<Entry>& found) const;

  std::uint32_t own_ = 0;
  Box own_box_;
  std::vector<Entry> entries_;
  std::vector<Node> nodes_;
  std::vector<Leaf> leaves_;
  std::vector<Box> blocks_;
  std::vector<std::uint8_t> kept_;  // [point]
};

}  // namespace splatvol
