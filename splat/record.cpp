#include "splat/record.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <numbers>

#include "splat/kernel.h"

namespace splatvol {
namespace {

constexpr double most_steps = 2.0 * largest_offset;  // along an edge of a block
constexpr double steps_per_limit = 32;
constexpr int offset_bits = 21;
constexpr std::int32_t offset_bias = 1 << 20;
constexpr std::uint32_t offset_mask = (1U << offset_bits) - 1;

constexpr int component_bits = 20;
constexpr double middle_component = (1 << (component_bits - 1)) - 1;
constexpr double largest_component = 0.5 * std::numbers::sqrt2;  // that one of the other three can be

constexpr double boundary_scale = 128;
constexpr double largest_boundary = 511;
constexpr double correlation_scale = 127;

std::uint64_t next_id() {
  static std::atomic<std::uint64_t> last{0};
  return ++last;
}

std::uint32_t pack_boundary(const dvec3& foot) {
  std::uint32_t packed = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const double code = std::clamp(boundary_scale * foot[axis], -largest_boundary, largest_boundary);
    packed |= (static_cast<std::uint32_t>(std::lround(code)) & 0x3FFU) << 10 * axis;
  }
  return packed;
}

dvec3 unpack_boundary(std::uint32_t packed) {
  dvec3 foot;
  for (int axis = 0; axis < 3; ++axis)
    foot[axis] = (static_cast<std::int32_t>(packed << (22 - 10 * axis)) >> 22) / boundary_scale;
  return foot;
}

// The box of a block's points.
struct Extent {
  dvec3 low{std::numeric_limits<double>::infinity()}, high{-std::numeric_limits<double>::infinity()};

  void include(const dvec3& position) {
    low = glm::min(low, position);
    high = glm::max(high, position);
  }
  [[nodiscard]] double edge() const { return std::max({high.x - low.x, high.y - low.y, high.z - low.z}); }
};

// The least of two limits, of which 0 is none.
float tighter(float a, float b) { return !(a > 0) ? b : !(b > 0) ? a : std::min(a, b); }

// Sets the positions of points [begin, end), and adds their block.
void add_block(std::span<const dvec3> positions, std::size_t begin, std::size_t end, const Extent& extent,
               double length, BlockedPositions& result) {
  const dvec3 origin = 0.5 * extent.low + 0.5 * extent.high;
  const double step = extent.edge() / length / most_steps;
  for (std::size_t i = begin; i < end; ++i) {
    const dvec3 steps = step > 0 ? (positions[i] - origin) / length / step : dvec3(0);
    result.positions[i] =
        PackedPosition::pack(glm::ivec3(glm::round(glm::clamp(steps, -0.5 * most_steps, 0.5 * most_steps))));
  }
  result.blocks.push_back({origin, step, static_cast<std::uint32_t>(end)});
}

template <class Materials, class Member>
double largest_of(const Materials& materials, const Member& member) {
  double largest = 0;
  for (const auto& material : materials) largest = std::max(largest, member(material));
  return largest;
}

float smallest_deviation(const dvec3& deviations) {
  return tighter(tighter(static_cast<float>(deviations.x), static_cast<float>(deviations.y)),
                 static_cast<float>(deviations.z));
}

}  // namespace

PackedPosition PackedPosition::pack(const glm::ivec3& offset) {
  const auto field = [&](int axis) { return static_cast<std::uint64_t>(offset[axis] + offset_bias) & offset_mask; };
  const std::uint64_t bits = field(0) | field(1) << offset_bits | field(2) << 2 * offset_bits;
  return {static_cast<std::uint32_t>(bits), static_cast<std::uint32_t>(bits >> 32)};
}

glm::ivec3 PackedPosition::offset() const {
  const std::uint64_t bits = std::uint64_t{high} << 32 | low;
  const auto field = [&](int axis) {
    return static_cast<std::int32_t>(bits >> offset_bits * axis & offset_mask) - offset_bias;
  };
  return {field(0), field(1), field(2)};
}

