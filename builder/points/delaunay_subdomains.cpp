#include "builder/points/delaunay_subdomains.h"

#include <tbb/info.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <utility>

#include "builder/mesh/boundary.h"
#include "builder/scattered/growing_delaunay.h"
#include "builder/scattered/trimming.h"
#include "builder/sorting/morton.h"

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

// For each point of a block, while that is worked on with its halo.
constexpr std::uint64_t point_bytes = 3500;

// Points of a block and its halo, at most.
constexpr std::size_t most_points = std::size_t{1} << 18;

// A halo begins with what lies within so many spacings, so that few points are left to be added round by round.
constexpr double first_halo = 3;

double squared(const dvec3& v) { return glm::dot(v, v); }

double squared_distance(const Box& box, const dvec3& p) {
  return squared(glm::max(glm::max(box.low - p, p - box.high), dvec3(0)));
}

double squared_distance(const Box& a, const Box& b) {
  return squared(glm::max(glm::max(a.low - b.high, b.low - a.high), dvec3(0)));
}

// Where points would end a tetrahedron, or a face of the hull: in a sphere, or beyond a plane, borders included.
struct Conflict {
  bool is_plane;
  dvec3 place;    // centre, or of the plane
  double square;  // radius; of a plane, the least distance along the normal
  dvec3 normal;

  [[nodiscard]] bool meets(const Box& box) const {
    if (!is_plane) return squared_distance(box, place) <= square;
    const dvec3 farthest(normal.x > 0 ? box.high.x : box.low.x, normal.y > 0 ? box.high.y : box.low.y,
                         normal.z > 0 ? box.high.z : box.low.z);
    return glm::dot(farthest - place, normal) >= square;
  }
};

// What lies on the border decides too, where points are cospherical.
constexpr double rounding = 1e-6;

Conflict beyond_face(const dvec3& p, const dvec3& b, const dvec3& c) {
  dvec3 normal = glm::cross(b - p, c - p);
  const double length = glm::length(normal);
  if (length > 0) normal /= length;
  return {true, p, -rounding * std::sqrt(std::max(squared(b - p), squared(c - p))), normal};
}

Conflict circumsphere(const dvec3& p, const dvec3& b, const dvec3& c, const dvec3& d, double radius) {
  const dvec3 u = b - p, v = c - p, w = d - p, vw = glm::cross(v, w);
  const dvec3 center =
      (squared(u) * vw + squared(v) * glm::cross(w, u) + squared(w) * glm::cross(u, v)) / (2 * glm::dot(u, vw));
  return {false, p + center, std::pow(radius * (1 + rounding), 2), {}};
}

std::span<const std::uint32_t> corners_of(const GrowingDelaunay::Cell& cell) {
  return std::span(cell.corners).first(cell.is_finite() ? 4 : 3);
}

// One block with its halo.
class Block {
 public:
  Block(const StoredPoints& points, const Cube& cube, std::size_t first_leaf, std::size_t end_leaf)
      : points_(points), cube_(cube), first_leaf_(first_leaf), end_leaf_(end_leaf), inside_(points.nodes().size()) {}

  Status run(PointBatch& result);

  [[nodiscard]] bool uncertain() const { return uncertain_; }

 private:
  [[nodiscard]] std::size_t own_begin() const { return points_.nodes()[first_leaf_].begin; }
  [[nodiscard]] std::size_t own_end() const { return points_.nodes()[end_leaf_ - 1].end; }

  // Takes in leaves that wanted(box) is true of, as it must be of every box above them.
  template <class Wanted>
  void search(const Wanted& wanted) {
    search(points_.nodes().size() - 1, wanted);
  }
  template <class Wanted>
  void search(std::size_t node, const Wanted& wanted) {
    const StoredPoints::Node& at = points_.nodes()[node];
    if (inside_[node] || !wanted(at.box)) return;
    if (node < points_.leaf_count()) return take(node);
    for (std::size_t child = at.begin; child < at.end; ++child) search(child, wanted);
  }

