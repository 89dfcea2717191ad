#include "builder/mesh/single_precision.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "builder/mesh/tetrahedra.h"

namespace splatvol {
namespace {

constexpr double most_moves = 64;  // a height, over the move of its face

double float_step(double coordinate) {
  const auto number = static_cast<float>(std::abs(coordinate));
  return static_cast<double>(std::nextafter(number, std::numeric_limits<float>::infinity())) -
         static_cast<double>(number);
}

/// The corners of a tetrahedron, and how far rounding may move each along the axes.
struct Rounded {
  std::array<dvec3, 4> corners{};
  dvec3 moves{0};

  Rounded(std::span<const dvec3> points, const Tetrahedron& tetrahedron) {
    for (std::size_t i = 0; i < 4; ++i) {
      corners[i] = points[tetrahedron[i]];
      for (int axis = 0; axis < 3; ++axis) moves[axis] = std::max(moves[axis], float_step(corners[i][axis]) / 2);
    }
  }

  /// The largest move of a face, times twice its area. A face's height, times the same, is six times the volume.
  [[nodiscard]] double largest_move() const {
    double largest = 0;
    for (std::size_t apex = 0; apex < 4; ++apex) {
      const dvec3 a = corners[(apex + 1) % 4], b = corners[(apex + 2) % 4], c = corners[(apex + 3) % 4];
      largest = std::max(largest, glm::dot(glm::abs(glm::cross(b - a, c - a)), moves));
    }
    return largest;
  }

  [[nodiscard]] double longest_edge() const {
    double longest = 0;
    for (std::size_t i = 0; i < 4; ++i)
      for (std::size_t k = 0; k < i; ++k) longest = std::max(longest, glm::distance(corners[i], corners[k]));
    return longest;
  }
};

}  // namespace

void measure_single_precision(std::span<const dvec3> points, std::span<const Tetrahedron> tetrahedra,
                              CellCensus& census) {
  for (const Tetrahedron& tetrahedron : tetrahedra) {
    const Rounded rounded(points, tetrahedron);
    const auto& [a, b, c, d] = rounded.corners;
    const double six_volumes = std::abs(signed_volume_6(a, b, c, d));
    census.measured_volume += six_volumes / 6;
    if (six_volumes == 0) {
      census.flattened += rounded.longest_edge() < most_moves * glm::length(rounded.moves) ? 1 : 0;
    } else if (most_moves * rounded.largest_move() > six_volumes) {
      ++census.bent;
      census.bent_volume += six_volumes / 6;
    }
  }
}

}  // namespace splatvol
