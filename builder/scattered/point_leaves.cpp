#include "builder/scattered/point_leaves.h"

#include <algorithm>
#include <utility>

namespace splatvol {
namespace {

constexpr std::uint32_t leaf_points = 4, block_points = 32;

// Points in a box so many times smaller than theirs are cut out of it at once, instead of by halving.
constexpr double cut_ratio = 64;

// Returns that of the vector in the first three lanes.
double squared_length(const Lanes& v) {
  const Lanes squares = v * v;
  return squares[0] + squares[1] + squares[2];
}

}  // namespace

void PointLeaves::build(std::span<const dvec3> positions, std::uint32_t own, const Box& domain) {
  own_ = own;
  own_box_ = {};
  entries_.clear();
  nodes_.clear();
  leaves_.clear();
  blocks_.clear();
  kept_.assign(positions.size(), 0);
  for (std::uint32_t i = 0; i < positions.size(); ++i) {
    const dvec3& p = positions[i];
    entries_.push_back({Lanes{p.x, p.y, p.z, static_cast<double>(i)}});
    if (i < own) own_box_.include(p);
  }
  split(0, static_cast<std::uint32_t>(entries_.size()), domain, {true, none});
}

void PointLeaves::add_leaf(const Box& cell, const Origin& origin, bool has_points) {
  if (origin.wanted && origin.block != none) leaves_.push_back({cell, origin.block, has_points});
}

// Cuts `cell`, which has these entries.
void PointLeaves::split(std::uint32_t begin, std::uint32_t end, Box cell, Origin origin) {
  Entry low = entries_[begin], high = low;
  for (std::uint32_t i = begin + 1; i < end; ++i) {
    const Lanes& entry = entries_[i].lanes;
    low.lanes = entry < low.lanes ? entry : low.lanes;
    high.lanes = entry > high.lanes ? entry : high.lanes;
  }
  const Box box{low.position(), high.position()};
  const std::size_t number = nodes_.size();
  const std::uint32_t first = low.point();
  low.lanes[3] = begin, high.lanes[3] = 0;
  nodes_.push_back({low.lanes, high.lanes});
  // Every location of the cell is nearer to its entries.
  if (first >= own_ && squared_distance(box, own_box_) > squared_length(cell.extent())) origin.wanted = false;
  if (end - begin <= leaf_points || box.low == box.high) {
    const std::uint32_t kept = keep_distinct(begin, end, box);
    nodes_[number].high[3] = kept;
    for (std::uint32_t i = begin; i < kept; ++i) kept_[entries_[i].point()] = 1;
    return add_leaf(cell, origin, true);
  }
  if (origin.block == none && end - begin <= block_points) {
    origin.block = static_cast<std::uint32_t>(blocks_.size());
    blocks_.push_back(cell);
  }
  const Cut cut = choose_cut(box, cell, origin);
  const auto at = [&](std::uint32_t i) { return entries_.begin() + i; };
  const auto upper_entries =
      std::partition(at(begin), at(end), [&](const Entry& entry) { return entry[cut.axis] < cut.at; });
  const auto half = static_cast<std::uint32_t>(upper_entries - entries_.begin());
  Box lower = cell, upper = cell;
  lower.high[cut.axis] = upper.low[cut.axis] = cut.at;
  split(begin, half, lower, origin);
  nodes_[number].low[3] = static_cast<double>(nodes_.size());
  split(half, end, upper, origin);
}

// Returns a plane with entries on both sides, after parts of the cell without entries are cut off.
PointLeaves::Cut PointLeaves::choose_cut(const Box& entries, Box& cell, const Origin& origin) {
  for (;;) {
    cut_to_entries(entries, cell, origin);
    const int axis = longest_axis(cell.extent());
    const double middle = (cell.low[axis] + cell.high[axis]) / 2;
    if (middle <= cell.low[axis] || middle >= cell.high[axis]) {  // the cell is as small as rounding
      const int longest = longest_axis(entries.extent());
      return {longest, entries.high[longest]};
    }
    Box empty = cell;
    if (middle <= entries.low[axis])
      empty.high[axis] = cell.low[axis] = middle;
    else if (middle > entries.high[axis])
      empty.low[axis] = cell.high[axis] = middle;
    else
      return {axis, middle};
    add_leaf(empty, origin);
  }
}

// Leaves a cell that is not much larger than the box of its entries. Up to six leaves are cut off.
void PointLeaves::cut_to_entries(const Box& entries, Box& cell, const Origin& origin) {
  const dvec3 extent = entries.extent(), whole = cell.extent();
  const double width = extent[longest_axis(extent)];
  if (cut_ratio * width > whole[longest_axis(whole)]) return;
  for (int axis = 0; axis < 3; ++axis) {
    const double low = entries.low[axis] - width, high = entries.high[axis] + width;
    Box off = cell;
    if (low > cell.low[axis]) {
      off.high[axis] = cell.low[axis] = low;
      add_leaf(off, origin);
    }
    off = cell;
    if (high < cell.high[axis]) {
      off.low[axis] = cell.high[axis] = high;
      add_leaf(off, origin);
    }
  }
}

// Moves the first of coincident entries to the front, and returns their end. Requires few entries, or one position.
std::uint32_t PointLeaves::keep_distinct(std::uint32_t begin, std::uint32_t end, const Box& box) {
  const auto first = entries_.begin() + begin, last = entries_.begin() + end;
  const auto comes_before = [](const Entry& a, const Entry& b) { return a.point() < b.point(); };
  if (box.low == box.high) {
    std::iter_swap(first, std::min_element(first, last, comes_before));
    return begin + 1;
  }
  std::sort(first, last, comes_before);
  auto kept = first;
  for (auto entry = first; entry != last; ++entry)
    if (std::none_of(first, kept, [&](const Entry& other) { return other.position() == entry->position(); }))
      *kept++ = *entry;
  return static_cast<std::uint32_t>(kept - entries_.begin());
}

const PointLeaves::Entry* PointLeaves::nearest(const dvec3& from, double distance, std::uint32_t but) const {
  Search search{Lanes{from.x, from.y, from.z}, but, distance * distance, nullptr};
  this->search(0, search);
  return search.best;
}

void PointLeaves::search(std::uint32_t number, Search& search) const {
  const Node& node = nodes_[number];
  if (node.is_leaf()) {
    for (std::uint32_t i = node.begin(); i < node.end(); ++i) {
      const double square = squared_length(entries_[i].lanes - search.from);
      if (square < search.square && entries_[i].point() != search.but)
        search.square = square, search.best = &entries_[i];
    }
    return;
  }
  const auto square_to = [&](const Node& child) {
    const Lanes below = child.low - search.from, above = search.from - child.high;
    const Lanes outside = below > above ? below : above;
    return squared_length(outside > 0 ? outside : Lanes{});
  };
  std::uint32_t near = number + 1, far = node.upper();
  double to_near = square_to(nodes_[near]), to_far = square_to(nodes_[far]);
  if (to_far < to_near) std::swap(near, far), std::swap(to_near, to_far);
  if (to_near < search.square) this->search(near, search);
  if (to_far < search.square) this->search(far, search);
}

void PointLeaves::find(const Box& box, std::vector<Entry>& found) const {
  constexpr double most = std::numeric_limits<double>::max();
  find(0, {Lanes{box.low.x, box.low.y, box.low.z, -most}}, {Lanes{box.high.x, box.high.y, box.high.z, most}}, found);
}

void PointLeaves::find(std::uint32_t number, const Entry& low, const Entry& high, std::vector<Entry>& found) const {
  const auto is_outside = [&](const Lanes& least, const Lanes& largest) {
    return any((largest < low.lanes) | (least > high.lanes));
  };
  const Node& node = nodes_[number];
  if (is_outside(node.low, node.high)) return;
  if (!node.is_leaf()) {
    find(number + 1, low, high, found);
    return find(node.upper(), low, high, found);
  }
  std::size_t kept = found.size();
  found.resize(kept + node.end() - node.begin());
  for (std::uint32_t i = node.begin(); i < node.end(); ++i) {
    found[kept] = entries_[i];
    kept += is_outside(entries_[i].lanes, entries_[i].lanes) ? 0 : 1;
  }
  found.resize(kept);
}

}  // namespace splatvol
