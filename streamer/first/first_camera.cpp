#include "streamer/first/first_camera.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <numbers>

namespace splatvol {
namespace {

constexpr double margin = 0.05;             // of the picture, at each side
constexpr double share_of_outliers = 2e-3;  // of the splats
constexpr double shrinks_by = 3;            // factor; if the rest is nearer by more, the outermost are outliers
constexpr int turn_steps = 24;              // directions of a turn that are checked

// From the data to the eye, for each axis that may be up: from the front, the right and above.
constexpr std::array<std::array<double, 3>, 3> from_data_to_eye = {
    {{0.4, -0.5, 0.8}, {0.5, 0.4, 0.8}, {0.5, -0.8, 0.4}}};

// A long or flat box is seen from the side where it is large.
dvec3 direction_to(const Box& box, int up) {
  const dvec3 extent = box.extent();
  const dvec3 areas(extent.y * extent.z, extent.x * extent.z, extent.x * extent.y);
  const double largest = std::max({areas.x, areas.y, areas.z});
  const auto& base = from_data_to_eye[static_cast<std::size_t>(up)];
  dvec3 direction;
  for (int axis = 0; axis < 3; ++axis) {
    const double share = largest > 0 ? areas[axis] / largest : 1;
    direction[axis] = base[static_cast<std::size_t>(axis)] * std::sqrt(std::max(share, 1.0 / 256));
  }
  return glm::normalize(direction);
}

// Returns how far a splat is drawn: a ball whose density is (1 - r^2)^(3/2) has a deviation of 1 / sqrt(8) radii.
double drawn_reach(const SurveySplat& splat, const dvec3& normal) { return std::sqrt(8.0 / 3) * splat.reach(normal); }

// Returns how far the splats reach along `normal`, which need not be a unit vector, from `origin`; without outliers.
double reach(const std::vector<SurveySplat>& splats, const dvec3& origin, const dvec3& normal) {
  thread_local std::vector<double> reaches;  // fresh pages cost more than the numbers
  reaches.clear();
  for (const SurveySplat& splat : splats)
    reaches.push_back(glm::dot(splat.center - origin, normal) + drawn_reach(splat, normal));
  const auto outliers = static_cast<std::ptrdiff_t>(share_of_outliers * static_cast<double>(reaches.size()));
  const double farthest = std::ranges::max(reaches);
  std::ranges::nth_element(reaches, reaches.end() - 1 - outliers);
  const double usual = *(reaches.end() - 1 - outliers);
  return farthest > shrinks_by * std::abs(usual) ? usual : farthest;
}

// How far the eye must be from the origin for a direction, and where the middle of the picture is.
struct Fit {
  double distance = 0;
  dvec3 aside{0};
};

Fit fit(const std::vector<SurveySplat>& splats, const dvec3& origin, const dvec3& to_eye, const dvec3& camera_up,
        const dvec2& slopes, bool centered) {
  const dvec3 right = glm::normalize(glm::cross(camera_up, to_eye));
  const std::array<dvec3, 2> axes = {right, glm::cross(to_eye, right)};
  Fit result;
  for (int k = 0; k < 2; ++k) {
    // A point is in the picture if it is on the inner side of the planes through the eye and the picture's edges.
    const dvec3& axis = axes[static_cast<std::size_t>(k)];
    const double ahead = reach(splats, origin, axis + slopes[k] * to_eye);
    const double behind = reach(splats, origin, -axis + slopes[k] * to_eye);
    const double half = centered ? std::max(ahead, behind) : 0.5 * (ahead + behind);
    result.distance = std::max(result.distance, half / slopes[k]);
    if (!centered) result.aside += 0.5 * (ahead - behind) * axis;
  }
  return result;
}

// Returns the variance of the values of those splats whose distance is at most `radius`.
double variance_within(const std::vector<SurveySplat>& splats, const std::vector<double>& distances, double radius) {
  double count = 0, mean = 0, squares = 0;
  for (std::size_t i = 0; i < splats.size(); ++i) {
    if (distances[i] > radius || !splats[i].has_value) continue;
    const double away = splats[i].value - mean;
    mean += away / ++count;
    squares += away * (splats[i].value - mean);
  }
  return count > 0 ? squares / count : 0;
}

}  // namespace

Box box_of(const std::vector<SurveySplat>& splats) {
  const dvec3 middle = [&] {
    dvec3 sum(0);
    for (const SurveySplat& splat : splats) sum += splat.center / static_cast<double>(splats.size());
    return sum;
  }();
  Box box;
  for (int axis = 0; axis < 3; ++axis) {
    dvec3 normal(0);
    normal[axis] = 1;
    box.high[axis] = middle[axis] + reach(splats, middle, normal);
    box.low[axis] = middle[axis] - reach(splats, middle, -normal);
  }
  return box;
}

Ball main_clump(const std::vector<SurveySplat>& splats) {
  constexpr std::size_t tried = 128;
  constexpr double share = 0.4, smaller = 100, kept = 4, empty_up_to = 10, most_between = 0.01;
  const auto rank = static_cast<std::size_t>(share * static_cast<double>(splats.size()));
  std::vector<double> distances(splats.size());
  const auto measure = [&](const dvec3& from) {
    std::ranges::transform(splats, distances.begin(),
                           [&](const SurveySplat& splat) { return glm::length(splat.center - from); });
  };
  // The smallest ball round a splat that holds the share. Among balls of about one size, the one with most different
  // values.
  Ball ball;
  double variance = -1;
  for (std::size_t i = 0; i < splats.size(); i += std::max<std::size_t>(splats.size() / tried, 1)) {
    measure(splats[i].center);
    std::vector<double> sorted = distances;
    std::ranges::nth_element(sorted, sorted.begin() + static_cast<std::ptrdiff_t>(rank));
    const double radius = sorted[rank];
    if (radius > 2 * ball.radius) continue;
    const double found = variance_within(splats, distances, radius);
    if (radius < 0.5 * ball.radius || found > variance) ball = {splats[i].center, radius}, variance = found;
  }
  measure(ball.center);
  const auto between = std::ranges::count_if(distances, [&](double distance) {
    return distance > kept * ball.radius && distance < empty_up_to * kept * ball.radius;
  });
  const bool is_alone = ball.radius > 0 && ball.radius * smaller < std::ranges::max(distances) &&
                        static_cast<double>(between) < most_between * static_cast<double>(splats.size());
  return is_alone ? Ball{ball.center, kept * ball.radius} : Ball{};
}

std::vector<SurveySplat> within(const Ball& ball, const std::vector<SurveySplat>& splats) {
  if (ball.radius == std::numeric_limits<double>::infinity()) return splats;
  std::vector<SurveySplat> inside;
  std::ranges::copy_if(splats, std::back_inserter(inside), [&](const SurveySplat& splat) {
    return glm::length(splat.center - ball.center) <= ball.radius && splat.longest() <= ball.radius;
  });
  return std::ranges::any_of(inside, &SurveySplat::has_value) ? inside : splats;
}

std::vector<SurveySplat> near_box(const Box& box, const std::vector<SurveySplat>& others) {
  constexpr double widening = 0.35, largest = 0.25;
  const dvec3 extent = box.extent();
  const double longest = std::max({extent.x, extent.y, extent.z});
  const dvec3 low = box.low - widening * longest, high = box.high + widening * longest;
  std::vector<SurveySplat> near;
  std::ranges::copy_if(others, std::back_inserter(near), [&](const SurveySplat& other) {
    return glm::all(glm::greaterThan(other.center, low)) && glm::all(glm::lessThan(other.center, high)) &&
           other.longest() <= largest * longest;
  });
  return near;
}

dvec3 middle_of(const std::vector<SurveySplat>& splats) {
  const Box box = box_of(splats);
  return 0.5 * (box.low + box.high);
}

Camera fit_camera(const std::vector<SurveySplat>& splats, int up, double aspect, double edge, bool turns) {
  Camera camera{.up = dvec3(0)};
  camera.up[up] = 1;
  const Box box = box_of(splats);
  const dvec3 origin = 0.5 * (box.low + box.high);
  const dvec3 to_eye = direction_to(box, up);
  const double slope = (1 - 2 * margin) * std::tan(camera.vertical_fov_degrees * std::numbers::pi / 360);
  const dvec2 slopes(slope * aspect, slope);
  Fit best = fit(splats, origin, to_eye, camera.up, slopes, turns);
  for (int step = 1; turns && step < turn_steps; ++step) {
    const glm::dquat turn = glm::angleAxis(2 * std::numbers::pi * step / turn_steps, camera.up);
    best.distance = std::max(best.distance, fit(splats, origin, turn * to_eye, camera.up, slopes, turns).distance);
  }
  if (!(best.distance > 0)) best.distance = 0.5 * edge / slope;
  camera.focal_point = origin + best.aside;
  camera.position = camera.focal_point + best.distance * to_eye;
  return camera;
}

}  // namespace splatvol
