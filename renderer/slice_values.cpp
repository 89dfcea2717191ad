#include "renderer/slice_values.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <variant>

#include "base/parallel.h"
#include "splat/ellipsoid.h"
#include "splat/kernel.h"

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

constexpr int band_rows = 16;
constexpr std::uint64_t batch_records = std::uint64_t{1} << 18;  // whose splats are held at once

constexpr double least_of_octants = 0.05;  // DensitySums: their sizes fit the material less

// A plane as a picture's rays see it. The ray of a pixel is d = (a, b, 1); it meets the plane at K d / (w . d) in view
// coordinates.
struct PlaneOnRays {
  dmat3 k;
  dvec3 w;

  PlaneOnRays(const View& view, const Plane& plane) {
    const dvec3 n(glm::dot(plane.normal, view.right), glm::dot(plane.normal, view.up),
                  glm::dot(plane.normal, view.forward));
    const double distance = -plane.distance(view.eye);
    k = view.orthographic ? dmat3(n.z, 0, -n.x, 0, n.z, -n.y, 0, 0, distance) : dmat3(distance);
    w = view.orthographic ? dvec3(0, 0, n.z) : n;
  }
};

// A splat that meets the plane. In its coordinates u = G d / (w . d) the ellipsoid is the unit ball.
struct SplatOnPlane {
  dmat3 g;
  dvec3 gradient;   // of the value, along u
  dvec3 outwards;   // normal of the boundary plane, which goes through the centre; 0: no boundary
  double value;     // stored value at the centre
  double density;   // at the centre
  int first, last;  // rows of pixels, from the lowest

  [[nodiscard]] bool has_boundary() const { return outwards != dvec3(0); }
};

// Sums over the splats at a pixel's place on the plane: DensitySums, and the values of what is left.
struct Sums {
  std::vector<float> whole, bounded, left, value;
  explicit Sums(std::size_t pixels) : whole(pixels), bounded(pixels), left(pixels), value(pixels) {}
};

// The directions along a plane.
std::array<dvec3, 2> along(const dvec3& normal) {
  const dvec3 size = glm::abs(normal);
  const dvec3 other = size.x <= size.y && size.x <= size.z ? dvec3(1, 0, 0)
                      : size.y <= size.z                   ? dvec3(0, 1, 0)
                                                           : dvec3(0, 0, 1);
  const dvec3 first = glm::normalize(glm::cross(normal, other));
  return {first, glm::cross(normal, first)};
}

// Returns a number of pixels, within [0, count]. Damaged splats may give NaN.
int pixel_in(double number, int count) { return number > 0 ? static_cast<int>(std::min(number, 1.0 * count)) : 0; }

// Draws the splats of some ranges.
class SliceDrawing {
 public:
  SliceDrawing(const DrawingUnits& units, const View& view, const Plane& plane)
      : units_(units),
        view_(view),
        plane_(plane),
        rays_(view, plane),
        along_(along(plane.normal)),
        sums_(static_cast<std::size_t>(view.width) * view.height) {}

  void add(std::span<const DrawRange> ranges) {
    std::vector<std::vector<SplatOnPlane>> found(ranges.size());
    parallel_for(std::size_t{0}, ranges.size(), [&](std::size_t i) { find_splats(ranges[i], found[i]); });
    const int bands = (view_.height + band_rows - 1) / band_rows;
    parallel_for(0, bands, [&](int band) {
      const int first = band * band_rows, last = std::min(first + band_rows, view_.height) - 1;
      for (const auto& splats : found)
        for (const SplatOnPlane& splat : splats) draw_rows(splat, first, last);
    });
  }

  [[nodiscard]] std::vector<double> values(std::span<const double> depths, double least) const {
    std::vector<double> values(depths.size(), std::numeric_limits<double>::quiet_NaN());
    parallel_for(std::size_t{0}, depths.size(), [&](std::size_t i) {
      const DensitySums sums{sums_.whole[i], sums_.bounded[i], sums_.left[i]};
      if (depths[i] < infinity && sums.is_material(least))
        values[i] = units_.value(static_cast<double>(sums_.value[i]) / sums.left);
      if (!std::isfinite(values[i])) values[i] = std::numeric_limits<double>::quiet_NaN();
    });
    return values;
  }

