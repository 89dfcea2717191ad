#include "builder/sources/generated_field.h"

#include <cmath>

#include "builder/sources/generator.h"

namespace splatvol {
namespace {

using generated::ring_radius;
using generated::strand_radius;
using generated::Turn;

constexpr double core_width = 0.1;

/// Finds the half angle without cancellation. It may be off by half a turn: the strands lie opposite each other.
Turn turn_of(double x, double y, double r) {
  if (r == 0) return {1, 0, 1, 0};
  const double cos = x / r, sin = y / r;
  const double larger = std::sqrt((1 + std::abs(cos)) / 2), smaller = sin / (2 * larger);
  return cos >= 0 ? Turn{cos, sin, larger, smaller} : Turn{cos, sin, smaller, larger};
}

}  // namespace

double generated_field(const dvec3& p) {
  const double r = std::sqrt(p.x * p.x + p.y * p.y);
  const dvec2 across(r - ring_radius, p.z);
  const dvec2 strand = strand_radius * turn_of(p.x, p.y, r).one_and_a_half();
  const auto core = [](dvec2 offset) { return std::exp(-glm::dot(offset, offset) / (core_width * core_width)); };
  return core(across - strand) + core(across + strand) + p.x / (10 * std::sqrt(4 + glm::dot(p, p)));
}

namespace generated {

// Through memory: GCC 12 leaves out the rounding of two neighbours to float and back (-ftree-slp-vectorize).
double to_float(double value) {
  const volatile float rounded = static_cast<float>(value);
  return static_cast<double>(rounded);
}

const std::vector<std::string>& attributes() {
  static const std::vector<std::string> names = {"value"};
  return names;
}

}  // namespace generated
}  // namespace splatvol
