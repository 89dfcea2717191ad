// A chunk of one column, unpacked into numbers and into codes. What was unpacked is packed again: it must come back as
// the writer promises.
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "format/codes.h"
#include "format/columns.h"
#include "format/layout.h"
#include "format/volume_info.h"
#include "tests/fuzz/fuzz.h"

using namespace splatvol;
using namespace splatvol::format;
using splatvol::fuzz::require;
using splatvol::fuzz::require_ok;

namespace {

/// A chunk, and the file that it is in.
struct Case {
  std::uint32_t column = 0;
  bool fits = true;  // the payload has the length that its header asks for
  Cube cube;
  double error = 0;  // for packing
  ValueSummary summary;
  std::vector<std::byte> payload;
  std::size_t points = 0;
};

double bounded(double number, double least, double most) { return number >= least && number <= most ? number : least; }

/// Returns the bytes of the header and those of a point.
std::array<std::size_t, 2> lengths_of(const Case& c) {
  std::array<std::uint8_t, 48> head{};
  for (std::size_t i = 0; i < std::min(head.size(), c.payload.size()); ++i)
    head[i] = static_cast<std::uint8_t>(c.payload[i]);
  switch (c.column) {
    case 0:
    case 1:
      return {sizeof(PositionHeader), head[0] == 1 ? std::size_t{head[1]} + head[2] + head[3] : 24};
    case 2:
      return {sizeof(ValueHeader), head[1]};
    case 3:
      return {0, 2};
    case 4:
      return {sizeof(MomentsHeader), std::size_t{15} + head[16]};
    case 5:
      return {sizeof(ValueMomentsHeader), std::size_t{4} + head[1] + head[2]};
    default:
      return {0, 3};
  }
}

Case read_case(fuzz::Input input) {
  Case c;
  c.column = input.take<std::uint8_t>() % 7;
  c.fits = input.take<std::uint8_t>() < 240;
  c.points = input.take<std::uint8_t>() + std::size_t{1};
  c.cube.edge = bounded(input.take<double>(), least_length, largest_length);
  for (int axis = 0; axis < 3; ++axis)
    c.cube.origin[axis] = bounded(input.take<double>(), -largest_length, largest_length);
  c.error = bounded(input.take<double>(), 0, 1e300);
  c.summary.min = input.take<float>();
  c.summary.max = input.take<float>();
  if (!c.summary.is_valid()) c.summary = {};
  c.payload.assign(input.rest().begin(), input.rest().end());
  if (!c.fits) return c;
  const auto [header, of_point] = lengths_of(c);
  if (c.payload.size() > header && of_point > 0)
    c.points = std::clamp<std::size_t>((c.payload.size() - header) / of_point, 1, 4096);
  c.payload.resize(header + c.points * of_point);
  return c;
}

PackedChunk chunk_of(const Case& c) {
  PackedChunk chunk;
  chunk.bytes = c.payload;
  chunk.entry.hash = hash_bytes(chunk.bytes);
  chunk.entry.packed_bytes = chunk.entry.unpacked_bytes = static_cast<std::uint32_t>(chunk.bytes.size());
  chunk.entry.min = c.summary.min;
  chunk.entry.max = c.summary.max;
  return chunk;
}

bool is_finite(const dvec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

void check_positions(const Case& c) {
  const bool centroids = c.column == 1;
  const PackedChunk chunk = chunk_of(c);
  std::vector<dvec3> out(c.points);
  PositionCodes codes;
  const Status read = centroids ? unpack_centroids(chunk.entry, chunk.bytes, out, c.cube, "fuzz")
                                : unpack_positions(chunk.entry, chunk.bytes, out, c.cube, "fuzz");
  const Status as_codes = centroids ? unpack_centroid_codes(chunk.entry, chunk.bytes, c.points, c.cube, "fuzz", codes)
                                    : unpack_position_codes(chunk.entry, chunk.bytes, c.points, c.cube, "fuzz", codes);
  require(read.has_value() == as_codes.has_value(), "codes are refused as numbers are");
  if (!read) return;
  require(std::ranges::all_of(out, is_finite), "positions are finite");
  require(codes.error >= 0 && codes.error <= c.cube.edge, "the error is stated");

  // Positions outside of the cube need an error as large as the one that they came with.
  const auto is_inside = [&](const dvec3& p) {
    const dvec3 d = p - c.cube.origin;
    return glm::clamp(d, dvec3(0), dvec3(c.cube.edge)) == d;
  };
  if (!centroids && !std::ranges::all_of(out, is_inside)) return;
  const double error = std::min(c.error, c.cube.edge);
  double stated = error;
  const PackedChunk packed = centroids ? pack_centroids(out, error, c.cube) : pack_positions(out, error, &stated);
  std::vector<dvec3> again(c.points);
  require_ok(centroids ? unpack_centroids(packed.entry, packed.bytes, again, c.cube, "fuzz")
                       : unpack_positions(packed.entry, packed.bytes, again, c.cube, "fuzz"),
             "packed positions can be read");
  require(stated <= error, "the stated error is no larger than the allowed one");
  if (centroids) return;
  for (std::size_t i = 0; i < out.size(); ++i)
    for (int axis = 0; axis < 3; ++axis)
      require(std::abs(again[i][axis] - out[i][axis]) <= stated, "positions come back within the stated error");
}

void check_values(const Case& c) {
  const PackedChunk chunk = chunk_of(c);
  std::vector<float> out(c.points);
  if (!unpack_values(chunk.entry, chunk.bytes, out, "fuzz")) return;
  StoredValues result;
  const ValueBins bins{c.summary.min, c.summary.max};
  const PackedChunk packed = pack_values(out, c.error, bins, &result);
  std::vector<float> again(c.points);
  const auto stated = unpack_values_and_error(packed.entry, packed.bytes, again, "fuzz");
  require(stated && *stated == result.error && result.error <= c.error, "the error is that which is stated");
  std::uint64_t missing = 0;
  for (std::size_t i = 0; i < out.size(); ++i) {
    require(std::isnan(again[i]) == std::isnan(out[i]), "a missing value comes back as missing");
    if (std::isnan(out[i])) {
      ++missing;
      continue;
    }
    const double rounding = std::abs(double{out[i]}) * 0x1p-23 + 0x1p-149;  // of grid values to single precision
    require(std::abs(double{again[i]} - double{out[i]}) <= result.error + (result.error > 0 ? rounding : 0),
            "values come back within the stated error");
  }
  require(missing == result.missing, "missing values are counted");
}

void check_octants(const Case& c) {
  const PackedChunk chunk = chunk_of(c);
  std::vector<std::uint8_t> depths(c.points), counts(c.points), depths_again(c.points), counts_again(c.points);
  if (!unpack_octants(chunk.entry, chunk.bytes, depths, counts, "fuzz")) return;
  const PackedChunk packed = pack_octants(depths, counts);
  require_ok(unpack_octants(packed.entry, packed.bytes, depths_again, counts_again, "fuzz"),
             "packed octants can be read");
  require(depths == depths_again && counts == counts_again, "octants come back");
}

// Whether a size comes back as log codes promise.
bool is_near(double size, double again, double largest) {
  const double factor = std::exp2(1.0 / 256) * (1 + 1e-9);
  if (size < largest * 0x1p-510 || size == 0) return again <= largest * 0x1p-509 || again <= size * factor;
  return again <= size * factor && size <= again * factor;
}

void check_moments(const Case& c) {
  const PackedChunk chunk = chunk_of(c);
  std::vector<SplatShape> out(c.points), again(c.points);
  MomentCodes codes;
  const Status read = unpack_moments(chunk.entry, chunk.bytes, out, c.cube.edge, "fuzz");
  require(read.has_value() ==
              unpack_moment_codes(chunk.entry, chunk.bytes, c.points, c.cube.edge, "fuzz", codes).has_value(),
          "codes are refused as numbers are");
  if (!read) return;
  double mass = 0, deviation = 0;
  for (const SplatShape& shape : out) {
    require(std::isfinite(shape.mass) && shape.mass >= 0 && is_finite(shape.deviations) && is_finite(shape.boundary) &&
                std::isfinite(shape.density) && shape.density > 0,
            "shapes are finite");
    require(std::abs(glm::length(shape.orientation) - 1) < 1e-6, "orientations are unit quaternions");
    require(
        shape.deviations.x >= shape.deviations.y && shape.deviations.y >= shape.deviations.z && shape.deviations.z >= 0,
        "deviations descend");
    require(is_finite(reflection_shift(shape)), "shifts are finite");
    mass = std::max(mass, shape.mass);
    deviation = std::max(deviation, shape.deviations.x);
  }
  const PackedChunk packed = pack_moments(out, c.cube.edge);
  require_ok(unpack_moments(packed.entry, packed.bytes, again, c.cube.edge, "fuzz"), "packed shapes can be read");
  for (std::size_t i = 0; i < out.size(); ++i) {
    require(is_near(out[i].mass, again[i].mass, mass), "masses come back");
    for (int k = 0; k < 3; ++k)
      require(is_near(out[i].deviations[k], again[i].deviations[k], deviation), "deviations come back");
    require(std::abs(std::log2(again[i].density / out[i].density)) <= 1.0 / 64 + 1e-9, "densities come back");
  }
}

void check_value_moments(const Case& c) {
  const PackedChunk chunk = chunk_of(c);
  std::vector<SplatValue> out(c.points), again(c.points);
  ValueMomentCodes codes;
  const Status read = unpack_value_moments(chunk.entry, chunk.bytes, out, "fuzz");
  require(read.has_value() == unpack_value_moment_codes(chunk.entry, chunk.bytes, c.points, "fuzz", codes).has_value(),
          "codes are refused as numbers are");
  std::vector<ValueInterval> intervals(c.points);
  require(read.has_value() == unpack_value_intervals(chunk.entry, chunk.bytes, intervals, "fuzz").has_value(),
          "intervals are refused as numbers are");
  if (!read) return;
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (out[i].coverage == 0) continue;
    const auto inside = static_cast<float>(std::clamp(out[i].mean, double{chunk.entry.min}, double{chunk.entry.max}));
    require(chunk.entry.min <= intervals[i].low && intervals[i].high <= chunk.entry.max, "intervals are in the range");
    require(intervals[i].low <= inside && inside <= intervals[i].high, "the mean is in its interval");
  }
  double largest = 0;
  for (const SplatValue& value : out) {
    require(std::isfinite(value.mean) && std::isfinite(value.deviation) && value.deviation >= 0 &&
                is_finite(value.correlation) && value.residual >= 0 && value.residual <= 1 && value.coverage >= 0 &&
                value.coverage <= 1,
            "values are finite");
    if (value.coverage > 0) largest = std::max(largest, value.deviation);
  }
  const PackedChunk packed = pack_value_moments(out, c.error, c.summary);
  require_ok(unpack_value_moments(packed.entry, packed.bytes, again, "fuzz"), "packed values can be read");
  for (std::size_t i = 0; i < out.size(); ++i) {
    require((out[i].coverage == 0) == (again[i].coverage == 0), "only coverage 0 becomes 0");
    if (out[i].coverage == 0) continue;
    require(std::abs(out[i].coverage - again[i].coverage) <= 1.0 / 255 + 1e-12, "coverages come back");
    const double mean = std::clamp(out[i].mean, double{c.summary.min}, double{c.summary.max});
    const double deviation = out[i].deviation;
    const double rounding = std::abs(mean) * 0x1p-23 + 0x1p-149;
    require(std::abs(again[i].mean - mean) <= std::max(0.07 * deviation, 0.51 * c.error) + rounding, "means come back");
    const double factor = std::exp2(1.0 / 16) * (1 + 1e-9);
    if (deviation > largest * 0x1p-1022)
      require(again[i].deviation <= deviation * factor && deviation <= again[i].deviation * factor,
              "deviations of values come back");
  }
}

void check_gradients(const Case& c) {
  const PackedChunk chunk = chunk_of(c);
  std::vector<vec3> out(c.points), again(c.points);
  if (!unpack_gradients(chunk.entry, chunk.bytes, out, "fuzz")) return;
  const PackedChunk packed = pack_gradients(out);
  require_ok(unpack_gradients(packed.entry, packed.bytes, again, "fuzz"), "packed gradients can be read");
  for (std::size_t i = 0; i < out.size(); ++i) {
    const dvec3 direction(out[i]);
    const dvec3 unit = direction == dvec3(0) ? direction : glm::normalize(direction);
    for (int k = 0; k < 3; ++k) require(std::abs(double{again[i][k]} - unit[k]) <= 1.0 / 127, "directions come back");
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const Case c = read_case(fuzz::Input(fuzz::bytes_of(data, size)));
  constexpr std::array checks = {check_positions, check_positions,     check_values,   check_octants,
                                 check_moments,   check_value_moments, check_gradients};
  checks[c.column](c);
  return 0;
}
