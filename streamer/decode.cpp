#include "streamer/decode.h"

#include <algorithm>
#include <cmath>

#include "format/columns.h"
#include "streamer/splat.h"

namespace splatvol {

using format::ColumnKind;

namespace {

// Rounds to the nearest like lround, which is slower.
std::int8_t signed_byte(double number) { return static_cast<std::int8_t>(127 * number + std::copysign(0.5, number)); }

std::uint32_t pack_direction(const vec3& direction) {
  std::uint32_t packed = 0;
  for (int axis = 0; axis < 3; ++axis)
    packed |= static_cast<std::uint32_t>(static_cast<std::uint8_t>(signed_byte(static_cast<double>(direction[axis]))))
              << 8 * axis;
  return packed;
}

std::uint32_t pack_boundary(const dvec3& foot) {
  std::uint32_t packed = 0;
  for (int axis = 0; axis < 3; ++axis)
    packed |= (static_cast<std::uint32_t>(std::lround(128 * foot[axis])) & 0x3FFU) << 10 * axis;
  return packed;
}

// Unpacks all points with `unpack`, then makes an element from each.
template <class Unpacked, class Unpack, class Make>
Result<DecodedChunk> decode_each(std::uint32_t points, Unpack unpack, Make make) {
  std::vector<Unpacked> unpacked(points);
  SPLATVOL_TRY(unpack(std::span(unpacked)));
  std::vector<decltype(make(unpacked[0]))> elements(points);
  std::ranges::transform(unpacked, elements.begin(), make);
  return DecodedChunk(std::move(elements));
}

}  // namespace

std::uint64_t decoded_bytes(ColumnKind kind, std::uint64_t points) {
  switch (kind) {
    case ColumnKind::position:
    case ColumnKind::centroid:
      return points * sizeof(dvec3);
    case ColumnKind::moments:
      return points * sizeof(MaterialShape);
    case ColumnKind::value_moments:
      return points * sizeof(MaterialValue);
    default:
      return points * sizeof(float);
  }
}

std::uint64_t decoding_bytes(ColumnKind kind, std::uint64_t points, std::uint64_t unpacked_bytes) {
  // Unpacking needs at most an integer of 8 bytes for each point besides.
  const std::uint64_t unpacked = kind == ColumnKind::moments         ? sizeof(format::SplatShape)
                                 : kind == ColumnKind::value_moments ? sizeof(format::SplatValue)
                                 : kind == ColumnKind::gradient      ? sizeof(vec3)
                                                                     : 0;
  return unpacked_bytes + points * (sizeof(std::uint64_t) + unpacked);
}

std::uint64_t largest_payload(ColumnKind kind, std::uint64_t points) {
  switch (kind) {
    case ColumnKind::position:
    case ColumnKind::centroid:
      return sizeof(format::PositionHeader) + points * sizeof(dvec3);
    case ColumnKind::moments:
      return sizeof(format::MomentsHeader) + points * 23;  // mass 2, deviations 6, orientation 8, boundary 6, density 1
    case ColumnKind::value_moments:
      return sizeof(format::ValueMomentsHeader) + points * 10;  // mean 4, deviation 2, a byte each
    case ColumnKind::value:
      return sizeof(format::ValueHeader) + points * sizeof(float);
    default:
      return points * sizeof(float);
  }
}

Result<DecodedChunk> decode_chunk(ColumnKind kind, const format::ChunkEntry& entry, std::span<const std::byte> packed,
                                  std::uint32_t points, const Cube& cube, std::string_view what) {
  const double length = drawing_length(cube.edge);
  switch (kind) {
    case ColumnKind::position:
    case ColumnKind::centroid: {
      std::vector<dvec3> positions(points);
      const auto unpack = kind == ColumnKind::position ? format::unpack_positions : format::unpack_centroids;
      SPLATVOL_TRY(unpack(entry, packed, positions, cube, what));
      return DecodedChunk(std::move(positions));
    }
    case ColumnKind::value: {
      std::vector<float> values(points);
      SPLATVOL_TRY(format::unpack_values(entry, packed, values, what));
      return DecodedChunk(std::move(values));
    }
    case ColumnKind::octant: {
      std::vector<std::uint8_t> depths(points), counts(points);
      SPLATVOL_TRY(format::unpack_octants(entry, packed, depths, counts, what));
      std::vector<float> sizes(points);
      for (std::size_t i = 0; i < sizes.size(); ++i)
        sizes[i] = static_cast<float>(std::ldexp(cube.edge / length, -depths[i]) / std::cbrt(counts[i]));
      return DecodedChunk(std::move(sizes));
    }
    case ColumnKind::gradient:
      return decode_each<vec3>(
          points, [&](std::span<vec3> out) { return format::unpack_gradients(entry, packed, out, what); },
          pack_direction);
    case ColumnKind::moments:
      return decode_each<format::SplatShape>(
          points,
          [&](std::span<format::SplatShape> out) {
            return format::unpack_moments(entry, packed, out, cube.edge, what);
          },
          [&](const format::SplatShape& shape) { return compact(shape, length); });
    case ColumnKind::value_moments:
      return decode_each<format::SplatValue>(
          points,
          [&](std::span<format::SplatValue> out) { return format::unpack_value_moments(entry, packed, out, what); },
          [](const format::SplatValue& value) { return compact(value); });
    case ColumnKind::unknown:
      break;
  }
  return fail(ErrorCode::unsupported, "{}: a column of an unknown kind", what);
}

MaterialShape compact(const format::SplatShape& shape, double length) {
  // Principal axes have no sign: a turn by 180 degrees about one of them reverses the other two and gives the same
  // ellipsoid. One of q, qi, qj, qk has the largest of q's components as its w, up to sign.
  glm::dquat q = shape.orientation;
  const dvec3 v(q.x, q.y, q.z);
  std::uint32_t turned = 3;
  double largest = std::abs(q.w);
  for (std::uint32_t axis = 0; axis < 3; ++axis) {
    const double component = std::abs(v[static_cast<int>(axis)]);
    if (component <= largest) continue;
    largest = component;
    turned = axis;
  }
  if (turned < 3) q = q * glm::dquat(0.0, turned == 0 ? 1.0 : 0.0, turned == 1 ? 1.0 : 0.0, turned == 2 ? 1.0 : 0.0);
  if (q.w < 0) q = -q;
  dvec3 boundary = shape.boundary;
  for (std::uint32_t axis = 0; axis < 3; ++axis)
    if (turned < 3 && axis != turned) boundary[static_cast<int>(axis)] *= -1;
  const double mass = shape.mass / length / length / length;
  return {static_cast<float>(mass * shape.density), vec3(shape.deviations / length), vec3(dvec3(q.x, q.y, q.z)),
          pack_boundary(boundary), turned};
}

MaterialValue compact(const format::SplatValue& value) {
  if (!(value.coverage > 0)) return {0, 0, {}, 0};
  const dvec3& c = value.correlation;
  return {static_cast<float>(value.mean),
          static_cast<float>(value.deviation),
          {signed_byte(c.x), signed_byte(c.y), signed_byte(c.z), signed_byte(value.residual)},
          static_cast<float>(value.coverage)};
}

}  // namespace splatvol
