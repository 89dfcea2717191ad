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

#include "base/interruption.h"
#include "builder/mesh/boundary.h"
#include "builder/scattered/growing_delaunay.h"
#include "builder/scattered/trimming.h"
#include "builder/sorting/morton.h"

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

// Memory for each own point of a subdomain while the subdomain is triangulated with its halo.
constexpr std::uint64_t point_bytes = 3500;

// The same for tetrahedra that wait until all subdomains are ready that are triangulated at the same time.
constexpr std::uint64_t found_bytes = 150;

// A halo begins with the points within this many spacings, so that few points remain to be added round by round.
constexpr double first_halo = 3;

// The region where a point would end a tetrahedron, or a face of the hull: a sphere, or the space beyond a plane,
// borders included.
struct Conflict {
  bool is_plane;
  dvec3 origin;    // the centre, or a position on the plane
  double measure;  // of a sphere, the square of its radius; of a plane, the least distance along the normal
  dvec3 normal;

  [[nodiscard]] bool meets(const Box& box) const {
    if (!is_plane) return squared_distance(box, origin) <= measure;
    const dvec3 farthest(normal.x > 0 ? box.high.x : box.low.x, normal.y > 0 ? box.high.y : box.low.y,
                         normal.z > 0 ? box.high.z : box.low.z);
    return glm::dot(farthest - origin, normal) >= measure;
  }
};

// Conflicts reach this share further: if points are cospherical, those on the border decide too.
constexpr double rounding = 1e-6;

Conflict beyond_face(const dvec3& p, const dvec3& b, const dvec3& c) {
  dvec3 normal = glm::cross(b - p, c - p);
  const double length = glm::length(normal);
  if (length > 0) normal /= length;
  return {true, p, -rounding * std::sqrt(std::max(squared_length(b - p), squared_length(c - p))), normal};
}

Conflict circumsphere(const dvec3& p, const dvec3& b, const dvec3& c, const dvec3& d, double radius) {
  const dvec3 u = b - p, v = c - p, w = d - p, vw = glm::cross(v, w);
  const dvec3 center =
      (squared_length(u) * vw + squared_length(v) * glm::cross(w, u) + squared_length(w) * glm::cross(u, v)) /
      (2 * glm::dot(u, vw));
  return {false, p + center, std::pow(radius * (1 + rounding), 2), {}};
}

std::span<const std::uint32_t> corners_of(const GrowingDelaunay::Cell& cell) {
  return std::span(cell.corners).first(cell.is_finite() ? 4 : 3);
}

// One subdomain with its halo.
class Subdomain {
 public:
  Subdomain(const StoredPoints& points, const Cube& cube, std::size_t first_bucket, std::size_t end_bucket,
            std::size_t most_points)
      : points_(points),
        cube_(cube),
        first_bucket_(first_bucket),
        end_bucket_(end_bucket),
        most_points_(most_points),
        inside_(points.nodes().size()) {}

  // `found`: null if no one asks for the tetrahedra.
  Status run(PointBatch& result, FoundTetrahedra* found) {
    for (std::size_t bucket = first_bucket_; bucket < end_bucket_; ++bucket) add_bucket(bucket);
    SPLATVOL_TRY(insert());
    own_count_ = positions_.size();
    if (own_count_ > 0) SPLATVOL_TRY(surround());
    const bool flat = is_flat(positions_, tetrahedra_);
    if (flat) tetrahedra_.clear();
    SPLATVOL_TRY_ASSIGN(mesh, make_mesh());
    fill(mesh, result);
    if (found) *found = found_in(std::move(mesh), !flat && !uncertain_);
    return {};
  }

  [[nodiscard]] bool uncertain() const { return uncertain_; }

 private:
  [[nodiscard]] std::size_t own_begin() const { return points_.nodes()[first_bucket_].begin; }
  [[nodiscard]] std::size_t own_end() const { return points_.nodes()[end_bucket_ - 1].end; }

