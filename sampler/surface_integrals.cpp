#include "sampler/surface_integrals.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <variant>
#include <vector>

#include "format/splat_reader.h"
#include "sampler/cell_tetrahedra.h"
#include "sampler/contour.h"
#include "sampler/integral_region.h"

namespace splatvol {
namespace {

constexpr std::uint64_t most_held_bytes = std::uint64_t{128} << 20;  // of parts of the file

using Weights = std::array<double, 3>;  // of the corners of a triangle; they add up to 1

double at(const std::array<double, 3>& values, const Weights& weights) {
  return weights[0] * values[0] + weights[1] * values[1] + weights[2] * values[2];
}

Weights mixed(const Weights& a, const Weights& b, double share) {
  Weights weights{};
  for (std::size_t k = 0; k < 3; ++k) weights[k] = (1 - share) * a[k] + share * b[k];
  return weights;
}

// Cuts off a convex part of a triangle where a linear function, given at the corners, is negative. It may be infinite
// where it cuts off nothing.
void cut(std::vector<Weights>& part, const std::array<double, 3>& function) {
  if (std::ranges::none_of(function, [](double value) { return value < 0; })) return;
  std::vector<Weights> left;
  for (std::size_t i = 0; i < part.size(); ++i) {
    const Weights &here = part[i], &next = part[(i + 1) % part.size()];
    const double value = at(function, here), value_next = at(function, next);
    if (value >= 0) left.push_back(here);
    if ((value > 0 && value_next < 0) || (value < 0 && value_next > 0))
      left.push_back(mixed(here, next, value / (value - value_next)));
  }
  part = std::move(left);
}

// The share of a triangle that three points in it have.
double share_of(const Weights& a, const Weights& b, const Weights& c) {
  return std::abs((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]));
}

// What is added up of a surface.
struct Sums {
  CompensatedSum area = {}, unknown = {}, flux = {};
  std::vector<ValueSums> attributes;  // [attribute of the request]
  ContourMeasure measure{dvec3(0)};   // of the whole
};

// A request with the numbers of attributes.
struct Plan {
  std::vector<std::size_t> attributes;  // that are read
  std::size_t integrated = 0;           // of these: the first
  IntegralRegion region = {};
  std::optional<HalfSpace> slice = {};                    // else a contour
  std::size_t function = 0;                               // its attribute: index into Tetrahedra::values
  double value = 0;                                       // 0 of a slice
  std::optional<std::array<std::size_t, 3>> vector = {};  // indices into Tetrahedra::values
  dvec3 middle{0};                                        // of the file

  // Whether nothing cuts the surface.
  [[nodiscard]] bool is_whole() const {
    return region.half_spaces.empty() && region.ranges.empty() && region.box == format::SplatSelection().box;
  }
};

// Integrates over a chunk.
class ChunkOfSurface {
 public:
  ChunkOfSurface(const Plan& plan, const Tetrahedra& tetrahedra, Sums& sums)
      : plan_(plan), tetrahedra_(tetrahedra), sums_(sums) {}

  void run() {
    sums_.attributes.resize(plan_.integrated);
    sums_.measure = ContourMeasure(plan_.middle);
    if (!plan_.slice && tetrahedra_.constant) return;
    std::vector<double> distances;
    if (plan_.slice)
      for (const dvec3& point : tetrahedra_.points) distances.push_back(distance_of(*plan_.slice, point));
    surface_ = contour_of(tetrahedra_, plan_.slice ? distances : tetrahedra_.values[plan_.function], plan_.value);
    if (!plan_.slice) sums_.measure.add(surface_);
    for (std::size_t triangle = 0; triangle < surface_.triangles.size(); ++triangle) add(triangle);
  }

 private:
  void add(std::size_t triangle) {
    const std::array<dvec3, 3> corners = surface_.corners_of(triangle);
    // Twice the area along the normal: to where the function is lower.
    const dvec3 normal = glm::cross(corners[1] - corners[0], corners[2] - corners[0]);
    const double area = 0.5 * glm::length(normal);
    if (!(area > 0)) return;
    std::vector<Weights> part = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    cut_by_region(corners, part);
    double share = 0;
    for (std::size_t i = 2; i < part.size(); ++i) share += share_of(part[0], part[i - 1], part[i]);
    if (lacks_value_of_range(triangle)) return sums_.unknown.add(area * share);
    cut_by_ranges(triangle, part);
    for (std::size_t i = 2; i < part.size(); ++i)
      add_part(triangle, {part[0], part[i - 1], part[i]}, area, (plan_.slice ? -0.5 : 0.5) * normal);
    for (std::size_t a = 0; a < plan_.integrated && part.size() > 2; ++a) look_at_vertices(triangle, a, corners, part);
  }

