#include "builder/output/density.h"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <numbers>
#include <numeric>
#include <utility>

#include "splat/ellipsoid.h"

namespace splatvol {
namespace {

constexpr int iterations = 12;
constexpr double damping = 0.7;  // without it, splats that see each other would swing
constexpr int spreading_passes = 2;
constexpr double least_density = 1.0 / 8, largest_density = 8;

// Bounds of the work, and so of the memory. Meshes have some 30 ellipsoids in sight of a splat, layers thinner than
// their rounding 80, thousands of cells round one vertex thousands.
constexpr std::uint64_t most_in_sight = 112;                       // of a splat, on average
constexpr std::uint64_t always_in_sight = std::uint64_t{1} << 20;  // of all splats together, besides
constexpr std::uint32_t most_counted = 256;                        // in sight of a splat, if it is too much for all

// Samples of a splat's material, at the positions origin + x spacing[0] + y spacing[1] + z spacing[2] with x, y and z
// from `offsets`.
struct Lattice {
  dvec3 origin;
  dmat3 spacing;
  std::array<float, 28> weights;  // 1; 0 outside of the material, and behind the last sample
  dvec3 reach;                    // half extents of the box round the samples
};

// Three samples along each axis, padded to whole vectors.
constexpr std::size_t samples = 27;
struct Offsets {
  std::array<float, 28> x{}, y{}, z{};

  constexpr Offsets() {
    for (std::size_t i = 0; i < samples; ++i) {
      const std::size_t layer = i / 9, row = i / 3 % 3;
      x[i] = static_cast<float>(i % 3) - 1;
      y[i] = static_cast<float>(row) - 1;
      z[i] = static_cast<float>(layer) - 1;
    }
  }
};
constexpr Offsets offsets;

// The sum of an ellipsoid's density over a lattice. Single precision is enough in the ball, where nothing cancels.
double density_over(const Ellipsoid& ellipsoid, const Lattice& lattice) {
  const dvec3 middle = ellipsoid.to_ball * (lattice.origin - ellipsoid.center);
  const dmat3 spacing = ellipsoid.to_ball * lattice.spacing;
  const double reach = glm::length(spacing[0]) + glm::length(spacing[1]) + glm::length(spacing[2]);
  const double nearest = glm::length(middle) - reach;
  if (!(nearest < 1)) return 0;

  const vec3 m(middle), u(spacing[0]), v(spacing[1]), w(spacing[2]), outward(ellipsoid.outward);
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
  Bounds(const dvec3& center, const dvec3& reach)
      : low{center.x - reach.x, center.y - reach.y, center.z - reach.z, 0},
        high{center.x + reach.x, center.y + reach.y, center.z + reach.z, 0} {}

  void include(const Bounds& other) {
    low = other.low < low ? other.low : low;
    high = other.high > high ? other.high : high;
  }
  [[nodiscard]] bool meets(const Bounds& other) const {
    const auto all = (low <= other.high) & (other.low <= high);
    return (all[0] & all[1] & all[2]) != 0;
  }
};

// A tree of boxes round ellipsoids of about one size: a large one among small ones would make all the boxes above it
// large. A box has `fan` children.
class BoxTree {
 public:
  struct Member {
    Bounds bounds;
    std::uint32_t ellipsoid;
  };

  /// `ellipsoids` must outlive this.
  BoxTree(std::span<const Ellipsoid> ellipsoids, std::vector<std::uint32_t> members)
      : ellipsoids_(ellipsoids), members_(std::move(members)) {
    for (std::size_t count = members_.size(); tiers_.empty() || count > 1;) {
      std::vector<Bounds> above((count + fan - 1) / fan);
      for (std::size_t i = 0; i < count; ++i)
        above[i / fan].include(tiers_.empty() ? member(i).bounds : tiers_.back()[i]);
      count = above.size();
      tiers_.push_back(std::move(above));
    }
  }