  // Adds the buckets that wanted(box) is true of. It must be true of all boxes above them too.
  template <class Wanted>
  void search(const Wanted& wanted) {
    search(points_.nodes().size() - 1, wanted);
  }
  template <class Wanted>
  void search(std::size_t node, const Wanted& wanted) {
    const StoredPoints::Node& at = points_.nodes()[node];
    if (inside_[node] || !wanted(at.box)) return;
    if (node < points_.bucket_count()) return add_bucket(node);
    for (std::size_t child = at.begin; child < at.end; ++child) search(child, wanted);
  }

  // Lets the next insert() read a bucket. Marks the bucket, and all nodes above it that are now complete.
  void add_bucket(std::size_t bucket) {
    coming_.push_back(bucket);
    coming_points_ += points_.nodes()[bucket].end - points_.nodes()[bucket].begin;
    const auto& nodes = points_.nodes();
    for (std::size_t node = bucket; !inside_[node]; node = nodes[node].parent) {
      if (node >= points_.bucket_count() &&
          !std::all_of(inside_.begin() + static_cast<std::ptrdiff_t>(nodes[node].begin),
                       inside_.begin() + static_cast<std::ptrdiff_t>(nodes[node].end), [](auto in) { return in != 0; }))
        return;
      inside_[node] = 1;
    }
  }

  // Reads the coming buckets and adds their points to the triangulation, except a point that coincides with the point
  // before it.
  Status insert() {
    std::ranges::sort(coming_);
    const PointRecords& layout = points_.layout();
    const std::size_t first = positions_.size();
    std::vector<std::byte> records;
    for (const std::size_t bucket : coming_) {
      const StoredPoints::Node& node = points_.nodes()[bucket];
      records.clear();
      SPLATVOL_TRY(points_.read(node.begin, node.end, records));
      std::optional<dvec3> last;
      for (std::size_t i = node.begin; i < node.end; ++i) {
        const std::span record = std::span(records).subspan((i - node.begin) * layout.bytes(), layout.bytes());
        const dvec3 position = layout.position(record.data());
        const bool repeats = last ? *last == position : points_.continues(bucket);
        last = position;
        if (repeats) continue;
        positions_.push_back(position);
        numbers_.push_back(i);
        records_.insert(records_.end(), record.begin(), record.end());
      }
    }
    coming_.clear();
    coming_points_ = 0;
    return delaunay_.insert(std::span<const dvec3>(positions_).subspan(first));
  }

  [[nodiscard]] double smallest_spacing() const { return std::ldexp(cube_.edge, -max_morton_depth); }

  // Adds the buckets within this many spacings of each own bucket.
  void add_surroundings(double spacings) {
    clear_.assign(own_count_, 0);
    std::size_t point = 0;
    for (std::size_t bucket = first_bucket_; bucket < end_bucket_; ++bucket) {
      const StoredPoints::Node& node = points_.nodes()[bucket];
      const double spacing = glm::length(node.box.high - node.box.low) / std::sqrt(3) /
                             std::cbrt(static_cast<double>(node.end - node.begin));
      const double reach = spacings * std::max(spacing, smallest_spacing());
      search([&](const Box& box) { return squared_distance(box, node.box) <= reach * reach; });
      for (; point < own_count_ && numbers_[point] < node.end; ++point) clear_[point] = reach;
    }
  }

  // Adds buckets from farther and farther away, for points that span no volume.
  void widen() {
    for (double spacings = 2 * first_halo; coming_.empty() && spacings * smallest_spacing() < 4 * cube_.edge;
         spacings *= 2)
      add_surroundings(spacings);
  }

