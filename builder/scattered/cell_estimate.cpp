#include "builder/scattered/cell_estimate.h"

#include <algorithm>
#include <array>
#include <functional>
#include <limits>

#include "builder/scattered/gradient_fit.h"
#include "builder/scattered/selection.h"
#include "builder/scattered/trimming.h"

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity(), nan = std::numeric_limits<double>::quiet_NaN();
constexpr std::uint32_t no_entry = std::numeric_limits<std::uint32_t>::max();

constexpr std::uint32_t bucket_points = 8;

// Most times that a cell is measured anew because the rays did not fit its shape, and most cuts of one that is trimmed.
constexpr int most_attempts = 12, most_cuts = 32;

// The middle of a box stands for all points in it, if the box is so much smaller than it is far.
constexpr double stand_in_ratio = 0.125;

// With more buckets outside near a point, the tree is searched from its root.
constexpr std::size_t most_near = 64;

// Labels of borders: the sides of the domain, cuts, then points that stand for others.
constexpr std::uint32_t first_cut = CellRays::first_border + 6, first_stand_in = first_cut + most_cuts;

// A cell is looked for within so many times the usual distance of the last cell's vertices, and at least within so many
// times that of its own.
constexpr double usual_bounds = 12, least_bounds = 6;

// Least cosine of the angle between the direction to a neighbour and the direction away from a vertex, if the neighbour
// lies on the other side of the point.
constexpr double min_facing = 0.4;

// A cut through the point passes it at this share of the distance to the neighbour: its dual point is finite.
constexpr double cut_distance = 1e-4;

// Whether the plane of a label belongs neither to a point nor to one that stands for others.
bool is_border(std::uint32_t label) { return label >= CellRays::first_border && label < first_stand_in; }

double quantile(std::vector<double>& items, double share) {
  const auto nth = static_cast<std::size_t>(static_cast<double>(items.size() - 1) * share);
  select_nth(std::span(items), nth, std::less<>());
  return items[nth];
}

}  // namespace

void CellEstimate::find(std::span<const dvec3> positions, std::size_t coincident, const Box& domain,
                        Surroundings* outside) {
  outside_ = outside;
  order(positions, coincident, domain);
  cells_.assign(own_, {});
  neighbours_.clear();
  const double spacing = 1 / std::cbrt(static_cast<double>(own_) + 1);
  shape_ = dmat3(spacing);
  bounds_ = usual_bounds * spacing;
  for (const TreeNode& node : tree_)
    if (node.upper == 0) find_cells(node);
  trim_cells();
}

// Puts the points into a k-d tree.
void CellEstimate::order(std::span<const dvec3> positions, std::size_t coincident, const Box& domain) {
  Box box;
  for (const dvec3& p : positions) box.include(p);
  const dvec3 extent = box.extent(), whole = domain.extent();
  const double longest = std::max({extent.x, extent.y, extent.z});
  const double unit = longest > 0 ? longest : std::max({whole.x, whole.y, whole.z});
  scale_ = unit > 0 ? 1 / unit : 1;
  origin_ = box.low;
  most_bounds_ = unit > 0 ? 2 * glm::length(whole) * scale_ : 0.5;
  entries_.clear();
  for (std::size_t i = coincident; i < positions.size(); ++i) {
    const dvec3 local = (positions[i] - origin_) * scale_;
    entries_.push_back({Entry::Lanes{local.x, local.y, local.z, static_cast<double>(i)}});
  }
  tree_.clear();
  if (!entries_.empty()) split(0, static_cast<std::uint32_t>(entries_.size()));
  close_gaps();
  own_ = static_cast<std::uint32_t>(entries_.size());
  entry_of_.assign(positions.size(), no_entry);
  for (std::uint32_t i = 0; i < own_; ++i) entry_of_[entries_[i].point()] = i;
  read_.clear();
  kept_stand_ins_.clear();
}