  // Calls visit(member) for every ellipsoid whose box meets these bounds.
  template <class Visit>
  void for_each(const Bounds& bounds, const Visit& visit) const {
    descend(tiers_.size() - 1, 0, bounds, [&](const Member& member) {
      visit(member);
      return true;
    });
  }

  // Returns how many ellipsoids' boxes meet these bounds; `most` if they are more.
  [[nodiscard]] std::uint32_t count(const Bounds& bounds, std::uint32_t most) const {
    std::uint32_t count = 0;
    descend(tiers_.size() - 1, 0, bounds, [&](const Member& /*member*/) { return ++count < most; });
    return count;
  }

 private:
  static constexpr std::size_t fan = 4;

  // Ends when `visit` returns false; returns whether it did not.
  template <class Visit>
  bool descend(std::size_t tier, std::size_t i, const Bounds& bounds, const Visit& visit) const {
    if (!tiers_[tier][i].meets(bounds)) return true;
    const std::size_t end = std::min((i + 1) * fan, tier == 0 ? members_.size() : tiers_[tier - 1].size());
    for (std::size_t child = i * fan; child < end; ++child) {
      if (tier > 0) {
        if (!descend(tier - 1, child, bounds, visit)) return false;
      } else if (const Member found = member(child); found.bounds.meets(bounds) && !visit(found)) {
        return false;
      }
    }
    return true;
  }

  // Bounds are made anew: to keep them would take more memory than all the rest of the tree.
  [[nodiscard]] Member member(std::size_t i) const {
    const Ellipsoid& ellipsoid = ellipsoids_[members_[i]];
    return {{ellipsoid.center, ellipsoid.reach}, members_[i]};
  }

  std::span<const Ellipsoid> ellipsoids_;
  std::vector<std::uint32_t> members_;
  std::vector<std::vector<Bounds>> tiers_;  // from the boxes round members up to one box
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
  for (auto& [size, of_size] : members) trees.emplace_back(ellipsoids, std::move(of_size));
  return trees;
}

// Samples a box with the splat's covariance, cut in three along each axis.
Lattice make_lattice(const FittedSplat& splat) {
  const dmat3 axes = glm::mat3_cast(splat.shape.orientation);
  const double distance_2 = glm::dot(splat.shape.boundary, splat.shape.boundary);
  const double spacing = 2 * std::numbers::sqrt3 / 3;  // deviations
  Lattice lattice{splat.centroid, axes, {}, dvec3(0)};
  for (int k = 0; k < 3; ++k) {
    lattice.spacing[k] *= spacing * splat.shape.deviations[k];
    lattice.reach += glm::abs(lattice.spacing[k]);
  }
  for (std::size_t i = 0; i < samples; ++i) {
    const dvec3 sample = spacing * dvec3(offsets.x[i], offsets.y[i], offsets.z[i]);
    lattice.weights[i] = distance_2 > 0 && glm::dot(sample, splat.shape.boundary) > distance_2 ? 0.0F : 1.0F;
  }
  return lattice;
}

// A splat that lies over another one.
struct Overlap {
  std::uint32_t splat;
  float weight;  // its mean density over the other's lattice
};

class DensityFit {
 public:
  explicit DensityFit(std::span<FittedSplat> splats) : splats_(splats), ellipsoids_(splats.size()) {
    tbb::parallel_for(std::size_t{0}, splats.size(),
                      [&](std::size_t i) { ellipsoids_[i] = ellipsoid_of(splats[i].centroid, splats[i].shape); });
  }

  void run() {
    find_overlaps();
    std::vector<float> densities(splats_.size(), 1.0F), next(splats_.size(), 1.0F);
    for (int iteration = 0; iteration < iterations; ++iteration) {
      tbb::parallel_for(std::size_t{0}, portions_.size(), [&](std::size_t b) { improve(b, densities, next); });
      densities.swap(next);
    }
    keep_mass(densities);
    for (std::size_t i = 0; i < splats_.size(); ++i) splats_[i].shape.density = densities[i];
  }

