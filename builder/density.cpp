#include "builder/density.h"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <numbers>
#include <numeric>
#include <utility>

#include "base/splat_kernel.h"

namespace splatvol {
namespace {

constexpr int iterations = 12;
constexpr double damping = 0.7;  // splats that see each other would swing
constexpr int spreading_passes = 2;
constexpr double least_density = 1.0 / 8, largest_density = 8;

// A splat as it is drawn.
struct Ellipsoid {
  dvec3 centre{0};
  dmat3 to_ball{0};  // into the unit ball
  dvec3 reach{0};    // half extents of the box round it
  double peak = 0;   // density at the centre; 0: draws nothing
  dvec3 outward{0};  // in the ball: what lies on this side of the centre is cut off; 0: nothing
};

Ellipsoid make_ellipsoid(const PlacedShape& splat) {
  const format::SplatShape& shape = splat.shape;
  const dvec3& d = shape.deviations;
  if (!(shape.mass > 0 && d[2] > 0)) return {};

  // In units of the deviations, shift shift^T (format::reflection_shift) stretches the ball along the normal.
  const double distance = glm::length(shape.boundary);
  const dvec3 normal = distance > 0 ? shape.boundary / distance : dvec3(0);
  const double stretch = std::sqrt(1 + distance * distance);
  const dmat3 axes = glm::mat3_cast(shape.orientation);
  const dmat3 scale(dvec3(d.x, 0, 0), dvec3(0, d.y, 0), dvec3(0, 0, d.z));
  const dmat3 shrink(dvec3(1 / d.x, 0, 0), dvec3(0, 1 / d.y, 0), dvec3(0, 0, 1 / d.z));
  const dmat3 along = glm::outerProduct(normal, normal);
  const dmat3 from_ball = moments_half_width * (axes * scale * (dmat3(1) + (stretch - 1) * along));

  Ellipsoid ellipsoid;
  ellipsoid.centre = splat.centroid + format::reflection_shift(shape);
  ellipsoid.to_ball =
      (1 / moments_half_width) * ((dmat3(1) + (1 / stretch - 1) * along) * shrink * glm::transpose(axes));
  for (int k = 0; k < 3; ++k)
    ellipsoid.reach[k] = glm::length(dvec3(from_ball[0][k], from_ball[1][k], from_ball[2][k]));
  const double volume = std::pow(moments_half_width, 3) * d.x * d.y * d.z * stretch;
  ellipsoid.peak = (distance > 0 ? 2 : 1) * shape.mass * moments_peak / volume;
  if (distance > 0) ellipsoid.outward = normal;
  return std::isfinite(ellipsoid.peak) ? ellipsoid : Ellipsoid{};
}

// Places in a splat's material, at the crossings of a lattice: origin + x step[0] + y step[1] + z step[2], where x, y
// and z run over `offsets`.
struct Lattice {
  dvec3 origin;
  dmat3 step;
  std::array<float, 28> weights;  // 1, or 0 for places outside of the material; and behind the last
  dvec3 reach;                    // half extents of the box round it
};

// Three places along each axis, padded to whole vectors.
constexpr std::size_t places = 27;
struct Offsets {
  std::array<float, 28> x{}, y{}, z{};