  void take(std::size_t leaf);
  Status insert();
  [[nodiscard]] double smallest_spacing() const { return std::ldexp(cube_.edge, -max_morton_depth); }
  void take_surroundings(double spacings);
  void widen();
  Status surround();
  void measure();
  void mark_rings();
  [[nodiscard]] bool matters(const GrowingDelaunay::Cell& cell) const;
  [[nodiscard]] bool is_clear(const GrowingDelaunay::Cell& cell) const;
  [[nodiscard]] Conflict conflict_of(const GrowingDelaunay::Cell& cell) const;
  void find_conflicts(double largest);
  bool trim();
  Status fill(PointBatch& result);

  const StoredPoints& points_;
  const Cube& cube_;
  std::size_t first_leaf_, end_leaf_;
  bool uncertain_ = false;

  std::vector<std::uint8_t> inside_;  // [node]: all of it has been taken in
  std::vector<std::size_t> coming_;   // leaves
  std::size_t coming_points_ = 0;

  GrowingDelaunay delaunay_;
  std::size_t own_count_ = 0;           // distinct ones, before the halo
  std::vector<std::byte> records_;      // of all points in the triangulation
  std::vector<dvec3> positions_;        // of them
  std::vector<std::uint64_t> numbers_;  // of them, among all points

  std::vector<double> clear_;  // [own point]: within which distance all points are there

  std::vector<GrowingDelaunay::Cell> cells_;
  std::vector<double> smallest_;    // [point]: radius at it
  std::vector<std::uint8_t> ring_;  // [point]: 0 for own points, 1 for those that share a tetrahedron with them, 2, 3
  std::vector<Tetrahedron> tetrahedra_;  // at own points, kept; corners in the order of their numbers
};

void Block::take(std::size_t leaf) {
  coming_.push_back(leaf);
  coming_points_ += points_.nodes()[leaf].end - points_.nodes()[leaf].begin;
  const auto& nodes = points_.nodes();
  for (std::size_t node = leaf; !inside_[node]; node = nodes[node].parent) {
    if (node >= points_.leaf_count() &&
        !std::all_of(inside_.begin() + static_cast<std::ptrdiff_t>(nodes[node].begin),
                     inside_.begin() + static_cast<std::ptrdiff_t>(nodes[node].end), [](auto in) { return in != 0; }))
      return;
    inside_[node] = 1;
  }
}

// Reads what is coming and adds it to the triangulation, all but what lies where the point before it does.
Status Block::insert() {
  std::ranges::sort(coming_);
  const PointRecords& layout = points_.layout();
  const std::size_t first = positions_.size();
  std::vector<std::byte> records;
  for (const std::size_t leaf : coming_) {
    const StoredPoints::Node& node = points_.nodes()[leaf];
    records.clear();
    SPLATVOL_TRY(points_.read(node.begin, node.end, records));
    std::optional<dvec3> last;
    for (std::size_t i = node.begin; i < node.end; ++i) {
      const std::span record = std::span(records).subspan((i - node.begin) * layout.bytes(), layout.bytes());
      const dvec3 position = layout.position(record.data());
      const bool repeats = last ? *last == position : points_.continues(leaf);
      last = position;
      if (repeats) continue;
      positions_.push_back(position);
      numbers_.push_back(i);
      records_.insert(records_.end(), record.begin(), record.end());
    }
  }
  coming_.clear();
  coming_points_ = 0;
  delaunay_.insert(std::span<const dvec3>(positions_).subspan(first));
  return {};
}