 private:
  // Splats that follow each other, handled by one task.
  static constexpr std::size_t portion_size = 256;
  struct Portion {
    std::vector<Overlap> overlaps;
    std::vector<std::uint32_t> ends;  // [splat of the portion]: of its overlaps
  };

  // Where the splats of a portion lie, and the ellipsoids that may be there.
  struct Search {
    struct Look {
      Lattice lattice{};
      Bounds bounds;       // round the lattice; inside out if the splat draws nothing
      double samples = 0;  // in the material
    };
    std::size_t first = 0;                  // splat of the portion
    std::uint64_t most = 0;                 // in sight of all
    std::vector<Look> looks;                // [splat of the portion]
    std::vector<BoxTree::Member> found;     // by the whole portion
    std::vector<std::uint32_t> candidates;  // indices of `found`: a range of splats has its own behind its parent's
  };

  // If too much is in sight of all splats together, those that have most in sight keep their densities.
  void find_overlaps() {
    const std::vector<BoxTree> trees = make_trees(ellipsoids_);
    const std::uint64_t most = most_in_sight * splats_.size() + always_in_sight;
    is_left_.resize(splats_.size());
    find_overlaps(trees, most, portion_size);
    if (seen_ <= most) return;
    leave_crowded(trees, most);
    find_overlaps(trees, most, 1);  // the boxes of portions meet those of all that is crowded
  }

  // `at_once`: splats that search together. Ends early if more than `most` is in sight.
  void find_overlaps(const std::vector<BoxTree>& trees, std::uint64_t most, std::size_t at_once) {
    portions_.clear();
    portions_.resize((splats_.size() + portion_size - 1) / portion_size);
    seen_ = 0;
    tbb::enumerable_thread_specific<Search> searches;
    tbb::parallel_for(std::size_t{0}, portions_.size(), [&](std::size_t b) {
      Search& search = searches.local();
      search.first = b * portion_size;
      search.most = most;
      find_looks(b, search);
      for (std::size_t k = 0; k < search.looks.size(); k += at_once)
        find_overlaps(trees, search, k, std::min(k + at_once, search.looks.size()), portions_[b]);
      portions_[b].overlaps.shrink_to_fit();
    });
  }

  // Of splats [begin, end) of a portion.
  void find_overlaps(const std::vector<BoxTree>& trees, Search& search, std::size_t begin, std::size_t end,
                     Portion& portion) {
    Bounds bounds;
    for (std::size_t k = begin; k < end; ++k) bounds.include(search.looks[k].bounds);
    search.found.clear();
    for (const BoxTree& tree : trees)
      tree.for_each(bounds, [&](const BoxTree::Member& member) { search.found.push_back(member); });
    search.candidates.resize(search.found.size());
    std::iota(search.candidates.begin(), search.candidates.end(), 0);
    append_overlaps(search, begin, end, 0, search.found.size(), portion);
  }

  // Chooses the splats that are left as they are, so that at most `most` is in sight of the others.
  void leave_crowded(const std::vector<BoxTree>& trees, std::uint64_t most) {
    std::vector<std::uint32_t> counts(splats_.size());
    tbb::parallel_for(std::size_t{0}, counts.size(), [&](std::size_t i) {
      const Search::Look look = look_of(i);
      for (const BoxTree& tree : trees) {
        if (counts[i] == most_counted) break;
        counts[i] += tree.count(look.bounds, most_counted - counts[i]);
      }
    });
    std::vector<std::uint64_t> splats(most_counted + 1);  // [count]
    for (const std::uint32_t count : counts) ++splats[count];
    std::uint32_t limit = 0;
    for (std::uint64_t sum = 0; limit + 1 < most_counted; ++limit)
      if ((sum += splats[limit + 1] * (limit + 1)) > most) break;
    for (std::size_t i = 0; i < counts.size(); ++i) is_left_[i] = counts[i] > limit ? 1 : 0;
  }

