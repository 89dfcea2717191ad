#include "sampler/integral_region.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "format/splat_reader.h"

namespace splatvol {
namespace {

Status check_request(const IntegralRequest& request, const std::string& name) {
  if (request.box && !glm::all(glm::lessThanEqual(request.box->low, request.box->high)))
    return fail(ErrorCode::invalid_argument, "{}: the box is none: give the lower corner first", name);
  for (const ValueRange& range : request.ranges)
    if (!(range.low <= range.high))
      return fail(ErrorCode::invalid_argument, "{}: the range of \"{}\" is none: give the lower value first", name,
                  range.attribute);
  return {};
}

}  // namespace

void ValueSums::add(const ValueSums& other) {
  size.add(other.size);
  missing.add(other.missing);
  integral.add(other.integral);
  if (other.low.value < low.value) low = other.low;
  if (other.high.value > high.value) high = other.high;
}

ValueIntegral ValueSums::result(std::string name, const std::string& unit) const {
  ValueIntegral result{.name = std::move(name), .unit = unit, .integral = integral.value()};
  if (!(size.value() > 0)) return result;
  result.mean = result.integral / size.value();
  result.low = low.value;
  result.high = high.value;
  result.low_position = low.position;
  result.high_position = high.position;
  return result;
}

double distance_of(const HalfSpace& half_space, const dvec3& position) {
  const dvec3 products = half_space.normal * (position - half_space.point), sizes = glm::abs(products);
  const double distance = products.x + products.y + products.z;
  return std::abs(distance) > 4 * std::numeric_limits<double>::epsilon() * (sizes.x + sizes.y + sizes.z) ? distance : 0;
}

bool IntegralRegion::meets(const Box& other, double rounding) const {
  const Box wide{other.low - rounding, other.high + rounding};
  if (!glm::all(glm::lessThanEqual(wide.low, box.high)) || !glm::all(glm::lessThanEqual(box.low, wide.high)))
    return false;
  return std::ranges::all_of(half_spaces, [&](const HalfSpace& half_space) {
    const dvec3 farthest = glm::mix(wide.low, wide.high, glm::greaterThan(half_space.normal, dvec3(0)));
    return distance_of(half_space, farthest) >= 0;
  });
}

Result<HalfSpace> scaled_plane(const HalfSpace& plane, const std::string& name) {
  for (int axis = 0; axis < 3; ++axis)
    if (!std::isfinite(plane.point[axis]) || !std::isfinite(plane.normal[axis]) || plane.normal == dvec3(0))
      return fail(ErrorCode::invalid_argument, "{}: a plane has a finite point and a finite normal that is not 0, 0, 0",
                  name);
  const dvec3 sizes = glm::abs(plane.normal);
  return HalfSpace{plane.point, plane.normal / std::max({sizes.x, sizes.y, sizes.z})};
}

Result<IntegralRegion> region_of(const format::VolumeInfo& info, const IntegralRequest& request,
                                 const std::string& name, std::vector<std::size_t>& attributes) {
  SPLATVOL_TRY(check_request(request, name));
  IntegralRegion region{request.box.value_or(format::SplatSelection().box), {}, {}};
  for (const HalfSpace& plane : request.clip_planes) {
    SPLATVOL_TRY_ASSIGN(scaled, scaled_plane(plane, name));
    region.half_spaces.push_back(scaled);
  }
  for (const ValueRange& range : request.ranges) {
    SPLATVOL_TRY_ASSIGN(number, format::find_attribute(info, range.attribute, name));
    const auto attribute = static_cast<std::size_t>(number);
    const auto found = std::ranges::find(attributes, attribute);
    region.ranges.push_back({static_cast<std::size_t>(found - attributes.begin()), range.low, range.high});
    if (found == attributes.end()) attributes.push_back(attribute);
  }
  return region;
}

VisibleChunks::VisibleChunks(const format::VolumeInfo& info, const std::vector<ValueLimits>& ranges,
                             const std::vector<std::size_t>& attributes)
    : info_(info) {
  for (const ValueLimits& range : ranges)
    if (info.attributes[attributes[range.attribute]].missing == 0)
      ranges_.push_back({attributes[range.attribute], range.low, range.high});
}

void VisibleChunks::require(std::size_t attribute, double value) {
  ranges_.insert(ranges_.begin(), {attribute, value, value});
}

format::SummaryAttributes VisibleChunks::summaries() const {
  format::SummaryAttributes summaries;
  if (!ranges_.empty()) summaries.values = static_cast<int>(ranges_[0].attribute);
  if (ranges_.size() > 1) summaries.opacity = static_cast<int>(ranges_[1].attribute);
  return summaries;
}

bool VisibleChunks::operator()(const format::CellPage& page, std::size_t chunk) const {
  return (ranges_.empty() || meets(ranges_[0], page.summaries[chunk])) &&
         (ranges_.size() < 2 || meets(ranges_[1], page.opacity_summaries[chunk]));
}

bool VisibleChunks::meets(const ValueLimits& range, const format::ValueSummary& summary) const {
  const format::Attribute& attribute = info_.attributes[range.attribute];
  return attribute.value(double{summary.min}) <= range.high && attribute.value(double{summary.max}) >= range.low;
}

}  // namespace splatvol