  constexpr Offsets() {
    for (std::size_t i = 0; i < places; ++i) {
      x[i] = static_cast<float>(i % 3) - 1;
      y[i] = static_cast<float>(i / 3 % 3) - 1;
      z[i] = static_cast<float>(i / 9) - 1;
    }
  }
};
constexpr Offsets offsets;

// The sum of an ellipsoid's density over a lattice. Single precision where nothing cancels any more: in the ball.
double density_over(const Ellipsoid& ellipsoid, const Lattice& lattice) {
  const dvec3 middle = ellipsoid.to_ball * (lattice.origin - ellipsoid.centre);
  const dmat3 step = ellipsoid.to_ball * lattice.step;
  const double reach = glm::length(step[0]) + glm::length(step[1]) + glm::length(step[2]);
  const double nearest = glm::length(middle) - reach;
  if (!(nearest < 1)) return 0;

  const vec3 m(middle), u(step[0]), v(step[1]), w(step[2]), outward(ellipsoid.outward);
  const Offsets& at = offsets;
  std::array<float, 28> densities;
  for (std::size_t i = 0; i < densities.size(); ++i) {
    const float x = m.x + at.x[i] * u.x + at.y[i] * v.x + at.z[i] * w.x;
    const float y = m.y + at.x[i] * u.y + at.y[i] * v.y + at.z[i] * w.y;
    const float z = m.z + at.x[i] * u.z + at.y[i] * v.z + at.z[i] * w.z;
    const float rest = std::max(1.0F - (x * x + y * y + z * z), 0.0F);
    const float inside = x * outward.x + y * outward.y + z * outward.z <= 0 ? lattice.weights[i] : 0.0F;
    densities[i] = inside * rest * std::sqrt(rest);
  }
  std::array<float, 4> sums{};
  for (std::size_t i = 0; i < densities.size(); i += 4)
    for (std::size_t k = 0; k < 4; ++k) sums[k] += densities[i + k];
  return ellipsoid.peak * static_cast<double>((sums[0] + sums[1]) + (sums[2] + sums[3]));
}

// A box, inside out at first.
struct Bounds {
  using Lanes [[gnu::vector_size(4 * sizeof(double))]] = double;
  Lanes low = Lanes{} + std::numeric_limits<double>::infinity(), high = -low;  // the fourth is not used

  Bounds() = default;
  Bounds(const dvec3& centre, const dvec3& reach)
      : low{centre.x - reach.x, centre.y - reach.y, centre.z - reach.z, 0},
        high{centre.x + reach.x, centre.y + reach.y, centre.z + reach.z, 0} {}

  void include(const Bounds& other) {
    low = other.low < low ? other.low : low;
    high = other.high > high ? other.high : high;
  }
  [[nodiscard]] bool meets(const Bounds& other) const {
    const auto all = (low <= other.high) & (other.low <= high);
    return (all[0] & all[1] & all[2]) != 0;
  }
};

// Boxes round `fan` boxes each of the level below, the lowest round ellipsoids of about one size: a large one among
// small ones would make all the boxes above it large.
class BoxTree {
 public:
  struct Member {
    Bounds bounds;
    std::uint32_t ellipsoid;
  };

  BoxTree(std::span<const Ellipsoid> ellipsoids, std::span<const std::uint32_t> members) {
    members_.reserve(members.size());
    for (const std::uint32_t i : members) members_.push_back({{ellipsoids[i].centre, ellipsoids[i].reach}, i});
    for (std::size_t count = members.size(); levels_.empty() || count > 1;) {
      std::vector<Bounds> above((count + fan - 1) / fan);
      for (std::size_t i = 0; i < count; ++i)
        above[i / fan].include(levels_.empty() ? members_[i].bounds : levels_.back()[i]);
      count = above.size();
      levels_.push_back(std::move(above));
    }
  }

  // Calls visit(member) for every ellipsoid whose box meets these.
  template <class Visit>
  void for_each(const Bounds& bounds, const Visit& visit) const {
    descend(levels_.size() - 1, 0, bounds, visit);
  }

 private:
  static constexpr std::size_t fan = 4;

  template <class Visit>
  void descend(std::size_t level, std::size_t i, const Bounds& bounds, const Visit& visit) const {
    if (!levels_[level][i].meets(bounds)) return;
    const std::size_t end = std::min((i + 1) * fan, level == 0 ? members_.size() : levels_[level - 1].size());
    for (std::size_t child = i * fan; child < end; ++child) {
      if (level > 0)
        descend(level - 1, child, bounds, visit);
      else if (members_[child].bounds.meets(bounds))
        visit(members_[child]);
    }
  }