  void find_looks(std::size_t b, Search& search) const {
    search.looks.clear();
    for (std::size_t i = b * portion_size; i < std::min((b + 1) * portion_size, splats_.size()); ++i) {
      search.looks.push_back(is_left_[i] != 0 ? Search::Look{} : look_of(i));
    }
  }

  [[nodiscard]] Search::Look look_of(std::size_t i) const {
    Search::Look look;
    if (!(ellipsoids_[i].peak > 0)) return look;
    look.lattice = make_lattice(splats_[i]);
    look.bounds = {look.lattice.origin, look.lattice.reach};
    for (const float weight : look.lattice.weights) look.samples += static_cast<double>(weight);
    return look;
  }

  // Appends the overlaps of splats [begin, end), whose candidates are [first, last). Neighbours in Morton order look at
  // about the same ellipsoids: each half of a range chooses from those that the whole range has in sight.
  void append_overlaps(Search& search, std::size_t begin, std::size_t end, std::size_t first, std::size_t last,
                       Portion& portion) {
    if (seen_ > search.most) return;
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
      append_overlaps(search, begin, middle, last, in_sight, portion);
      append_overlaps(search, middle, end, last, in_sight, portion);
      return;
    }
    const Search::Look& look = search.looks[begin];
    const std::size_t i = search.first + begin;
    if (look.samples > 0 && (seen_ += in_sight - last) > search.most) return;
    if (is_left_[i] != 0) portion.overlaps.push_back({static_cast<std::uint32_t>(i), 1});  // it lies over itself
    for (std::size_t c = last; c < in_sight && look.samples > 0; ++c) {
      const std::uint32_t j = search.found[candidates[c]].ellipsoid;
      const double seen = density_over(ellipsoids_[j], look.lattice);
      if (seen > 0) portion.overlaps.push_back({j, static_cast<float>(seen / look.samples)});
    }
    portion.ends.push_back(static_cast<std::uint32_t>(portion.overlaps.size()));
  }

  void improve(std::size_t b, const std::vector<float>& densities, std::vector<float>& next) const {
    std::uint32_t overlap = 0;
    for (std::size_t k = 0; k < portions_[b].ends.size(); ++k) {
      const std::size_t i = b * portion_size + k;
      double seen = 0;
      for (; overlap < portions_[b].ends[k]; ++overlap)
        seen += double{portions_[b].overlaps[overlap].weight} * densities[portions_[b].overlaps[overlap].splat];
      const double factor = seen > 0 ? std::pow(seen, -damping) : 1;
      next[i] = static_cast<float>(std::clamp(densities[i] * factor, least_density, largest_density));
    }
  }

  // Scales the factors so that they neither add nor take mass in any neighbourhood. A splat's neighbourhood has the
  // mass that arrives there when each splat spreads its mass evenly over the splats that it overlaps, a few times over.
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
    for (std::size_t b = 0; b < portions_.size(); ++b) {
      std::uint32_t begin = 0;
      for (std::size_t k = 0; k < portions_[b].ends.size(); ++k) {
        const auto seen = std::span(portions_[b].overlaps).subspan(begin, portions_[b].ends[k] - begin);
        begin = portions_[b].ends[k];
        for (const Overlap& overlap : seen)
          result[overlap.splat] += masses[b * portion_size + k] / static_cast<double>(seen.size());
      }
    }
    masses.swap(result);
  }

  std::span<FittedSplat> splats_;
  std::vector<Ellipsoid> ellipsoids_;
  std::vector<Portion> portions_;
  std::vector<std::uint8_t> is_left_;    // [splat]: 1: its density stays as it is
  std::atomic<std::uint64_t> seen_ = 0;  // ellipsoids in sight of all other splats: whose boxes meet their lattices'
};

}  // namespace

void fit_densities(std::span<FittedSplat> splats) { DensityFit(splats).run(); }

}  // namespace splatvol