// Takes in what lies within so many spacings of each own leaf.
void Block::take_surroundings(double spacings) {
  clear_.assign(own_count_, 0);
  std::size_t point = 0;
  for (std::size_t leaf = first_leaf_; leaf < end_leaf_; ++leaf) {
    const StoredPoints::Node& node = points_.nodes()[leaf];
    const double spacing = glm::length(node.box.high - node.box.low) / std::sqrt(3) /
                           std::cbrt(static_cast<double>(node.end - node.begin));
    const double reach = spacings * std::max(spacing, smallest_spacing());
    search([&](const Box& box) { return squared_distance(box, node.box) <= reach * reach; });
    for (; point < own_count_ && numbers_[point] < node.end; ++point) clear_[point] = reach;
  }
}

// Points that span no volume need others from farther and farther away.
void Block::widen() {
  for (double spacings = 2 * first_halo; coming_.empty() && spacings * smallest_spacing() < 4 * cube_.edge;
       spacings *= 2)
    take_surroundings(spacings);
}

void Block::measure() {
  cells_ = delaunay_.cells();
  smallest_.assign(positions_.size(), infinity);
  for (const GrowingDelaunay::Cell& cell : cells_)
    for (const std::uint32_t i : corners_of(cell)) smallest_[i] = std::min(smallest_[i], cell.radius);
}

// Whether it may count for what is usual, or be kept.
bool Block::matters(const GrowingDelaunay::Cell& cell) const {
  if (!cell.is_finite()) return false;
  double largest = 0;
  for (const std::uint32_t i : cell.corners) largest = std::max(largest, smallest_[i]);
  return cell.radius <= max_radius_spread * largest || cell.mark == infinity;
}

// What is usual at the corners of a tetrahedron depends on all that its corners' neighbours have.
void Block::mark_rings() {
  ring_.assign(positions_.size(), 3);
  std::fill_n(ring_.begin(), own_count_, std::uint8_t{0});
  for (std::uint8_t ring = 0; ring < 2; ++ring)
    for (const GrowingDelaunay::Cell& cell : cells_) {
      if (std::ranges::none_of(corners_of(cell), [&](std::uint32_t i) { return ring_[i] == ring; })) continue;
      if (!matters(cell)) continue;
      for (const std::uint32_t i : cell.corners) ring_[i] = std::min(ring_[i], static_cast<std::uint8_t>(ring + 1));
    }
}

// Takes in the leaves that may hold points in conflict with cells at the points of the rings. Where a cell bridges a
// void, or is a face of the hull, only those near these points can bring a tetrahedron that matters.
void Block::find_conflicts(double largest) {
  for (std::size_t c = 0; c < cells_.size(); ++c) {
    GrowingDelaunay::Cell& cell = cells_[c];
    if (cell.mark == infinity) continue;
    std::array<dvec3, 4> near;
    std::size_t count = 0;
    double spread = 0;
    for (const std::uint32_t i : corners_of(cell)) {
      if (ring_[i] == 3) continue;
      near[count++] = positions_[i];
      spread = std::max(spread, smallest_[i]);
    }
    if (count == 0 || cell.radius > largest * spread) continue;
    const double reach = matters(cell) ? infinity : 2 * max_radius_spread * spread;
    if (cell.mark >= reach) continue;
    cell.mark = reach;
    delaunay_.set_mark(c, reach);
    if (is_clear(cell)) continue;
    const Conflict conflict = conflict_of(cell);
    search([&](const Box& box) {
      if (!conflict.meets(box)) return false;
      if (reach == infinity) return true;
      // Sparse points have tetrahedra as large as their spacing, which reach to dense ones.
      const double square = std::max(reach * reach, squared(box.high - box.low));
      return std::any_of(near.begin(), near.begin() + count,
                         [&](const dvec3& v) { return squared_distance(box, v) <= square; });
    });
  }
}

// Whether all points that may be in conflict with it are there from the beginning.
bool Block::is_clear(const GrowingDelaunay::Cell& cell) const {
  return std::ranges::any_of(corners_of(cell),
                             [&](std::uint32_t i) { return i < own_count_ && 2 * cell.radius < clear_[i]; });
}