  void cut_by_region(const std::array<dvec3, 3>& corners, std::vector<Weights>& part) const {
    const auto cut_by = [&](const auto& function) {
      cut(part, {function(corners[0]), function(corners[1]), function(corners[2])});
    };
    for (int axis = 0; axis < 3; ++axis) {
      cut_by([&](const dvec3& p) { return p[axis] - plan_.region.box.low[axis]; });
      cut_by([&](const dvec3& p) { return plan_.region.box.high[axis] - p[axis]; });
    }
    for (const HalfSpace& half_space : plan_.region.half_spaces)
      cut_by([&](const dvec3& p) { return distance_of(half_space, p); });
  }

  void cut_by_ranges(std::size_t triangle, std::vector<Weights>& part) const {
    for (const ValueLimits& range : plan_.region.ranges) {
      const std::array<double, 3> values = values_of(triangle, range.attribute);
      std::array<double, 3> above{}, below{};
      for (std::size_t k = 0; k < 3; ++k) above[k] = values[k] - range.low, below[k] = range.high - values[k];
      cut(part, above);
      cut(part, below);
    }
  }

  // At the corners of a triangle.
  [[nodiscard]] std::array<double, 3> values_of(std::size_t triangle, std::size_t attribute) const {
    if (tetrahedra_.constant) {
      const double value = tetrahedra_.values[attribute][surface_.tetrahedra[triangle]];
      return {value, value, value};
    }
    const auto& [a, b, c] = surface_.triangles[triangle];
    const std::vector<double>& values = surface_.values[attribute];
    return {values[a], values[b], values[c]};
  }

  // Whether its tetrahedron lacks a value.
  [[nodiscard]] bool lacks_value(std::size_t triangle, std::size_t attribute) const {
    const auto [a, b, c, d] = tetrahedra_.values_of(surface_.tetrahedra[triangle], attribute);
    return std::isnan(a + b + c + d);
  }
  [[nodiscard]] bool lacks_value_of_range(std::size_t triangle) const {
    return std::ranges::any_of(plan_.region.ranges,
                               [&](const ValueLimits& range) { return lacks_value(triangle, range.attribute); });
  }

  // Adds a triangle in the triangle. `along`: the area of the whole along its normal.
  void add_part(std::size_t triangle, const std::array<Weights, 3>& part, double area, const dvec3& along) {
    const double share = share_of(part[0], part[1], part[2]);
    Weights middle{};
    for (std::size_t k = 0; k < 3; ++k) middle[k] = (part[0][k] + part[1][k] + part[2][k]) / 3;
    sums_.area.add(area * share);
    for (std::size_t a = 0; a < plan_.integrated; ++a) {
      ValueSums& sums = sums_.attributes[a];
      if (lacks_value(triangle, a)) {
        sums.missing.add(area * share);
        continue;
      }
      sums.size.add(area * share);
      sums.integral.add(area * share * at(values_of(triangle, a), middle));
    }
    if (!plan_.vector) return;
    double flux = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const std::size_t component = (*plan_.vector)[static_cast<std::size_t>(axis)];
      if (lacks_value(triangle, component)) return;
      flux += along[axis] * at(values_of(triangle, component), middle);
    }
    sums_.flux.add(share * flux);
  }

  void look_at_vertices(std::size_t triangle, std::size_t attribute, const std::array<dvec3, 3>& corners,
                        const std::vector<Weights>& part) {
    if (lacks_value(triangle, attribute)) return;
    const std::array<double, 3> values = values_of(triangle, attribute);
    for (const Weights& weights : part) {
      double value = tetrahedra_.constant ? values[0] : at(values, weights);
      for (const ValueLimits& range : plan_.region.ranges)
        if (range.attribute == attribute) value = std::clamp(value, range.low, range.high);
      if (!plan_.slice && attribute == plan_.function) value = plan_.value;
      sums_.attributes[attribute].look_at(value,
                                          weights[0] * corners[0] + weights[1] * corners[1] + weights[2] * corners[2]);
    }
  }

  const Plan& plan_;
  const Tetrahedra& tetrahedra_;
  Sums& sums_;
  ContourPart surface_;
};

// The number of an attribute among those that are read, which it joins.
Result<std::size_t> read_number(const format::VolumeInfo& info, const std::string& attribute, const std::string& name,
                                std::vector<std::size_t>& attributes) {
  SPLATVOL_TRY_ASSIGN(number, format::find_attribute(info, attribute, name));
  const auto wanted = static_cast<std::size_t>(number);
  const auto found = std::ranges::find(attributes, wanted);
  const auto place = static_cast<std::size_t>(found - attributes.begin());
  if (found == attributes.end()) attributes.push_back(wanted);
  return place;
}