  std::vector<Member> members_;
  std::vector<std::vector<Bounds>> levels_;  // boxes round `fan` members each, round `fan` of these, ...
};

std::vector<BoxTree> make_trees(std::span<const Ellipsoid> ellipsoids) {
  constexpr int octaves_per_tree = 2;
  std::map<int, std::vector<std::uint32_t>> members;
  for (std::size_t i = 0; i < ellipsoids.size(); ++i) {
    const dvec3& reach = ellipsoids[i].reach;
    if (ellipsoids[i].peak > 0)
      members[std::ilogb(std::max({reach.x, reach.y, reach.z})) / octaves_per_tree].push_back(
          static_cast<std::uint32_t>(i));
  }
  std::vector<BoxTree> trees;
  for (const auto& [size, of_size] : members) trees.emplace_back(ellipsoids, of_size);
  return trees;
}

// Of a cell with the splat's covariance, cut in three each way.
Lattice make_lattice(const PlacedShape& splat) {
  const dmat3 axes = glm::mat3_cast(splat.shape.orientation);
  const double distance_2 = glm::dot(splat.shape.boundary, splat.shape.boundary);
  const double step = 2 * std::numbers::sqrt3 / 3;  // deviations
  Lattice lattice{splat.centroid, axes, {}, dvec3(0)};
  for (int k = 0; k < 3; ++k) {
    lattice.step[k] *= step * splat.shape.deviations[k];
    lattice.reach += glm::abs(lattice.step[k]);
  }
  for (std::size_t i = 0; i < places; ++i) {
    const dvec3 place = step * dvec3(offsets.x[i], offsets.y[i], offsets.z[i]);
    lattice.weights[i] = distance_2 > 0 && glm::dot(place, splat.shape.boundary) > distance_2 ? 0.0F : 1.0F;
  }
  return lattice;
}

// What a splat sees of another's density.
struct View {
  std::uint32_t splat;
  float weight;
};

class DensityFit {
 public:
  explicit DensityFit(std::span<PlacedShape> splats) : splats_(splats), ellipsoids_(splats.size()) {
    tbb::parallel_for(std::size_t{0}, splats.size(),
                      [&](std::size_t i) { ellipsoids_[i] = make_ellipsoid(splats[i]); });
  }

  void run() {
    find_views();
    std::vector<float> densities(splats_.size(), 1.0F), next(splats_.size(), 1.0F);
    for (int iteration = 0; iteration < iterations; ++iteration) {
      tbb::parallel_for(std::size_t{0}, blocks_.size(), [&](std::size_t b) { improve(b, densities, next); });
      densities.swap(next);
    }
    keep_mass(densities);
    for (std::size_t i = 0; i < splats_.size(); ++i) splats_[i].shape.density = densities[i];
  }

 private:
  static constexpr std::size_t block_size = 256;
  struct Block {
    std::vector<View> views;
    std::vector<std::uint32_t> ends;  // [splat of the block]
  };

  // Where the splats of a block look, and what may be there.
  struct Search {
    struct Look {
      Lattice lattice{};
      Bounds bounds;  // round it; inside out for none
      double samples = 0;
    };
    std::vector<Look> looks;  // [splat of the block]
    std::vector<BoxTree::Member> found;
    std::vector<std::uint32_t> candidates;  // of those: for a range of splats, behind those of the range round it
  };

  void find_views() {
    const std::vector<BoxTree> trees = make_trees(ellipsoids_);
    blocks_.resize((splats_.size() + block_size - 1) / block_size);
    tbb::enumerable_thread_specific<Search> searches;
    tbb::parallel_for(std::size_t{0}, blocks_.size(), [&](std::size_t b) {
      Search& search = searches.local();
      find_looks(b, search);
      Bounds bounds;
      for (const Search::Look& look : search.looks) bounds.include(look.bounds);
      search.found.clear();
      for (const BoxTree& tree : trees)
        tree.for_each(bounds, [&](const BoxTree::Member& member) { search.found.push_back(member); });
      search.candidates.resize(search.found.size());
      std::iota(search.candidates.begin(), search.candidates.end(), 0);
      append_views(search, 0, search.looks.size(), 0, search.found.size(), blocks_[b]);
    });
  }