void CellEstimate::split(std::uint32_t begin, std::uint32_t end) {
  Entry low = entries_[begin], high = low;
  for (std::uint32_t i = begin + 1; i < end; ++i) {
    const Entry::Lanes& lanes = entries_[i].lanes;
    low.lanes = lanes < low.lanes ? lanes : low.lanes;
    high.lanes = lanes > high.lanes ? lanes : high.lanes;
  }
  const std::size_t number = tree_.size();
  tree_.push_back({{low.position(), high.position()}, begin, end});
  const int axis = longest_axis(high.position() - low.position());
  if (end - begin <= bucket_points || low[axis] == high[axis]) return keep_distinct(tree_.back());
  const std::uint32_t middle = split_at_median(begin, end, axis);
  split(begin, middle);
  tree_[number].upper = static_cast<std::uint32_t>(tree_.size());
  split(middle, end);
}

// Leaves out all but the first of coincident points.
void CellEstimate::keep_distinct(TreeNode& bucket) {
  const auto first = entries_.begin() + bucket.begin, last = entries_.begin() + bucket.end;
  const auto comes_before = [](const Entry& a, const Entry& b) { return a.point() < b.point(); };
  if (bucket.box.low == bucket.box.high) {
    std::iter_swap(first, std::min_element(first, last, comes_before));
    bucket.end = bucket.begin + 1;
    return;
  }
  std::sort(first, last, comes_before);
  auto kept = first;
  for (auto entry = first; entry != last; ++entry)
    if (std::none_of(first, kept, [&](const Entry& other) { return other.position() == entry->position(); }))
      *kept++ = *entry;
  bucket.end = static_cast<std::uint32_t>(kept - entries_.begin());
}

// Orders the range so that all entries before the middle have a smaller coordinate than the others. Neither part is
// empty. Requires different coordinates.
std::uint32_t CellEstimate::split_at_median(std::uint32_t begin, std::uint32_t end, int axis) {
  const auto first = entries_.begin() + begin, last = entries_.begin() + end;
  const auto middle = first + (last - first) / 2;
  select_nth(std::span(first, last), static_cast<std::size_t>(middle - first),
             [axis](const Entry& a, const Entry& b) { return a[axis] < b[axis]; });
  const double value = (*middle)[axis];
  const auto before = std::partition(first, middle, [&](const Entry& entry) { return entry[axis] < value; });
  const auto up_to = [&](const Entry& entry) { return entry[axis] <= value; };
  return static_cast<std::uint32_t>((before > first ? before : std::partition(middle, last, up_to)) - entries_.begin());
}

// Moves the entries of the buckets together.
void CellEstimate::close_gaps() {
  std::uint32_t count = 0;
  for (TreeNode& node : tree_) {
    if (node.upper != 0) continue;
    const std::uint32_t begin = count;
    for (std::uint32_t i = node.begin; i < node.end; ++i) entries_[count++] = entries_[i];
    node.begin = begin, node.end = count;
  }
  entries_.resize(count);
}

void CellEstimate::find_cells(const TreeNode& bucket) {
  near_reach_ = 0;
  for (std::uint32_t i = bucket.begin; i < bucket.end; ++i) find_cell(i, bucket);
}

void CellEstimate::find_cell(std::uint32_t entry, const TreeNode& bucket) {
  const double whole = most_bounds_;
  for (int attempt = 1;; ++attempt) {
    const dvec3 from = entries_[entry].position();
    rays_.reset(shape_);
    stand_ins_.clear();
    add_bounds();
    add_points({bucket.begin, bucket.end}, entry, from);
    search(tree_[0], bucket, from);
    if (outside_) search_near(bucket, from);
    rays_.cast();
    cells_[entry].moments = rays_.moments();
    shape_ = rays_.better_shape();
    if (!rays_.fits() && attempt < most_attempts) continue;
    const Ends ends = store_cell(entry);
    const double usual = cells_[entry].usual_end, bounds = bounds_;
    const bool enough = ends == Ends::some_at_points && bounds >= least_bounds * usual;
    if (ends != Ends::none_at_points) bounds_ = std::min(whole, usual_bounds * usual);
    if (ends == Ends::all_at_points || enough || bounds >= whole) return;
    neighbours_.resize(cells_[entry].first);
    bounds_ = std::min(whole, std::max(bounds_, 4 * bounds));
    attempt = 0;
  }
}

// A cell ends at a cube round its point. It is so large that vertices on its border are out of proportion.
void CellEstimate::add_bounds() {
  std::uint32_t label = CellRays::first_border;
  for (int axis = 0; axis < 3; ++axis)
    for (const double side : {-1.0, 1.0}) {
      dvec3 dual(0);
      dual[axis] = side / bounds_;
      rays_.add(dual, label++);
    }
  rays_.update();
}