Conflict Block::conflict_of(const GrowingDelaunay::Cell& cell) const {
  const auto p = [&](std::size_t k) { return positions_[cell.corners[k]]; };
  if (!cell.is_finite()) return beyond_face(p(0), p(1), p(2));
  if (std::isinf(cell.radius)) return {false, p(0), infinity, {}};
  return circumsphere(p(0), p(1), p(2), p(3), cell.radius);
}

// Finds the tetrahedra at own points that are kept. Those that mattered more than they seemed to are looked into again;
// whether there were such.
bool Block::trim() {
  tetrahedra_.clear();
  std::vector<std::size_t> cells;
  for (std::size_t c = 0; c < cells_.size() && cells_[c].is_finite(); ++c) {
    if (std::ranges::all_of(cells_[c].corners, [&](std::uint32_t i) { return ring_[i] == 3; })) continue;
    std::ranges::sort(tetrahedra_.emplace_back(cells_[c].corners), {}, [&](std::uint32_t i) { return numbers_[i]; });
    cells.push_back(c);
  }
  const auto radii = circumradii(positions_, tetrahedra_);
  const auto usual = usual_radii(positions_.size(), tetrahedra_, radii);
  std::size_t kept = 0;
  bool again = false;
  for (std::size_t t = 0; t < tetrahedra_.size(); ++t) {
    const Tetrahedron corners = tetrahedra_[t];
    if (radii[t] > largest_kept(usual, corners) ||
        std::ranges::none_of(corners, [&](std::uint32_t i) { return i < own_count_; }))
      continue;
    tetrahedra_[kept++] = corners;
    if (cells_[cells[t]].mark == infinity) continue;
    again = true;
    delaunay_.set_mark(cells[t], infinity);
    const Conflict conflict = conflict_of(cells_[cells[t]]);
    search([&](const Box& box) { return conflict.meets(box); });
  }
  tetrahedra_.resize(kept);
  return again;
}

Status Block::run(PointBatch& result) {
  for (std::size_t leaf = first_leaf_; leaf < end_leaf_; ++leaf) take(leaf);
  SPLATVOL_TRY(insert());
  own_count_ = positions_.size();
  if (own_count_ > 0) SPLATVOL_TRY(surround());
  if (is_flat(positions_, tetrahedra_)) tetrahedra_.clear();
  return fill(result);
}

// Small tetrahedra first: what lies in them leaves few of the large ones.
Status Block::surround() {
  take_surroundings(first_halo);
  for (bool again = true; again;) {
    SPLATVOL_TRY(insert());
    measure();
    mark_rings();
    again = false;
    if (cells_.empty()) widen();
    if (coming_.empty()) find_conflicts(max_radius_spread / 2);
    if (32 * coming_points_ < positions_.size()) find_conflicts(infinity);
    if (coming_.empty()) again = trim();
    again = again || !coming_.empty();
    if (positions_.size() + coming_points_ > most_points) {
      uncertain_ = true;
      again = false;
      trim();
    }
  }
  return {};
}