std::array<std::uint32_t, 2> PackedOrientation::pack(const glm::dquat& orientation) {
  const std::array components{orientation.x, orientation.y, orientation.z, orientation.w};
  std::size_t largest = 0;
  for (std::size_t k = 1; k < 4; ++k)
    if (std::abs(components[k]) > std::abs(components[largest])) largest = k;
  const double sign = components[largest] < 0 ? -1 : 1;
  std::uint64_t bits = largest;
  int shift = 2;
  for (std::size_t k = 0; k < 4; ++k) {
    if (k == largest) continue;
    const double share = std::clamp(sign * components[k] / largest_component, -1.0, 1.0);
    bits |= static_cast<std::uint64_t>(std::llround((share + 1) * middle_component)) << shift;
    shift += component_bits;
  }
  return {static_cast<std::uint32_t>(bits), static_cast<std::uint32_t>(bits >> 32)};
}

glm::dquat PackedOrientation::unpack(const std::array<std::uint32_t, 2>& packed) {
  const std::uint64_t bits = std::uint64_t{packed[1]} << 32 | packed[0];
  const std::size_t largest = bits & 3;
  std::array<double, 4> components{};
  double squares = 0;
  int shift = 2;
  for (std::size_t k = 0; k < 4; ++k) {
    if (k == largest) continue;
    const auto code = static_cast<double>(bits >> shift & ((1U << component_bits) - 1));
    components[k] = (code / middle_component - 1) * largest_component;
    squares += components[k] * components[k];
    shift += component_bits;
  }
  components[largest] = std::sqrt(std::max(0.0, 1 - squares));
  return glm::normalize(glm::dquat(components[3], components[0], components[1], components[2]));
}

ShapeRow::ShapeRow(Records records, std::vector<RecordBlock> blocks, double mass_scale, double deviation_scale)
    : id_(next_id()),
      records_(std::move(records)),
      blocks_(std::move(blocks)),
      mass_scale_(mass_scale),
      deviation_scale_(deviation_scale) {}

std::size_t ShapeRow::size() const {
  return std::visit([](const auto& records) { return records.size(); }, records_);
}

std::uint64_t ShapeRow::memory_bytes() const {
  return std::visit([](const auto& records) { return std::uint64_t{sizeof(records[0])} * records.size(); }, records_) +
         blocks_.size() * sizeof(RecordBlock);
}

ValueRow::ValueRow(Records records, double deviation_scale, OpacityValues opacity)
    : id_(next_id()), records_(std::move(records)), deviation_scale_(deviation_scale), opacity_(std::move(opacity)) {}

std::size_t ValueRow::size() const {
  return std::visit([](const auto& records) { return records.size(); }, records_);
}

std::uint64_t ValueRow::memory_bytes() const {
  return std::visit([](const auto& records) { return std::uint64_t{sizeof(records[0])} * records.size(); }, records_) +
         sizeof(OpacityValue) * opacity_.records.size();
}

double reach_of(const MomentsShape& shape, double deviation_scale) {
  const double longest = log_number(shape.deviations[0], deviation_scale);
  if (shape.boundary == 0) return moments_half_width * longest;
  const double far = glm::length(unpack_boundary(shape.boundary));
  return longest * (moments_half_width * std::sqrt(1 + far * far) + far);
}

std::uint32_t block_of(const ShapeRow& row, std::uint32_t record) {
  const auto found = std::ranges::upper_bound(row.blocks(), record, {}, &RecordBlock::end);
  return static_cast<std::uint32_t>(found - row.blocks().begin());
}

void append(DrawList& list, const RecordRow& row, std::uint32_t begin, std::uint32_t count) {
  const std::uint32_t end = begin + count;
  for (std::uint32_t block = count > 0 ? block_of(*row.shapes, begin) : 0; begin < end; ++block) {
    const std::uint32_t part_end = std::min(end, row.shapes->blocks()[block].end);
    list.ranges.push_back({row, block, begin, part_end - begin});
    begin = part_end;
  }
  list.splats += count;
}

BlockedPositions make_blocks(std::span<const dvec3> positions, std::span<const float> limits, double length) {
  BlockedPositions result;
  result.positions.resize(positions.size());
  const double most_limits = length * most_steps / steps_per_limit;
  Extent extent;
  float limit = 0;
  std::size_t begin = 0;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    Extent with = extent;
    with.include(positions[i]);
    const float with_limit = tighter(limit, limits[i]);
    if (i > begin && with_limit > 0 && !(with.edge() <= most_limits * static_cast<double>(with_limit))) {
      add_block(positions, begin, i, extent, length, result);
      begin = i;
      extent = {};
      extent.include(positions[i]);
      limit = limits[i];
    } else {
      extent = with;
      limit = with_limit;
    }
  }
  if (begin < positions.size()) add_block(positions, begin, positions.size(), extent, length, result);
  return result;
}

