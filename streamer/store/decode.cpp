// Chunks to drawing records. Codes of the file become codes of records, without numbers between them. Each thread uses
// its memory again: fresh pages cost more than decoding.
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "format/codes.h"
#include "format/columns.h"
#include "streamer/store/decode.h"

namespace splatvol {
namespace {

constexpr std::uint32_t bias = 1U << 20;                                 // of a packed position
constexpr std::uint64_t most_steps = std::uint64_t{largest_offset} * 2;  // along an edge of a block

// --- Positions.

struct CodeRange {
  std::uint64_t least, largest;

  [[nodiscard]] std::uint64_t middle() const { return least + (largest - least) / 2; }
};

CodeRange range_of(std::span<const std::uint64_t> codes) {
  std::int64_t least = std::numeric_limits<std::int64_t>::max(), largest = 0;  // codes on a grid have at most 7 bytes
  for (const std::uint64_t code : codes) {
    least = std::min(least, static_cast<std::int64_t>(code));
    largest = std::max(largest, static_cast<std::int64_t>(code));
  }
  return {static_cast<std::uint64_t>(std::min(least, largest)), static_cast<std::uint64_t>(largest)};
}

// Points on the grid of a chunk that is small enough for one block: its steps are those of the grid.
BlockedPositions one_block(const format::PositionCodes& codes, const std::array<CodeRange, 3>& ranges, double length) {
  const std::size_t points = codes.axes[0].size();
  BlockedPositions result;
  result.positions.resize(points);
  const std::uint64_t middle[] = {ranges[0].middle(), ranges[1].middle(), ranges[2].middle()};
  for (std::size_t i = 0; i < points; ++i) {
    const std::uint64_t x = codes.axes[0][i] - middle[0] + bias, y = codes.axes[1][i] - middle[1] + bias,
                        z = codes.axes[2][i] - middle[2] + bias;
    result.positions[i] = {static_cast<std::uint32_t>(x | y << 21), static_cast<std::uint32_t>(y >> 11 | z << 10)};
  }
  const dvec3 steps(static_cast<double>(middle[0]), static_cast<double>(middle[1]), static_cast<double>(middle[2]));
  result.blocks.push_back({codes.origin + codes.quantisation_step * steps, codes.quantisation_step / length,
                           static_cast<std::uint32_t>(points)});
  return result;
}

// `limit_of`: returns the limit of a point, as in make_blocks.
template <class LimitOf>
BlockedPositions blocks_of(const format::PositionCodes& codes, double length, const LimitOf& limit_of) {
  const std::size_t points = codes.axes[0].size();
  if (!codes.exact) {
    const std::array ranges{range_of(codes.axes[0]), range_of(codes.axes[1]), range_of(codes.axes[2])};
    const auto fits = [](const CodeRange& range) { return range.largest - range.least <= most_steps; };
    if (std::ranges::all_of(ranges, fits)) return one_block(codes, ranges, length);
  }
  thread_local std::vector<dvec3> positions;
  thread_local std::vector<float> limits;
  positions.resize(points);
  limits.resize(points);
  for (std::size_t i = 0; i < points; ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      const std::uint64_t code = codes.axes[static_cast<std::size_t>(axis)][i];
      positions[i][axis] = codes.exact ? std::bit_cast<double>(code)
                                       : codes.origin[axis] + codes.quantisation_step * static_cast<double>(code);
    }
    limits[i] = limit_of(i);
  }
  BlockedPositions result = make_blocks(positions, limits, length);
  return result;
}

// --- Shapes.

// Converts orientations with components of `bits` bits to PackedOrientation.
void pack_orientations(std::span<std::uint64_t> codes, int bits) {
  constexpr int packed_bits = 20;
  if (bits == packed_bits) return;
  const auto middle = [](int of_bits) { return static_cast<float>((1 << (of_bits - 1)) - 1); };
  const float ratio = middle(packed_bits) / middle(bits);
  constexpr auto most = static_cast<float>((1 << packed_bits) - 1);
  const std::uint64_t mask = (std::uint64_t{1} << bits) - 1;
  for (std::uint64_t& code : codes) {
    std::uint64_t packed = code & 3;
    for (int k = 0; k < 3; ++k) {
      const auto component = static_cast<float>(static_cast<std::int32_t>(code >> (2 + k * bits) & mask));
      const auto rounded = static_cast<std::int32_t>(std::min(component * ratio + 0.5F, most));
      packed |= static_cast<std::uint64_t>(rounded) << (2 + k * packed_bits);
    }
    code = packed;
  }
}

// Densities of the file are in steps of 1/32 octave from code 128. The largest is under 2^4. So masses times density
// have log codes for a scale that is 2^4 times as large.
constexpr double density_scale = 16;
constexpr int codes_of_density_scale = 4 * static_cast<int>(log_codes_per_octave);

std::uint16_t mass_code(std::uint16_t mass, std::uint8_t density) {
  constexpr int codes_per_step = static_cast<int>(log_codes_per_octave) / 32, density_one = 128;
  const int code = mass + codes_per_step * (density - density_one) - codes_of_density_scale;
  return static_cast<std::uint16_t>(mass == 0 ? 0 : std::max(1, code));
}

std::uint32_t pack_boundary(std::int16_t x, std::int16_t y, std::int16_t z) {
  const auto field = [](std::int16_t code) { return static_cast<std::uint32_t>(code) & 0x3FFU; };
  return field(x) | field(y) << 10 | field(z) << 20;
}

Result<ShapeRow> decode_moments(const ChunkBytes& positions, const ChunkBytes& shapes, std::uint32_t points,
                                const Cube& cube, std::string_view what) {
  const double length = drawing_length(cube.edge);
  thread_local format::PositionCodes centroids;
  thread_local format::MomentCodes codes;
  SPLATVOL_TRY(format::unpack_centroid_codes(positions.entry, positions.packed, points, cube, what, centroids));
  SPLATVOL_TRY(format::unpack_moment_codes(shapes.entry, shapes.packed, points, cube.edge, what, codes));
  const double mass_scale = density_scale * (codes.mass_scale / length / length / length);
  const double deviation_scale = codes.deviation_scale / length;
  const auto& d = codes.deviations;
  BlockedPositions blocked = blocks_of(centroids, length, [&](std::size_t i) {
    return static_cast<float>(log_number(d[2][i] > 0 ? d[2][i] : d[1][i] > 0 ? d[1][i] : d[0][i], deviation_scale));
  });
  pack_orientations(codes.orientations, codes.component_bits);
  thread_local std::vector<MomentsShape> records;
  records.resize(points);
  for (std::size_t i = 0; i < points; ++i) {
    const std::uint64_t orientation = codes.orientations[i];
    records[i] = {blocked.positions[i],
                  {static_cast<std::uint32_t>(orientation), static_cast<std::uint32_t>(orientation >> 32)},
                  mass_code(codes.masses[i], codes.densities[i]),
                  {d[0][i], d[1][i], d[2][i]},
                  pack_boundary(codes.boundaries[0][i], codes.boundaries[1][i], codes.boundaries[2][i])};
  }
  return ShapeRow(std::vector(records.begin(), records.end()), std::move(blocked.blocks), mass_scale, deviation_scale);
}

Result<ShapeRow> decode_octants(const ChunkBytes& positions, const ChunkBytes& shapes, std::uint32_t points,
                                const Cube& cube, std::string_view what) {
  const double length = drawing_length(cube.edge);
  thread_local format::PositionCodes codes;
  thread_local std::vector<std::uint8_t> depths, counts;
  depths.resize(points);
  counts.resize(points);
  SPLATVOL_TRY(format::unpack_position_codes(positions.entry, positions.packed, points, cube, what, codes));
  SPLATVOL_TRY(format::unpack_octants(shapes.entry, shapes.packed, depths, counts, what));
  const auto size_of = [&](std::size_t i) {
    return static_cast<float>(std::ldexp(cube.edge / length, -depths[i]) / std::cbrt(counts[i]));
  };
  BlockedPositions blocked = blocks_of(codes, length, size_of);
  std::vector<OctantShape> records(points);
  for (std::size_t i = 0; i < points; ++i) records[i] = {blocked.positions[i], size_of(i)};
  return ShapeRow(std::move(records), std::move(blocked.blocks));
}

// --- Values.

// Deviations of the file have 8 codes an octave, from 1 for the scale downwards.
std::uint16_t deviation_code(unsigned code) {
  constexpr unsigned codes_per_step = log_codes_per_octave / 8,
                     most_steps_down = (largest_log_code - 1) / codes_per_step;
  return static_cast<std::uint16_t>(
      code == 0 ? 0 : largest_log_code - codes_per_step * std::min(code - 1, most_steps_down));
}

// Correlations of the file are in units of 1/15.
std::int8_t correlation_code(int code) {
  constexpr int most = 15, packed_most = 127;
  return static_cast<std::int8_t>((2 * packed_most * (code + most) + most) / (2 * most) - packed_most);
}

// A thread's buffers, which the values of both attributes use in turn.
format::ValueMomentCodes& codes_of_thread() {
  thread_local format::ValueMomentCodes codes;
  return codes;
}

std::vector<float>& stored_of_thread() {
  thread_local std::vector<float> stored;
  return stored;
}

Result<OpacityValues> decode_opacity(KernelKind kernel, const ChunkBytes& chunk, std::uint32_t points,
                                     std::string_view what) {
  OpacityValues opacity;
  opacity.records.resize(points);
  if (kernel == KernelKind::octant) {
    std::vector<float>& stored = stored_of_thread();
    stored.resize(points);
    SPLATVOL_TRY(format::unpack_values(chunk.entry, chunk.packed, stored, what));
    for (std::size_t i = 0; i < points; ++i)
      if (!std::isnan(stored[i])) opacity.records[i] = {stored[i], 0, 255};
    return opacity;
  }
  format::ValueMomentCodes& codes = codes_of_thread();
  SPLATVOL_TRY(format::unpack_value_moment_codes(chunk.entry, chunk.packed, points, what, codes));
  for (std::size_t i = 0; i < points; ++i)
    if (codes.coverages[i] > 0)
      opacity.records[i] = {static_cast<float>(codes.means[i]), deviation_code(codes.deviations[i]),
                            codes.coverages[i]};
  opacity.deviation_scale = codes.deviation_scale;
  return opacity;
}

Result<ValueRow> decode_value_moments(const ChunkBytes& values, OpacityValues opacity, std::uint32_t points,
                                      std::string_view what) {
  format::ValueMomentCodes& codes = codes_of_thread();
  SPLATVOL_TRY(format::unpack_value_moment_codes(values.entry, values.packed, points, what, codes));
  const auto& c = codes.correlations;
  thread_local std::vector<MomentsValue> records;
  records.resize(points);
  for (std::size_t i = 0; i < points; ++i) {
    records[i] = {static_cast<float>(codes.means[i]),
                  deviation_code(codes.deviations[i]),
                  codes.coverages[i],
                  {correlation_code(c[0][i]), correlation_code(c[1][i]), correlation_code(c[2][i])}};
    if (codes.coverages[i] == 0) records[i] = {};
  }
  return ValueRow(std::vector(records.begin(), records.end()), codes.deviation_scale, std::move(opacity));
}

}  // namespace