// In the order of all points, so that sums have the same terms in the same order in every block.
Status Block::fill(PointBatch& result) {
  const PointRecords& layout = points_.layout();
  std::vector<std::pair<std::uint64_t, std::uint32_t>> before, behind;  // number and place of halo points that count
  std::vector<std::uint32_t> places(positions_.size());
  for (const Tetrahedron& corners : tetrahedra_)
    for (const std::uint32_t i : corners)
      if (i >= own_count_ && places[i]++ == 0)
        (numbers_[i] < own_begin() ? before : behind).emplace_back(numbers_[i], i);
  std::ranges::sort(before);
  std::ranges::sort(behind);

  const std::size_t own = own_end() - own_begin(), attributes = layout.attributes();
  std::vector<dvec3> positions;
  std::vector<std::vector<double>> values(attributes);
  const auto add = [&](const std::byte* record) {
    positions.push_back(layout.position(record));
    for (std::size_t a = 0; a < attributes; ++a) values[a].push_back(layout.value(record, a));
  };
  std::vector<std::byte> own_records;
  SPLATVOL_TRY(points_.read(own_begin(), own_end(), own_records));
  for (const auto& [number, i] : before)
    places[i] = static_cast<std::uint32_t>(positions.size()), add(records_.data() + i * layout.bytes());
  for (std::size_t i = 0; i < own; ++i) add(own_records.data() + i * layout.bytes());
  for (const auto& [number, i] : behind)
    places[i] = static_cast<std::uint32_t>(positions.size()), add(records_.data() + i * layout.bytes());
  for (std::uint32_t i = 0; i < own_count_; ++i)
    places[i] = static_cast<std::uint32_t>(before.size() + numbers_[i] - own_begin());
  for (Tetrahedron& corners : tetrahedra_)
    for (std::uint32_t& i : corners) i = places[i];
  std::ranges::sort(tetrahedra_);

  const VertexMaterial mesh(positions, tetrahedra_);
  const auto planes = boundary_planes(positions, find_outer_faces(positions, tetrahedra_));
  result.values.resize(attributes);
  result.value_moments.resize(attributes);
  result.gradients.resize(attributes);
  for (std::size_t i = before.size(); i < before.size() + own; ++i) {
    result.keys.push_back(morton_key(positions[i], cube_));
    result.positions.push_back(positions[i]);
    result.moments.push_back(mesh.moments(i));
    result.planes.push_back(planes[i]);
    for (std::size_t a = 0; a < attributes; ++a) {
      result.values[a].push_back(values[a][i]);
      result.value_moments[a].push_back(mesh.value_moments(i, values[a]));
      result.gradients[a].push_back(mesh.gradient(i, values[a]));
    }
  }
  return {};
}

template <class T>
void append(std::vector<T>& to, std::vector<T>& from) {
  to.insert(to.end(), from.begin(), from.end());
}

}  // namespace

DelaunaySubdomains::DelaunaySubdomains(StoredPoints points, const Cube& cube, std::size_t block_points,
                                       std::size_t at_once)
    : points_(std::move(points)), cube_(cube), at_once_(at_once), cuts_(points_.cut(block_points)) {}

Result<DelaunaySubdomains> DelaunaySubdomains::create(PointStream& stream, std::uint64_t memory,
                                                      const std::string& folder, std::size_t block_points) {
  SPLATVOL_TRY_ASSIGN(points, StoredPoints::create(stream, folder));
  const std::uint64_t room = memory / (block_points * point_bytes);
  const auto threads = static_cast<std::uint64_t>(tbb::info::default_concurrency());
  const std::size_t at_once = std::clamp<std::uint64_t>(room, 1, threads);
  return DelaunaySubdomains(std::move(points), stream.summary().cube, block_points, at_once);
}

Result<bool> DelaunaySubdomains::next(PointBatch& batch) {
  if (ready_.empty()) {
    const std::size_t count = std::min(at_once_, cuts_.size() - 1 - next_);
    if (count == 0) return false;
    struct Outcome {
      Status status;
      PointBatch points;
      bool uncertain = false;
    };
    std::vector<Outcome> outcomes(count);
    tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
      Block block(points_, cube_, cuts_[next_ + i], cuts_[next_ + i + 1]);
      outcomes[i].status = block.run(outcomes[i].points);
      outcomes[i].uncertain = block.uncertain();
    });
    next_ += count;
    for (Outcome& outcome : outcomes) {
      SPLATVOL_TRY(outcome.status);
      if (outcome.uncertain) uncertain_ += outcome.points.size();
      ready_.push_back(std::move(outcome.points));
    }
  }
  PointBatch& block = ready_.front();
  for_each_array(batch, block, [](auto& all, auto& items) { append(all, items); });
  ready_.pop_front();
  return true;
}

}  // namespace splatvol