dvec3 CellEstimate::position_of(std::uint32_t neighbour) const {
  return neighbour < first_stand_in ? entries_[neighbour].position() : kept_stand_ins_[neighbour - first_stand_in];
}

bool CellEstimate::is_wanted(const Box& box, const dvec3& from) const {
  const double square = squared_distance(box, from);
  return square == 0 ||
         (square < static_cast<double>(rays_.reach()) && rays_.may_shorten(box.low - from, box.high - from));
}

void CellEstimate::search(const TreeNode& node, const TreeNode& bucket, const dvec3& from) {
  if (&node == &bucket || !is_wanted(node.box, from)) return;
  if (node.upper == 0) return add_points({node.begin, node.end}, no_entry, from);
  const TreeNode *near = &node + 1, *far = &tree_[node.upper];
  if (squared_distance(far->box, from) < squared_distance(near->box, from)) std::swap(near, far);
  search(*near, bucket, from);
  search(*far, bucket, from);
}

// Searches the buckets outside, of which those near the bucket are listed once for all of its points.
void CellEstimate::search_near(const TreeNode& bucket, const dvec3& from) {
  const auto reach = static_cast<double>(rays_.reach());
  if (reach > near_reach_) {
    near_reach_ = 1.5 * reach;
    near_.clear();
    list_near(outside_->root(), bucket.box);
    std::sort(near_.begin(), near_.end(), [](const Near& a, const Near& b) {
      return a.square != b.square ? a.square < b.square : a.number < b.number;
    });
  }
  if (near_.size() > most_near) return search_outside(outside_->root(), from);
  for (const Near& at : near_)
    if (is_wanted(at.box, from)) visit_outside(at.number, outside_->node(at.number), at.box, from);
}

void CellEstimate::list_near(std::size_t number, const Box& around) {
  if (near_.size() > most_near || outside_->outside(number) == Surroundings::Part::none) return;
  const Surroundings::Node node = outside_->node(number);
  if (node.box.low.x > node.box.high.x) return;
  const Box box{(node.box.low - origin_) * scale_, (node.box.high - origin_) * scale_};
  const double square = squared_distance(box, around);
  if (square >= near_reach_) return;
  if (node.is_bucket) return near_.push_back({square, number, box});
  for (std::size_t child = node.begin; child < node.end; ++child) list_near(child, around);
}

void CellEstimate::search_outside(std::size_t number, const dvec3& from) {
  if (outside_->outside(number) == Surroundings::Part::none) return;
  const Surroundings::Node node = outside_->node(number);
  if (node.box.low.x > node.box.high.x) return;
  const Box box{(node.box.low - origin_) * scale_, (node.box.high - origin_) * scale_};
  if (is_wanted(box, from)) visit_outside(number, node, box, from);
}

void CellEstimate::visit_outside(std::size_t number, const Surroundings::Node& node, const Box& box,
                                 const dvec3& from) {
  const double far = stand_in_ratio * stand_in_ratio * squared_distance(box, from);
  if (outside_->outside(number) == Surroundings::Part::all && squared_length(box.extent()) < far) {
    const dvec3 middle = (box.low + box.high) / 2.0, d = middle - from;
    rays_.add(2 / squared_length(d) * d, first_stand_in + static_cast<std::uint32_t>(stand_ins_.size()));
    stand_ins_.push_back(middle);
    return rays_.update();
  }
  if (node.is_bucket) return add_points(read(number), no_entry, from);
  struct Child {
    double square;
    std::size_t number;
  };
  std::array<Child, 8> children;
  std::size_t count = 0;
  const dvec3 position = from / scale_ + origin_;
  for (std::size_t child = node.begin; child < node.end; ++child)
    children[count++] = {squared_distance(outside_->node(child).box, position), child};
  std::sort(children.begin(), children.begin() + count, [](const Child& a, const Child& b) {
    return a.square != b.square ? a.square < b.square : a.number < b.number;
  });
  for (std::size_t c = 0; c < count; ++c) search_outside(children[c].number, from);
}

