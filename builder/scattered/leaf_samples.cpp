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

LaneVectors side_by_side(const dvec3& v) { return lanes_of(v, v, v, v); }

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
  entries_.clear();
  points.find({box.low - margin, box.high + margin}, entries_);
  if (entries_.size() > most_near) {
    entries_.clear();
    points.find(box, entries_);
  }
  has_own_ = std::ranges::any_of(entries_, [&](const PointLeaves::Entry& entry) { return entry.point() < own; });
  near_.resize((entries_.size() + lanes - 1) / lanes);
  if (!near_.empty()) near_.back() = {side_by_side(dvec3(std::numeric_limits<double>::quiet_NaN())), {}};
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    Near& near = near_[i / lanes];
    const std::size_t lane = i % lanes;
    const Lanes& entry = entries_[i].lanes;
    near.positions.x[lane] = entry[0], near.positions.y[lane] = entry[1], near.positions.z[lane] = entry[2];
    near.points[lane] = entries_[i].point();
  }
}

// Keeps the points that are nearer to some location of the leaf than the point nearest to its centre.
void LeafSamples::find_candidates(const Box& leaf) {
  const LaneVectors center = side_by_side((leaf.low + leaf.high) / 2.0), half = side_by_side(leaf.extent() / 2.0);
  Lanes squares = Lanes{} + std::numeric_limits<double>::infinity();
  LaneBits numbers{};
  for (std::size_t i = 0; i < near_.size(); ++i) {
    const LaneVectors d = near_[i].positions - center;
    const Lanes square = dot(d, d);
    numbers = square < squares ? LaneBits{} + static_cast<std::int64_t>(i) : numbers;
    squares = square < squares ? square : squares;
  }
  // The first of those that are equally near.
  std::size_t first = 0;
  for (std::size_t l = 1; l < lanes; ++l)
    if (squares[l] < squares[first] || (squares[l] == squares[first] && numbers[l] < numbers[first])) first = l;
  const double least = squares[first];
  const LaneVectors nearest = side_by_side((near_[static_cast<std::size_t>(numbers[first])].positions - center)[first]);
  candidates_.resize(lanes * near_.size());
  std::size_t kept = 0;
  for (std::size_t i = 0; i < near_.size(); ++i) {
    const LaneVectors d = near_[i].positions - center, away = d - nearest;
    const LaneVectors distance{magnitude(away.x), magnitude(away.y), magnitude(away.z)};
    const LaneBits is_near = dot(d, d) <= rounding * (least + 2 * dot(distance, half));
    if (!any(is_near)) continue;
    const Lanes x = d.x / unit_, y = d.y / unit_, z = d.z / unit_;
    for (std::size_t l = 0; l < lanes; ++l) {
      candidates_[kept] = {static_cast<float>(x[l]), static_cast<float>(y[l]), static_cast<float>(z[l]),
                           near_[i].points[l]};
      kept += is_near[l] != 0 ? 1 : 0;
    }
  }
  candidates_.resize(kept);
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
  nearest_.fill(PointLeaves::none);
  second_.fill(PointLeaves::none);
  for (const auto [px, py, pz, point] : candidates_)
    for (std::size_t s = 0; s < count; ++s) {
      const float x = x_[s] - px, y = y_[s] - py, z = z_[s] - pz, square = x * x + y * y + z * z;
      const float first = nearest_square_[s], second = second_square_[s];
      const std::uint32_t first_point = nearest_[s], second_point = second_[s];
      const bool is_nearest = square < first, is_second = square < second;
      second_square_[s] = is_nearest ? first : is_second ? square : second;
      second_[s] = is_nearest ? first_point : is_second ? point : second_point;
      nearest_square_[s] = is_nearest ? square : first;
      nearest_[s] = is_nearest ? point : first_point;
    }
}

}  // namespace splatvol