Result<ShapeRow> decode_shapes(KernelKind kernel, const ChunkBytes& positions, const ChunkBytes& shapes,
                               std::uint32_t points, const Cube& cube, std::string_view what) {
  return kernel == KernelKind::octant ? decode_octants(positions, shapes, points, cube, what)
                                      : decode_moments(positions, shapes, points, cube, what);
}

Result<ValueRow> decode_values(KernelKind kernel, const ValueChunks& chunks, std::uint32_t points,
                               std::string_view what) {
  const auto& [values, gradients, opacity_chunk] = chunks;
  OpacityValues opacity;
  if (opacity_chunk) SPLATVOL_TRY_SET(opacity, decode_opacity(kernel, *opacity_chunk, points, what));
  if (kernel == KernelKind::moments) return decode_value_moments(values, std::move(opacity), points, what);
  std::vector<float>& stored = stored_of_thread();
  thread_local std::vector<std::uint32_t> directions;
  stored.resize(points);
  directions.assign(points, 0);
  SPLATVOL_TRY(format::unpack_values(values.entry, values.packed, stored, what));
  if (gradients) SPLATVOL_TRY(format::unpack_gradient_codes(gradients->entry, gradients->packed, directions, what));
  std::vector<OctantValue> records(points);
  for (std::size_t i = 0; i < points; ++i) records[i] = {stored[i], directions[i]};
  return ValueRow(std::move(records), 0, std::move(opacity));
}

}  // namespace splatvol