  void find_looks(std::size_t b, Search& search) const {
    search.looks.clear();
    for (std::size_t i = b * block_size; i < std::min((b + 1) * block_size, splats_.size()); ++i) {
      Search::Look& look = search.looks.emplace_back();
      if (!(ellipsoids_[i].peak > 0)) continue;
      look.lattice = make_lattice(splats_[i]);
      look.bounds = {look.lattice.origin, look.lattice.reach};
      for (const float weight : look.lattice.weights) look.samples += static_cast<double>(weight);
    }
  }

  // Of a range of splats, whose candidates are a range as well. Neighbours in Morton order look at about the same
  // places: each half of them has to choose from what the whole has in sight only.
  void append_views(Search& search, std::size_t begin, std::size_t end, std::size_t first, std::size_t last,
                    Block& block) const {
    Bounds bounds;
    for (std::size_t k = begin; k < end; ++k) bounds.include(search.looks[k].bounds);
    std::vector<std::uint32_t>& candidates = search.candidates;
    candidates.resize(last + (last - first));
    std::size_t in_sight = last;
    for (std::size_t c = first; c < last; ++c) {
      candidates[in_sight] = candidates[c];
      in_sight += search.found[candidates[c]].bounds.meets(bounds) ? 1 : 0;
    }
    if (end - begin > 1) {
      const std::size_t middle = begin + (end - begin) / 2;
      append_views(search, begin, middle, last, in_sight, block);
      append_views(search, middle, end, last, in_sight, block);
      return;
    }
    const Search::Look& look = search.looks[begin];
    for (std::size_t c = last; c < in_sight && look.samples > 0; ++c) {
      const std::uint32_t j = search.found[candidates[c]].ellipsoid;
      const double seen = density_over(ellipsoids_[j], look.lattice);
      if (seen > 0) block.views.push_back({j, static_cast<float>(seen / look.samples)});
    }
    block.ends.push_back(static_cast<std::uint32_t>(block.views.size()));
  }

  void improve(std::size_t b, const std::vector<float>& densities, std::vector<float>& next) const {
    std::uint32_t view = 0;
    for (std::size_t k = 0; k < blocks_[b].ends.size(); ++k) {
      const std::size_t i = b * block_size + k;
      double seen = 0;
      for (; view < blocks_[b].ends[k]; ++view)
        seen += double{blocks_[b].views[view].weight} * densities[blocks_[b].views[view].splat];
      const double factor = seen > 0 ? std::pow(seen, -damping) : 1;
      next[i] = static_cast<float>(std::clamp(densities[i] * factor, least_density, largest_density));
    }
  }

  // The factors must not add or take mass, neighbourhood by neighbourhood: compares what both give when each splat
  // spreads its mass evenly over those that it sees, some times over.
  void keep_mass(std::vector<float>& densities) const {
    std::vector<double> before(splats_.size()), after(splats_.size());
    for (std::size_t i = 0; i < splats_.size(); ++i) {
      before[i] = splats_[i].shape.mass;
      after[i] = densities[i] * before[i];
    }
    for (int pass = 0; pass < spreading_passes; ++pass) {
      spread(before);
      spread(after);
    }
    for (std::size_t i = 0; i < splats_.size(); ++i)
      if (after[i] > 0 && before[i] > 0) densities[i] *= static_cast<float>(before[i] / after[i]);
  }

  void spread(std::vector<double>& masses) const {
    std::vector<double> result(masses.size());
    for (std::size_t b = 0; b < blocks_.size(); ++b) {
      std::uint32_t begin = 0;
      for (std::size_t k = 0; k < blocks_[b].ends.size(); ++k) {
        const auto seen = std::span(blocks_[b].views).subspan(begin, blocks_[b].ends[k] - begin);
        begin = blocks_[b].ends[k];
        for (const View& view : seen)
          result[view.splat] += masses[b * block_size + k] / static_cast<double>(seen.size());
      }
    }
    masses.swap(result);
  }

  std::span<PlacedShape> splats_;
  std::vector<Ellipsoid> ellipsoids_;
  std::vector<Block> blocks_;
};

}  // namespace

void fit_densities(std::span<PlacedShape> splats) { DensityFit(splats).run(); }

}  // namespace splatvol