Result<Plan> make_plan(const format::Volume& volume, const SurfaceRequest& request,
                       const format::SplatSelection& selection) {
  const format::VolumeInfo& info = volume.info();
  Plan plan{.attributes = selection.attributes, .integrated = selection.attributes.size()};
  SPLATVOL_TRY_SET(plan.region, region_of(info, request.integrals, volume.name(), plan.attributes));
  if (const auto* const contour = std::get_if<ContourSurface>(&request.surface)) {
    SPLATVOL_TRY_SET(plan.function, read_number(info, contour->attribute, volume.name(), plan.attributes));
    plan.value = contour->value;
    if (!std::isfinite(plan.value))
      return fail(ErrorCode::invalid_argument, "{}: the value of a contour is a finite number", volume.name());
  } else {
    SPLATVOL_TRY_SET(plan.slice, scaled_plane(std::get<HalfSpace>(request.surface), volume.name()));
  }
  if (request.vector != std::array<std::string, 3>{}) {
    std::array<std::size_t, 3>& vector = plan.vector.emplace();
    for (std::size_t k = 0; k < 3; ++k)
      SPLATVOL_TRY_SET(vector[k], read_number(info, request.vector[k], volume.name(), plan.attributes));
  }
  plan.middle = info.cube.origin + 0.5 * info.cube.edge;
  return plan;
}

// Whether a plane may cut a box, if positions may be wrong by `rounding`.
bool meets(const HalfSpace& plane, const Box& box, double rounding) {
  const dvec3 half = 0.5 * box.extent() + rounding;
  return std::abs(glm::dot(plane.normal, 0.5 * (box.low + box.high) - plane.point)) <=
         (1 + 1e-9) * glm::dot(glm::abs(plane.normal), half);
}

SurfaceIntegrals result_of(const Sums& sums, const Plan& plan, const format::SplatSelection& selection,
                           const format::VolumeInfo& info) {
  SurfaceIntegrals result{.area = sums.area.value(), .unknown_area = sums.unknown.value()};
  for (std::size_t a = 0; a < sums.attributes.size(); ++a) {
    const ValueSums& of = sums.attributes[a];
    result.attributes.push_back({of.result(selection.names[a], info.attributes[selection.attributes[a]].unit),
                                 of.size.value(), of.missing.value()});
  }
  if (plan.vector) result.flux = sums.flux.value();
  if (!plan.slice && plan.is_whole() && sums.measure.is_closed()) result.enclosed_volume = sums.measure.volume();
  return result;
}

}  // namespace

Result<SurfaceIntegrals> integrate_surface(const format::Volume& volume, const SurfaceRequest& request,
                                           std::uint64_t memory, std::size_t threads,
                                           const std::function<void(double)>& progress) {
  const format::VolumeInfo& info = volume.info();
  SPLATVOL_TRY_ASSIGN(selection,
                      format::select_splats(volume, {}, request.integrals.attributes, format::SplatSelection().box));
  SPLATVOL_TRY_ASSIGN(plan, make_plan(volume, request, selection));
  VisibleChunks is_visible(info, plan.region.ranges, plan.attributes);
  if (!plan.slice) is_visible.require(plan.attributes[plan.function], plan.value);
  SPLATVOL_TRY_ASSIGN(cells, CellTetrahedra::open(volume, plan.attributes, own_room(std::min(memory, most_held_bytes)),
                                                  is_visible.summaries()));
  if (!cells) return fail_without_cells(volume);
  if (!plan.slice && cells->has_constant())
    return fail(ErrorCode::unsupported,
                "{}: its cells have values of their own, which jump between them: no surface has a value",
                volume.name());
  const auto meets_box = [&](const Box& box) {
    return plan.region.meets(box, cells->rounding()) && (!plan.slice || meets(*plan.slice, box, cells->rounding()));
  };
  SPLATVOL_TRY_ASSIGN(chunks, cells->chunks(meets_box, is_visible));

  Sums all{.attributes = std::vector<ValueSums>(plan.integrated), .measure = ContourMeasure(plan.middle)};
  SPLATVOL_TRY(cells->for_each<Sums>(
      chunks,
      [&](const format::CellChunkEntry&, const Tetrahedra& tetrahedra, Sums& sums) -> Status {
        ChunkOfSurface(plan, tetrahedra, sums).run();
        return {};
      },
      [&](const format::CellChunkEntry& entry, const Sums& sums) -> Status {
        all.area.add(sums.area);
        all.unknown.add(sums.unknown);
        all.flux.add(sums.flux);
        for (std::size_t a = 0; a < all.attributes.size(); ++a) all.attributes[a].add(sums.attributes[a]);
        all.measure.add(sums.measure);
        progress(static_cast<double>(&entry - chunks.data() + 1) / static_cast<double>(chunks.size()));
        return {};
      },
      threads));
  SurfaceIntegrals result = result_of(all, plan, selection, info);
  result.left_out = cells->unknown_cells();
  return result;
}

}  // namespace splatvol
