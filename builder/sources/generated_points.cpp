#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "builder/sources/generated_field.h"
#include "builder/sources/generator.h"
#include "builder/sources/piece_ahead.h"

namespace splatvol {
namespace {

using generated::box_low;
using generated::box_size;
using generated::ring_radius;
using generated::strand_radius;
using generated::to_float;
using generated::Turn;

// The vortex's points lie round the strands with a density of 1 / (1 + (d / near)^2)^2 up to the distance `far`, which
// still lies in the box.
constexpr double near = 0.05;
constexpr double far = 0.3;

/// Independent random numbers, each found by its number: SplitMix64 (Steele, Lea and Flood 2014) entered anywhere.
class Random {
 public:
  explicit Random(std::uint64_t seed) : key_(mix(seed)) {}

  /// In [0, 1), a multiple of 2^-53. A point has 8 numbers.
  [[nodiscard]] double at(std::uint64_t point, std::uint64_t number) const {
    constexpr std::uint64_t golden = 0x9E3779B97F4A7C15;
    return static_cast<double>(mix(key_ + golden * (8 * point + number)) >> 11) * 0x1p-53;
  }
  [[nodiscard]] dvec3 vector_at(std::uint64_t point) const { return {at(point, 0), at(point, 1), at(point, 2)}; }

 private:
  static std::uint64_t mix(std::uint64_t z) {
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9;
    z = (z ^ z >> 27) * 0x94D049BB133111EB;
    return z ^ z >> 31;
  }

  std::uint64_t key_;
};

dvec3 vortex_point(const Random& random, std::uint64_t point) {
  if (random.at(point, 3) < 0.125) return box_low + box_size * random.vector_at(point);
  // Twice round the ring: once along each strand.
  const double half = 2 * std::numbers::pi * random.at(point, 0);
  const double c = std::cos(half), s = std::sin(half);
  const Turn turn{c * c - s * s, 2 * s * c, c, s};
  // The share of points within d is proportional to d^2 / (d^2 + near^2).
  const double share = random.at(point, 1) * (far * far / (far * far + near * near));
  const double distance = near * std::sqrt(share / (1 - share));
  const double angle = 2 * std::numbers::pi * random.at(point, 2);
  const dvec2 across = strand_radius * turn.one_and_a_half() + distance * dvec2(std::cos(angle), std::sin(angle));
  const double r = ring_radius + across.x;
  return {r * turn.cos, r * turn.sin, across.y};
}

// A cluster's centre and deviation have numbers that no point has.
dvec3 cluster_point(const Random& random, std::uint64_t point) {
  constexpr std::uint64_t clusters = 200, first = std::uint64_t{1} << 60;
  if (random.at(point, 7) < 0.5) return random.vector_at(point);
  const std::uint64_t cluster = first + static_cast<std::uint64_t>(clusters * random.at(point, 6));
  const double deviation = std::pow(10, -3 + 2 * random.at(cluster, 3));
  // Two numbers make two normal ones (Box and Muller 1958); the logarithm's argument is never 0.
  const auto radius = [&](std::uint64_t n) { return std::sqrt(-2 * std::log(1 - random.at(point, n))); };
  const auto angle = [&](std::uint64_t n) { return 2 * std::numbers::pi * random.at(point, n); };
  const dvec3 normal(radius(0) * std::cos(angle(1)), radius(0) * std::sin(angle(1)), radius(2) * std::cos(angle(3)));
  return random.vector_at(cluster) + deviation * normal;
}

dvec3 point_of(Distribution distribution, const Random& random, std::uint64_t point) {
  constexpr dvec3 on_strand{ring_radius + strand_radius, 0, 0};
  const dvec3 u = random.vector_at(point);
  const bool second = random.at(point, 3) < 0.5;
  switch (distribution) {
    case Distribution::uniform:
      return box_low + box_size * u;
    case Distribution::vortex:
      return vortex_point(random, point);
    case Distribution::half_tiny:
      return second ? on_strand + 1e-3 * box_size * (u - 0.5) : box_low + box_size * u;
    case Distribution::equal:
      return on_strand;
    case Distribution::two_clusters:
      return box_low + box_size * u + dvec3(second ? 1e9 * box_size.x : 0, 0, 0);
    case Distribution::line:
      return dvec3(4, 2, 1) * (u.x - 0.5);  // without rounding
    case Distribution::clusters:
      return cluster_point(random, point);
    case Distribution::layer:
      break;
  }
  return {box_low.x + box_size.x * u.x, box_low.y + box_size.y * u.y, std::exp(-8 * std::numbers::ln10 * u.z)};
}

class PointGenerator final : public Source {
 public:
  explicit PointGenerator(const PointRecipe& recipe)
      : recipe_(recipe),
        random_(recipe.seed),
        pieces_(static_cast<std::size_t>((recipe.count + max_piece_points - 1) / max_piece_points),
                [this](std::size_t piece) { return make_piece(piece); }) {}

  const std::vector<std::string>& attributes() const override { return generated::attributes(); }
  std::size_t piece_count() const override { return pieces_.count(); }
  std::vector<std::uint64_t> part_sizes() override { return std::vector<std::uint64_t>(pieces_.count(), 1); }
  Status select(const std::vector<std::uint64_t>& parts) override {
    pieces_.select(parts);
    return {};
  }
  PieceNumber piece_number() const override { return {0, static_cast<std::uint32_t>(pieces_.last())}; }
  Result<std::unique_ptr<Piece>> next() override { return pieces_.next(); }
  std::optional<std::uint64_t> point_count() const override { return recipe_.count; }
  bool single_precision() const override { return recipe_.single_precision; }
  bool may_have_cells() const override { return false; }

  Result<std::optional<Box>> bounds() override {
    std::vector<Box> boxes(piece_count());
    tbb::parallel_for(std::size_t{0}, boxes.size(), [&](std::size_t piece) {
      Box& box = boxes[piece];
      for (std::uint64_t i = begin(piece); i < begin(piece + 1); ++i) {
        const dvec3 p = position(i);
        box.include({p, p});
      }
    });
    Box all;
    for (const Box& box : boxes) all.include(box);
    return std::optional(all);
  }

 private:
  [[nodiscard]] std::uint64_t begin(std::size_t piece) const {
    return std::min<std::uint64_t>(recipe_.count, std::uint64_t{piece} * max_piece_points);
  }

  [[nodiscard]] dvec3 position(std::uint64_t point) const {
    const dvec3 p = point_of(recipe_.distribution, random_, point);
    return recipe_.single_precision ? dvec3(to_float(p.x), to_float(p.y), to_float(p.z)) : p;
  }

  [[nodiscard]] std::unique_ptr<Piece> make_piece(std::size_t index) const {
    const std::uint64_t first = begin(index);
    const auto count = static_cast<std::size_t>(begin(index + 1) - first);
    auto piece = std::make_unique<Piece>();
    piece->points.resize(count);
    piece->values.assign(1, std::vector<double>(count));
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 4096), [&](const auto& range) {
      for (std::size_t i = range.begin(); i < range.end(); ++i) {
        piece->points[i] = position(first + i);
        const double value = generated_field(piece->points[i]);
        piece->values[0][i] = recipe_.single_precision ? to_float(value) : value;
      }
    });
    return piece;
  }

  PointRecipe recipe_;
  Random random_;
  PieceAhead pieces_;
};

}  // namespace

std::unique_ptr<Source> generate_points(const PointRecipe& recipe) { return std::make_unique<PointGenerator>(recipe); }

}  // namespace splatvol