 private:
  void find_splats(const DrawRange& range, std::vector<SplatOnPlane>& found) const;
  void add_splat(const MomentsSplat& splat, const dvec3& origin, std::vector<SplatOnPlane>& found) const;
  [[nodiscard]] bool find_rows(const dmat3& to_ball, const dvec3& center, SplatOnPlane& found) const;
  void draw_rows(const SplatOnPlane& splat, int first, int last);

  const DrawingUnits& units_;
  const View& view_;
  const Plane& plane_;
  const PlaneOnRays rays_;
  const std::array<dvec3, 2> along_;
  Sums sums_;
};

// A ball with the octant splat's reach.
MomentsSplat material_of(const OctantSplat& splat) {
  MomentsSplat material;
  const auto size = static_cast<double>(splat.size);
  material.center = dvec3(splat.position);
  material.mass = std::isnan(splat.value) ? 0 : size * size * size;
  material.deviations = dvec3(octant_reach * size / moments_half_width);
  material.value = splat.value;
  return material;
}

void SliceDrawing::find_splats(const DrawRange& range, std::vector<SplatOnPlane>& found) const {
  const ShapeRow& row = *range.row.shapes;
  const RecordBlock& block = row.blocks()[range.block];
  const auto visit = [&](const auto& shapes, const auto& reach, const auto& unpack_one) {
    for (std::uint32_t i = range.begin; i < range.begin + range.count; ++i) {
      const dvec3 center = block.origin + units_.length * block.step * dvec3(shapes[i].position.offset());
      if (std::abs(plane_.distance(center)) <= units_.length * reach(shapes[i]))
        add_splat(unpack_one(range.row, i), block.origin, found);
    }
  };
  if (const auto* octants = std::get_if<std::vector<OctantShape>>(&row.records()))
    visit(
        *octants, [](const OctantShape& shape) { return octant_reach * static_cast<double>(shape.size); },
        [](const RecordRow& of, std::uint32_t i) { return material_of(unpack_octant(of, i)); });
  else
    visit(
        std::get<std::vector<MomentsShape>>(row.records()),
        [&](const MomentsShape& shape) { return reach_of(shape, row.deviation_scale()); },
        [](const RecordRow& of, std::uint32_t i) { return unpack(of, i); });
}

// Adds a splat if it meets the plane.
void SliceDrawing::add_splat(const MomentsSplat& m, const dvec3& origin, std::vector<SplatOnPlane>& found) const {
  const SplatShape shape = with_thickness(m);
  const Ellipsoid ellipsoid = ellipsoid_of(m.center, shape);
  if (!(ellipsoid.peak > 0)) return;
  const dvec3 center = origin + units_.length * ellipsoid.center;
  const dmat3 to_ball = ellipsoid.to_ball / units_.length;
  SplatOnPlane splat;
  if (!find_rows(to_ball, center, splat)) return;
  const dmat3 from_view = to_ball * dmat3(view_.right, view_.up, view_.forward);
  splat.g = from_view * (rays_.k - glm::outerProduct(view_.to_view(center), rays_.w));
  const LinearField field = field_of(m.center, shape, value_of(m));
  splat.value = field.at(ellipsoid.center);
  splat.gradient = field.slope * from_ball(shape);
  splat.outwards = ellipsoid.outward;
  splat.density = ellipsoid.peak;
  found.push_back(splat);
}