  // Adds the halo. Looks for conflicts of small tetrahedra first, as the points found there leave few large tetrahedra.
  Status surround() {
    add_surroundings(first_halo);
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
      if (positions_.size() + coming_points_ > most_points_) {
        uncertain_ = true;
        again = false;
        trim();
      }
    }
    return {};
  }

  // Finds all cells, and the smallest circumradius at each point.
  void measure() {
    cells_ = delaunay_.cells();
    smallest_.assign(positions_.size(), infinity);
    for (const GrowingDelaunay::Cell& cell : cells_)
      for (const std::uint32_t i : corners_of(cell)) smallest_[i] = std::min(smallest_[i], cell.radius);
  }

  // Marks the points whose tetrahedra decide. The usual circumradius at a corner of an own tetrahedron depends on the
  // tetrahedra of the corner's neighbours.
  void mark_rings() {
    ring_.assign(positions_.size(), 3);
    std::fill_n(ring_.begin(), own_count_, std::uint8_t{0});
    for (std::uint8_t ring = 0; ring < 2; ++ring)
      for (const GrowingDelaunay::Cell& cell : cells_) {
        if (std::ranges::none_of(corners_of(cell), [&](std::uint32_t i) { return ring_[i] == ring; })) continue;
        if (!matters(cell)) continue;
        for (const std::uint32_t i : cell.corners) ring_[i] = std::min(ring_[i], static_cast<std::uint8_t>(ring + 1));
      }
  }

  // Whether a cell may be kept, or may count for the usual circumradius.
  [[nodiscard]] bool matters(const GrowingDelaunay::Cell& cell) const {
    if (!cell.is_finite()) return false;
    double largest = 0;
    for (const std::uint32_t i : cell.corners) largest = std::max(largest, smallest_[i]);
    return cell.radius <= max_radius_spread * largest || cell.mark == infinity;
  }

  // Whether the first halo already had all points that may be in conflict with a cell.
  [[nodiscard]] bool is_clear(const GrowingDelaunay::Cell& cell) const {
    return std::ranges::any_of(corners_of(cell),
                               [&](std::uint32_t i) { return i < own_count_ && 2 * cell.radius < clear_[i]; });
  }

  [[nodiscard]] Conflict conflict_of(const GrowingDelaunay::Cell& cell) const {
    const auto p = [&](std::size_t k) { return positions_[cell.corners[k]]; };
    if (!cell.is_finite()) return beyond_face(p(0), p(1), p(2));
    if (std::isinf(cell.radius)) return {false, p(0), infinity, {}};
    return circumsphere(p(0), p(1), p(2), p(3), cell.radius);
  }

  // Adds the buckets that may hold points in conflict with the cells at the rings' points. If a cell bridges a void, or
  // is a face of the hull, only points near the rings' points can lead to a tetrahedron that matters. `largest`: leaves
  // out cells whose radius is more than this many times the smallest at their points.
  void find_conflicts(double largest) {
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
        // Sparse points have tetrahedra as large as their spacing, which reach to dense points.
        const double square = std::max(reach * reach, squared_length(box.high - box.low));
        return std::any_of(near.begin(), near.begin() + count,
                           [&](const dvec3& v) { return squared_distance(box, v) <= square; });
      });
    }
  }

  // Finds the tetrahedra at own points that are kept. If a kept tetrahedron did not seem to matter before, adds the
  // buckets of all its conflicts. Returns whether there was one.
  bool trim() {
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

  // Points, in the order of all points, and tetrahedra between them.
  struct Mesh {
    std::vector<dvec3> positions;
    std::vector<std::vector<double>> values;  // [attribute][point]
    std::vector<std::uint64_t> ranks;         // [point]: among all points
    std::vector<Tetrahedron> tetrahedra;
    std::size_t first_own = 0;  // index of the first own point
  };

  // The halo points of kept tetrahedra, by ascending numbers.
  [[nodiscard]] std::vector<std::uint32_t> kept_halo() const {
    std::vector<bool> kept(positions_.size());
    for (const Tetrahedron& corners : tetrahedra_)
      for (const std::uint32_t i : corners) kept[i] = true;
    std::vector<std::uint32_t> points;
    for (auto i = static_cast<std::uint32_t>(own_count_); i < positions_.size(); ++i)
      if (kept[i]) points.push_back(i);
    std::ranges::sort(points, {}, [&](std::uint32_t i) { return numbers_[i]; });
    return points;
  }

  // Makes a mesh of the kept tetrahedra and all own points. Points are in the order of all points, so that sums have
  // the same terms in the same order in every subdomain.
  Result<Mesh> make_mesh() {
    const PointRecords& layout = points_.layout();
    Mesh mesh;
    mesh.values.resize(layout.attributes());
    const auto add = [&](const std::byte* record) {
      mesh.positions.push_back(layout.position(record));
      for (std::size_t a = 0; a < layout.attributes(); ++a) mesh.values[a].push_back(layout.value(record, a));
    };
    std::vector<std::uint32_t> indices(positions_.size());  // in the mesh
    const auto add_halo = [&](std::uint32_t i) {
      indices[i] = static_cast<std::uint32_t>(mesh.positions.size());
      add(records_.data() + i * layout.bytes());
      mesh.ranks.push_back(numbers_[i]);
    };
    const std::vector<std::uint32_t> halo = kept_halo();
    const auto behind = std::ranges::partition_point(halo, [&](std::uint32_t i) { return numbers_[i] < own_begin(); });
    std::for_each(halo.begin(), behind, add_halo);
    mesh.first_own = mesh.positions.size();
    std::vector<std::byte> own_records;
    SPLATVOL_TRY(points_.read(own_begin(), own_end(), own_records));
    for (std::size_t begin = 0; begin < own_records.size(); begin += layout.bytes()) add(own_records.data() + begin);
    for (std::size_t i = own_begin(); i < own_end(); ++i) mesh.ranks.push_back(i);
    for (std::uint32_t i = 0; i < own_count_; ++i)
      indices[i] = static_cast<std::uint32_t>(mesh.first_own + numbers_[i] - own_begin());
    std::for_each(behind, halo.end(), add_halo);

    mesh.tetrahedra = std::move(tetrahedra_);
    for (Tetrahedron& corners : mesh.tetrahedra)
      for (std::uint32_t& i : corners) i = indices[i];
    std::ranges::sort(mesh.tetrahedra);
    return mesh;
  }

  static FoundTetrahedra found_in(Mesh mesh, bool is_certain) {
    FoundTetrahedra found{std::move(mesh.tetrahedra), {}, std::move(mesh.ranks), is_certain};
    const auto& p = mesh.positions;
    found.signs.reserve(found.corners.size());
    for (const auto& [a, b, c, d] : found.corners) found.signs.push_back(sign_of_volume(p[a], p[b], p[c], p[d]));
    return found;
  }

  // Fills in the own points with their material and planes.
  void fill(const Mesh& mesh, PointBatch& result) const {
    const VertexMaterial material(mesh.positions, mesh.tetrahedra);
    const auto planes =
        boundary_planes(mesh.positions, find_outer_faces(mesh.positions, mesh.tetrahedra, material.incident()));
    const std::size_t attributes = mesh.values.size();
    result.values.resize(attributes);
    result.value_moments.resize(attributes);
    result.gradients.resize(attributes);
    const auto add = [&](std::size_t number, const SpatialMoments& moments, std::span<const VertexValue> values) {
      const std::size_t i = mesh.first_own + number;
      result.keys.push_back(morton_key(mesh.positions[i], cube_));
      result.positions.push_back(mesh.positions[i]);
      result.moments.push_back(moments);
      result.planes.push_back(planes[i]);
      for (std::size_t a = 0; a < attributes; ++a) {
        result.values[a].push_back(mesh.values[a][i]);
        result.value_moments[a].push_back(values[a].moments);
        if (points_.layout().has_gradients()) result.gradients[a].push_back(values[a].gradient);
      }
    };
    VertexBlock block;
    material.find_values(mesh.first_own, mesh.first_own + own_end() - own_begin(), mesh.values,
                         points_.layout().has_gradients(), block, add);
  }

  const StoredPoints& points_;
  const Cube& cube_;
  std::size_t first_bucket_, end_bucket_;
  std::size_t most_points_;  // the halo's included
  bool uncertain_ = false;

  std::vector<std::uint8_t> inside_;  // [node]: all of it has been added
  std::vector<std::size_t> coming_;   // buckets that insert() will read
  std::size_t coming_points_ = 0;

  GrowingDelaunay delaunay_;
  std::size_t own_count_ = 0;           // distinct own points, which come before the halo
  std::vector<std::byte> records_;      // of the points in the triangulation
  std::vector<dvec3> positions_;        // of these points
  std::vector<std::uint64_t> numbers_;  // of these points, among all points

  std::vector<double> clear_;  // [own point]: distance within which the halo had all points at first

  std::vector<GrowingDelaunay::Cell> cells_;
  std::vector<double> smallest_;    // [point]: smallest circumradius at it
  std::vector<std::uint8_t> ring_;  // [point]: 0 for own points, 1 if it shares a tetrahedron with one, then 2; else 3
  std::vector<Tetrahedron> tetrahedra_;  // kept, at own points; corners by ascending numbers
};

}  // namespace

