#include "builder/scattered/leaf_samples.h"

#include <algorithm>
#include <limits>
#include <random>

namespace splatvol {
namespace {

// Points near a block do not count if they are more: then it lies beside a dense cluster.
constexpr std::size_t most_near = 2048;

// Makes up for the rounding of squares to single precision.
constexpr double rounding = 1 + 1e-6;

// Places of samples in a cube from -.5 to .5.
struct Places {
  std::array<float, LeafSamples::count> x, y, z;
};

// Several choices, which leaves take in turn.
constexpr std::size_t place_count = 64;

const std::array<Places, place_count>& all_places() {
  static const std::array<Places, place_count> made = [] {
    std::array<Places, place_count> places;
    std::mt19937 random(1);  // the standard fixes its numbers
    const auto at = [&](std::size_t part) {
      const auto share = static_cast<float>(random() >> 8) * 0x1p-24F;
      return (static_cast<float>(part) + share) / LeafSamples::side - 0.5F;
    };
    for (Places& choice : places)
      for (std::size_t s = 0; s < LeafSamples::count; ++s) {
        choice.x[s] = at(s % LeafSamples::side);
        choice.y[s] = at(s / LeafSamples::side % LeafSamples::side);
        choice.z[s] = at(s / (LeafSamples::side * LeafSamples::side));
      }
    return places;
  }();
  return made;
}

}  // namespace

bool LeafSamples::find(const PointLeaves& points, const PointLeaves::Leaf& leaf, std::uint32_t own,
                       std::uint32_t seed) {
  if (leaf.block != block_) enter_block(points, leaf.block, own);
  const dvec3 extent = leaf.box.extent();
  unit_ = glm::length(extent) / 2;
  if (!has_own_ || !(unit_ > 0)) return false;
  find_candidates(leaf.box);
  place(extent, seed);
  compare();
  return true;
}

// Lists the points in and near a block.
void LeafSamples::enter_block(const PointLeaves& points, std::uint32_t block, std::uint32_t own) {
  block_ = block;
  const Box& box = points.blocks()[block];
  const dvec3 extent = box.extent();
  const double margin = extent[longest_axis(extent)] / 2;
  near_.clear();
  points.find({box.low - margin, box.high + margin}, near_);
  if (near_.size() > most_near) {
    near_.clear();
    points.find(box, near_);
  }
  has_own_ = std::ranges::any_of(near_, [&](const PointLeaves::Entry& entry) { return entry.point() < own; });
}

// Keeps the points that are nearer to some location of the leaf than the point nearest to its centre.
void LeafSamples::find_candidates(const Box& leaf) {
  const dvec3 center = (leaf.low + leaf.high) / 2.0, half = leaf.extent() / 2.0;
  double least = std::numeric_limits<double>::infinity();
  dvec3 nearest(0);
  for (const PointLeaves::Entry& entry : near_) {
    const dvec3 d = entry.position() - center;
    const double square = squared_length(d);
    nearest = square < least ? d : nearest;
    least = std::min(least, square);
  }
  kept_.resize(near_.size());
  std::size_t kept = 0;
  for (std::uint32_t i = 0; i < near_.size(); ++i) {
    const dvec3 d = near_[i].position() - center;
    kept_[kept] = i;
    kept += squared_length(d) <= rounding * (least + 2 * glm::dot(glm::abs(d - nearest), half)) ? 1 : 0;
  }
  candidates_.clear();
  for (std::size_t k = 0; k < kept; ++k) candidates_.push_back(candidate(near_[kept_[k]], center));
}

void LeafSamples::place(const dvec3& extent, std::uint32_t seed) {
  const Places& places = all_places()[seed % place_count];
  const vec3 scale(extent / unit_);
  for (std::size_t s = 0; s < count; ++s) {
    x_[s] = scale.x * places.x[s];
    y_[s] = scale.y * places.y[s];
    z_[s] = scale.z * places.z[s];
  }
}

// Compares all samples with all candidates.
void LeafSamples::compare() {
  nearest_square_.fill(std::numeric_limits<float>::infinity());
  second_square_.fill(std::numeric_limits<float>::infinity());
  nearest_.fill(-1);
  second_.fill(-1);
  for (std::size_t c = 0; c < candidates_.size(); ++c) {
    const Candidate& candidate = candidates_[c];
    const auto number = static_cast<std::int32_t>(c);
    for (std::size_t s = 0; s < count; ++s) {
      const float x = x_[s] - candidate.x, y = y_[s] - candidate.y, z = z_[s] - candidate.z;
      const float square = x * x + y * y + z * z, first = nearest_square_[s], second = second_square_[s];
      const bool nearest = square < first, near = square < second;
      second_square_[s] = nearest ? first : near ? square : second;
      second_[s] = nearest ? nearest_[s] : near ? number : second_[s];
      nearest_square_[s] = nearest ? square : first;
      nearest_[s] = nearest ? number : nearest_[s];
    }
  }
}

}  // namespace splatvol
