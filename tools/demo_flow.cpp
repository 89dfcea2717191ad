#include "tools/demo_flow.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace splatvol {
namespace {

constexpr int segment_count = 480;
constexpr double core_radius = 0.13;
constexpr double knot_scale = 0.52;
constexpr double heat_radius = 0.22;

dvec3 trefoil(double s) {
  return knot_scale * dvec3(std::sin(s) + 2 * std::sin(2 * s), std::cos(s) - 2 * std::cos(2 * s), -std::sin(3 * s));
}

}  // namespace

DemoFlow::DemoFlow() {
  const double spacing = 2 * std::numbers::pi / segment_count;
  for (int i = 0; i < segment_count; ++i) {
    const double s = (i + 0.5) * spacing;
    knot_.push_back({trefoil(s), trefoil(s + spacing / 2) - trefoil(s - spacing / 2), 0.5 + 0.5 * std::sin(s)});
  }
}

FlowSample DemoFlow::at(dvec3 x) const {
  constexpr double s2 = core_radius * core_radius;
  dvec3 velocity(0);
  dvec3 vorticity(0);
  double heat = 0;
  for (const Segment& segment : knot_) {
    const dvec3 d = x - segment.center;
    const double r2 = glm::dot(d, d);
    const double inverse_square = 1 / (r2 + s2);
    const double inverse_cube = inverse_square * std::sqrt(inverse_square);
    velocity += glm::cross(segment.tangent, d) * inverse_cube;
    vorticity += segment.tangent * (3 * s2 * inverse_cube * inverse_square);
    heat = std::max(heat, segment.heat * std::exp(-r2 / (heat_radius * heat_radius)));
  }
  velocity /= 4 * std::numbers::pi;
  vorticity /= 4 * std::numbers::pi;
  return {velocity, glm::length(vorticity), -0.5 * glm::dot(velocity, velocity), heat};
}

}  // namespace splatvol