// The plane cuts a splat in an ellipse. Finds the rows of pixels that may show it. Returns false if there are none.
bool SliceDrawing::find_rows(const dmat3& to_ball, const dvec3& center, SplatOnPlane& found) const {
  // |k0 + k1 s + k2 t| < 1, from the foot of the perpendicular on the plane.
  const double distance = plane_.distance(center);
  const dvec3 foot = center - distance * plane_.normal;
  const dvec3 k0 = to_ball * (-distance * plane_.normal), k1 = to_ball * along_[0], k2 = to_ball * along_[1];
  const double k11 = glm::dot(k1, k1), k12 = glm::dot(k1, k2);
  const dvec3 minors = glm::cross(k1, k2);
  const double determinant = glm::dot(minors, minors);
  const double nearest = glm::dot(minors, k0) / std::sqrt(determinant);  // to the ball's centre
  if (!(std::abs(nearest) < 1)) return false;

  // A parallelogram of conjugate diameters holds the ellipse.
  const double r1 = -glm::dot(k1, k0), r2 = -glm::dot(k2, k0), k22 = glm::dot(k2, k2);
  const double radius = std::sqrt(1 - nearest * nearest);
  const dvec3 middle =
      foot + (k22 * r1 - k12 * r2) / determinant * along_[0] + (k11 * r2 - k12 * r1) / determinant * along_[1];
  const dvec3 first = radius / std::sqrt(k11) * along_[0];
  const dvec3 second = radius / std::sqrt(determinant * k11) * (k11 * along_[1] - k12 * along_[0]);
  double low = infinity, high = -infinity;
  for (int corner = 0; corner < 4; ++corner) {
    const dvec3 p =
        view_.to_view(middle + ((corner & 1) != 0 ? first : -first) + ((corner & 2) != 0 ? second : -second));
    if (!view_.orthographic && !(p.z > 0)) {
      low = -infinity, high = infinity;
      break;
    }
    const double y = view_.orthographic ? p.y : p.y / p.z;
    low = std::min(low, y), high = std::max(high, y);
  }
  constexpr double margin = 1e-6;  // pixels
  found.first = pixel_in(std::ceil(view_.focal * low + 0.5 * view_.height - 0.5 - margin), view_.height);
  found.last = pixel_in(std::floor(view_.focal * high + 0.5 * view_.height + 0.5 + margin), view_.height) - 1;
  return found.first <= found.last;
}

void SliceDrawing::draw_rows(const SplatOnPlane& splat, int first, int last) {
  const dvec3 &q = splat.g[0], &w = rays_.w;
  const bool bounded = splat.has_boundary();
  const double step = 1 / view_.focal, left = (0.5 - 0.5 * view_.width) / view_.focal;
  for (int y = std::max(first, splat.first); y <= std::min(last, splat.last); ++y) {
    const double b = (y + 0.5 - 0.5 * view_.height) / view_.focal;
    const dvec3 p = splat.g[1] * b + splat.g[2];
    const double s = w.y * b + w.z, t = w.x;

    // |p + q a| < |s + t a|: between two roots, unless the ellipse reaches the eye's plane.
    const double square = glm::dot(q, q) - t * t, half = glm::dot(p, q) - s * t, rest = glm::dot(p, p) - s * s;
    int begin = 0, end = view_.width;
    if (square > 0) {
      const double discriminant = half * half - square * rest;
      if (!(discriminant > 0)) continue;
      const double root = std::sqrt(discriminant);
      begin = pixel_in(std::ceil(((-half - root) / square - left) / step), view_.width);
      end = pixel_in(std::floor(((-half + root) / square - left) / step) + 1, view_.width);
    }
    const std::size_t row = static_cast<std::size_t>(view_.height - 1 - y) * view_.width;
    for (int x = begin; x < end; ++x) {
      const double a = left + step * x;
      const dvec3 u = (p + q * a) / (s + t * a);
      const double inside = std::max(1 - glm::dot(u, u), 0.0);
      const double weight = splat.density * inside * std::sqrt(inside);
      const bool counts = !(glm::dot(splat.outwards, u) > 0);
      sums_.whole[row + x] += static_cast<float>(weight);
      if (bounded) sums_.bounded[row + x] += static_cast<float>(weight);
      if (!counts) continue;
      sums_.left[row + x] += static_cast<float>(weight);
      sums_.value[row + x] += static_cast<float>(weight * (splat.value + glm::dot(splat.gradient, u)));
    }
  }
}

}  // namespace

std::vector<double> slice_values(const DrawList& list, const DrawingUnits& units, const View& view, const Plane& plane,
                                 std::span<const double> depths) {
  SliceDrawing drawing(units, view, plane);
  for (std::size_t begin = 0, end = 0; begin < list.ranges.size(); begin = end) {
    std::uint64_t records = 0;
    for (; end < list.ranges.size() && records < batch_records; ++end) records += list.ranges[end].count;
    drawing.add(std::span(list.ranges).subspan(begin, end - begin));
  }
  const bool octants =
      !list.ranges.empty() && std::holds_alternative<std::vector<OctantShape>>(list.ranges[0].row.shapes->records());
  return drawing.values(depths, octants ? least_of_octants : DensitySums::least_whole);
}

}  // namespace splatvol