// Returns the entries of a bucket outside.
CellEstimate::Range CellEstimate::read(std::size_t bucket) {
  const auto known = read_.find(bucket);
  if (known != read_.end()) return known->second;
  Range range{static_cast<std::uint32_t>(entries_.size()), 0};
  for (const dvec3& p : outside_->read(bucket)) {
    const dvec3 local = (p - origin_) * scale_;
    entries_.push_back({Entry::Lanes{local.x, local.y, local.z, 0}});
  }
  range.end = static_cast<std::uint32_t>(entries_.size());
  return read_[bucket] = range;
}

void CellEstimate::add_points(Range range, std::uint32_t but, const dvec3& from) {
  const auto reach = static_cast<double>(rays_.reach());
  for (std::uint32_t i = range.begin; i < range.end; ++i) {
    if (i == but) continue;
    const dvec3 d = entries_[i].position() - from;
    const double square = squared_length(d);
    if (square > 0 && square < reach) rays_.add(2 / square * d, i);
  }
  rays_.update();
}

CellEstimate::Ends CellEstimate::store_cell(std::uint32_t entry) {
  Cell& cell = cells_[entry];
  rays_.find_vertices(vertices_, labels_);
  cell.first = static_cast<std::uint32_t>(neighbours_.size());
  for (const std::uint32_t label : labels_) {
    if (!is_border(label)) neighbours_.push_back(label);
    if (label < first_stand_in) continue;
    neighbours_.back() = first_stand_in + static_cast<std::uint32_t>(kept_stand_ins_.size());
    kept_stand_ins_.push_back(stand_ins_[label - first_stand_in]);
  }
  cell.last = static_cast<std::uint32_t>(neighbours_.size());
  lengths_.clear();
  float farthest = 0;
  bool bounded = true;
  for (const CellRays::Vertex& vertex : vertices_) {
    farthest = std::max(farthest, vertex.square);
    const bool at_border = std::ranges::any_of(vertex.labels, is_border);
    if (!at_border) lengths_.push_back(static_cast<double>(vertex.square));
    bounded = bounded && !at_border;
  }
  cell.farthest = static_cast<double>(std::sqrt(farthest));
  double neighbour = 0;
  for (const std::uint32_t other : neighbours(entry))
    if (other < first_stand_in || !lengths_.empty())
      neighbour = std::max(neighbour, squared_length(position_of(other) - position_of(entry)));
  // As for ScatteredEstimate: points on a plane have vertices only on the border, or at random far away.
  if (neighbour == 0)
    cell.usual_end = cell.farthest;
  else
    cell.usual_end = std::sqrt(lengths_.empty() ? neighbour : std::min(neighbour, quantile(lengths_, 0.25)));
  return lengths_.empty() ? Ends::none_at_points : bounded ? Ends::all_at_points : Ends::some_at_points;
}

// The lower quartile of the usual ends of a point and its neighbours; those outside are not known.
double CellEstimate::usual_of(std::uint32_t entry) {
  double& usual = usual_[entry];
  if (!std::isnan(usual)) return usual;
  lengths_ = {cells_[entry].usual_end};
  for (const std::uint32_t other : neighbours(entry))
    if (other < own_) lengths_.push_back(cells_[other].usual_end);
  return usual = quantile(lengths_, 0.25);
}

void CellEstimate::trim_cells() {
  usual_.assign(own_, nan);
  for (std::uint32_t i = 0; i < own_; ++i)
    if (cells_[i].farthest > max_radius_ratio * usual_of(i)) trim_cell(i);
}

// Cuts off vertices that are out of proportion, as they lie in voids. As ScatteredEstimate does.
void CellEstimate::trim_cell(std::uint32_t entry) {
  bounds_ = 2 * cells_[entry].farthest;
  std::vector<dvec3> cuts;
  dmat3 shape = CellRays::shape_of(cells_[entry].moments);
  for (int cut = 0; cut <= most_cuts; ++cut) {
    cast_trimmed(entry, cuts, shape);
    rays_.find_vertices(vertices_, labels_);
    const dvec3 vertex = farthest_out_of_proportion(entry);
    if (vertex == dvec3(0) || cut == most_cuts) return;
    cuts.push_back(cut_against(entry, vertex));
  }
}