DelaunaySubdomains::DelaunaySubdomains(StoredPoints points, const Cube& cube, std::size_t subdomain_points,
                                       std::size_t most_points, std::size_t at_once)
    : points_(std::move(points)),
      cube_(cube),
      most_points_(most_points),
      at_once_(at_once),
      cuts_(points_.cut(subdomain_points)) {}

Result<DelaunaySubdomains> DelaunaySubdomains::create(PointStream& stream, std::uint64_t memory,
                                                      const std::string& folder, std::size_t subdomain_points,
                                                      std::size_t most_points, TakeTetrahedra take) {
  SPLATVOL_TRY_ASSIGN(points, StoredPoints::create(stream, folder));
  const std::uint64_t room = memory / (subdomain_points * (point_bytes + (take ? found_bytes : 0)));
  const auto threads = static_cast<std::uint64_t>(tbb::info::default_concurrency());
  const std::size_t at_once = std::clamp<std::uint64_t>(room, 1, threads);
  DelaunaySubdomains subdomains(std::move(points), stream.summary().cube, subdomain_points, most_points, at_once);
  if (!take) return subdomains;
  const auto& nodes = subdomains.points_.nodes();
  std::vector<std::uint64_t> begins;
  for (std::size_t i = 0; i + 1 < subdomains.cuts_.size(); ++i) begins.push_back(nodes[subdomains.cuts_[i]].begin);
  begins.push_back(nodes[subdomains.cuts_.back() - 1].end);
  SPLATVOL_TRY_SET(subdomains.shared_, SharedTetrahedra::create(std::move(begins), folder, std::move(take)));
  return subdomains;
}