RecordRow pack_row(std::span<const MomentsSplat> materials, const dvec3& origin, double length, OpacityValues opacity) {
  const auto mass_scale = largest_of(materials, [](const MomentsSplat& m) { return m.mass; });
  const auto deviation_scale = largest_of(materials, [](const MomentsSplat& m) { return m.deviations.x; });
  const auto value_scale = largest_of(materials, [](const MomentsSplat& m) { return m.value_deviation; });

  std::vector<dvec3> positions;
  std::vector<float> limits;
  for (const MomentsSplat& m : materials) {
    positions.push_back(origin + length * m.center);
    limits.push_back(smallest_deviation(m.deviations));
  }
  BlockedPositions blocked = make_blocks(positions, limits, length);

  std::vector<MomentsShape> shapes;
  std::vector<MomentsValue> values;
  for (std::size_t i = 0; i < materials.size(); ++i) {
    const MomentsSplat& m = materials[i];
    MomentsShape shape{blocked.positions[i],
                       PackedOrientation::pack(m.orientation),
                       log_code(m.mass, mass_scale),
                       {},
                       pack_boundary(m.boundary)};
    MomentsValue value{static_cast<float>(m.value), log_code(m.value_deviation, value_scale), 255, {}};
    for (int k = 0; k < 3; ++k) {
      shape.deviations[k] = log_code(m.deviations[k], deviation_scale);
      value.correlations[k] =
          static_cast<std::int8_t>(std::lround(correlation_scale * std::clamp(m.correlations[k], -1.0, 1.0)));
    }
    shapes.push_back(shape);
    values.push_back(value);
  }
  return {std::make_shared<ShapeRow>(std::move(shapes), std::move(blocked.blocks), mass_scale, deviation_scale),
          std::make_shared<ValueRow>(std::move(values), value_scale, std::move(opacity))};
}

RecordRow pack_row(std::span<const OctantSplat> splats, const dvec3& origin, double length, OpacityValues opacity) {
  std::vector<dvec3> positions;
  std::vector<float> limits;
  for (const OctantSplat& splat : splats) {
    positions.push_back(origin + length * dvec3(splat.position));
    limits.push_back(splat.size);
  }
  BlockedPositions blocked = make_blocks(positions, limits, length);
  std::vector<OctantShape> shapes;
  std::vector<OctantValue> values;
  for (std::size_t i = 0; i < splats.size(); ++i) {
    shapes.push_back({blocked.positions[i], splats[i].size});
    values.push_back({splats[i].value, splats[i].gradient});
  }
  return {std::make_shared<ShapeRow>(std::move(shapes), std::move(blocked.blocks)),
          std::make_shared<ValueRow>(std::move(values), 0, std::move(opacity))};
}

MomentsSplat unpack(const RecordRow& row, std::uint32_t record) {
  const MomentsShape& shape = std::get<std::vector<MomentsShape>>(row.shapes->records())[record];
  const MomentsValue& value = std::get<std::vector<MomentsValue>>(row.values->records())[record];
  MomentsSplat m;
  m.center = row.shapes->blocks()[block_of(*row.shapes, record)].step * dvec3(shape.position.offset());
  m.mass = log_number(shape.mass, row.shapes->mass_scale()) * value.coverage / 255;
  m.orientation = PackedOrientation::unpack(shape.orientation);
  m.boundary = unpack_boundary(shape.boundary);
  m.value = static_cast<double>(value.mean);
  m.value_deviation = log_number(value.deviation, row.values->deviation_scale());
  for (int k = 0; k < 3; ++k) {
    m.deviations[k] = log_number(shape.deviations[k], row.shapes->deviation_scale());
    m.correlations[k] = value.correlations[k] / correlation_scale;
  }
  return m;
}

OctantSplat unpack_octant(const RecordRow& row, std::uint32_t record) {
  const OctantShape& shape = std::get<std::vector<OctantShape>>(row.shapes->records())[record];
  const OctantValue& value = std::get<std::vector<OctantValue>>(row.values->records())[record];
  const double step = row.shapes->blocks()[block_of(*row.shapes, record)].step;
  return {vec3(step * dvec3(shape.position.offset())), value.value, shape.size, value.gradient};
}

}  // namespace splatvol