void CellEstimate::cast_trimmed(std::uint32_t entry, std::span<const dvec3> cuts, dmat3& shape) {
  const dvec3 from = entries_[entry].position();
  for (int attempt = 1;; ++attempt) {
    rays_.reset(shape);
    add_bounds();
    for (const std::uint32_t other : neighbours(entry)) {
      const dvec3 d = position_of(other) - from;
      rays_.add(2 / squared_length(d) * d, other);
    }
    for (std::uint32_t c = 0; c < cuts.size(); ++c) rays_.add(cuts[c], first_cut + c);
    rays_.cast();
    cells_[entry].moments = rays_.moments();
    shape = rays_.better_shape();
    if (rays_.fits() || attempt == most_attempts) return;
  }
}

// The farthest vertex that is too far away, or 0. Requires the vertices of the entry's cell.
dvec3 CellEstimate::farthest_out_of_proportion(std::uint32_t entry) {
  const CellRays::Vertex* farthest = nullptr;
  for (const CellRays::Vertex& vertex : vertices_) {
    double limit = usual_of(entry);
    for (const std::uint32_t label : vertex.labels)
      if (label < own_) limit = std::max(limit, usual_of(label));
    const double square = static_cast<double>(vertex.square);
    if (square > max_radius_ratio * max_radius_ratio * limit * limit && (!farthest || vertex.square > farthest->square))
      farthest = &vertex;
  }
  return farthest ? rays_.end(*farthest) : dvec3(0);
}

// The dual point of a plane that cuts off a vertex: through the point, and across the direction to the nearest
// neighbour on the other side. If there is none, as for points on a plane, the cell gets the thickness of the spacing.
dvec3 CellEstimate::cut_against(std::uint32_t entry, const dvec3& vertex) {
  const double distance = glm::length(vertex);
  double nearest = infinity;
  dvec3 opposite(0);
  for (const std::uint32_t other : neighbours(entry)) {
    const dvec3 d = position_of(other) - position_of(entry);
    const double length = glm::length(d);
    if (length < nearest && glm::dot(d, vertex) < -min_facing * length * distance) opposite = d, nearest = length;
  }
  if (nearest < infinity) return -1 / (cut_distance * nearest * nearest) * opposite;
  return 2 / (usual_of(entry) * distance) * vertex;
}

SpatialMoments CellEstimate::moments(std::size_t point) const {
  if (entry_of_[point] == no_entry) return {};
  SpatialMoments own = cells_[entry_of_[point]].moments;
  const double unit = 1 / scale_;
  own.mass *= unit * unit * unit;
  own.centroid *= unit;
  SymmetricMatrix& c = own.covariance;
  for (double* item : {&c.xx, &c.yy, &c.zz, &c.xy, &c.xz, &c.yz}) *item *= unit * unit;
  return own;
}

// As ScatteredEstimate::fit.
CellEstimate::Fit CellEstimate::fit(std::uint32_t entry, const EstimateValues& values) const {
  const double value = value_at(entry, values);
  Fit result;
  result.min = result.max = value;
  GradientFit fit;
  for (const std::uint32_t other : neighbours(entry)) {
    const double there = other < first_stand_in ? value_at(other, values) : nan;
    if (std::isnan(there)) continue;
    const dvec3 offset = entries_[other].position() - entries_[entry].position();
    const double inverse = 1 / glm::length(offset);
    fit.add(offset * inverse, (there - value) * inverse);
    result.min = std::min(result.min, there);
    result.max = std::max(result.max, there);
  }
  if (!fit.empty()) result.gradient = scale_ * fit.gradient();
  return result;
}

ValueMoments CellEstimate::value(std::size_t point, const EstimateValues& values) const {
  const std::uint32_t entry = entry_of_[point];
  if (entry == no_entry || std::isnan(values.own[point])) return {};
  const Fit line = fit(entry, values);
  const SpatialMoments cell = moments(point);
  const dvec3& g = line.gradient;
  const SymmetricMatrix& s = cell.covariance;
  const dvec3 covariance(s.xx * g.x + s.xy * g.y + s.xz * g.z, s.xy * g.x + s.yy * g.y + s.yz * g.z,
                         s.xz * g.x + s.yz * g.y + s.zz * g.z);
  return linear_value_moments(cell, values.own[point], g, covariance, line.min, line.max);
}

dvec3 CellEstimate::gradient(std::size_t point, const EstimateValues& values) const {
  const std::uint32_t entry = entry_of_[point];
  return entry == no_entry || std::isnan(values.own[point]) ? dvec3(0) : fit(entry, values).gradient;
}

}  // namespace splatvol