// Triangulates the next subdomains at the same time.
Status DelaunaySubdomains::triangulate(std::size_t count) {
  struct Outcome {
    Status status;
    PointBatch points;
    FoundTetrahedra found;
    bool uncertain = false;
  };
  std::vector<Outcome> outcomes(count);
  tbb::parallel_for(std::size_t{0}, count, [&, stop = stop_of_thread()](std::size_t i) {
    const Interruptible heeds(stop);
    Subdomain subdomain(points_, cube_, cuts_[next_ + i], cuts_[next_ + i + 1], most_points_);
    outcomes[i].status = subdomain.run(outcomes[i].points, shared_ ? &outcomes[i].found : nullptr);
    outcomes[i].uncertain = subdomain.uncertain();
  });
  next_ += count;
  for (Outcome& outcome : outcomes) {
    SPLATVOL_TRY(outcome.status);
    if (outcome.uncertain) uncertain_ += outcome.points.size();
    ready_.push_back(std::move(outcome.points));
    if (shared_) SPLATVOL_TRY(shared_->add(outcome.found));
    outcome.found = {};
  }
  return {};
}

Result<bool> DelaunaySubdomains::next(PointBatch& batch) {
  if (ended_) return false;
  if (ready_.empty()) {
    const std::size_t count = std::min(at_once_, cuts_.size() - 1 - next_);
    if (count == 0) {
      ended_ = true;
      if (shared_) SPLATVOL_TRY(shared_->finish());
      return false;
    }
    SPLATVOL_TRY(triangulate(count));
  }
  const PointBatch& subdomain = ready_.front();
  const std::size_t end = std::min(returned_ + points_at_once, subdomain.size());
  append_points(subdomain, std::exchange(returned_, end), end, batch);
  if (end == subdomain.size()) {
    ready_.pop_front();
    returned_ = 0;
  }
  return true;
}

}  // namespace splatvol
