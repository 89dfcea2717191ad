#include "format/columns.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "format/codes.h"
#include "format/payload.h"

namespace splatvol::format {
namespace {

constexpr std::uint32_t missing_value_bits = 0x7FC00000u;
constexpr std::uint8_t form_grid = 1;
constexpr std::uint8_t form_exact = 2;

// In quantisation steps. Rounding to the grid moves a coordinate by at most 0.5. Its difference from the origin, of up
// to 2^46 quantisation steps, is itself rounded by up to 2^-7.
constexpr double rounding_error = 0.51;
constexpr int max_grid_bits = 45;

// By how many edges centroids may be outside of the cube, along each axis (spec 8).
constexpr double centroid_margin = 1;
constexpr double vertex_margin = 4;

int bytes_for(std::uint64_t number) { return (static_cast<int>(std::bit_width(number)) + 7) / 8; }

// The origin is the grid point nearest to the lowest coordinate, so this coordinate may lie half a quantisation step
// below it.
std::uint64_t grid_code(double coordinate, double origin, double quantisation_step) {
  return static_cast<std::uint64_t>(nearest_integer(std::max(0.0, (coordinate - origin) / quantisation_step)));
}

// Fills the header for a grid whose quantisation step is a power of two and whose origin is a multiple of it. Then
// nearby chunks share their grid points, and a fine enough grid keeps coordinates of single precision exactly. Returns
// false if no grid is fine enough.
bool make_grid(std::span<const dvec3> positions, double error, PositionHeader& header) {
  if (!(error > 0)) return false;
  const double quantisation_step = std::ldexp(1.0, std::ilogb(error / rounding_error));
  Box box;
  for (const dvec3& p : positions) box.include({p, p});
  for (int axis = 0; axis < 3; ++axis) {
    const double origin = std::round(box.low[axis] / quantisation_step) * quantisation_step;
    const double reach = std::max(std::abs(origin), std::abs(box.high[axis])) / quantisation_step;
    if (!std::isfinite(origin) || !(reach < std::exp2(max_grid_bits))) return false;
    const std::uint64_t span = grid_code(box.high[axis], origin, quantisation_step);
    if (!std::isfinite(quantisation_step * static_cast<double>(span))) return false;
    header.origin[axis] = origin;
    header.width[axis] = static_cast<std::uint8_t>(bytes_for(span));
  }
  header.form = form_grid;
  header.quantisation_step = quantisation_step;
  header.error = std::min(error, quantisation_step * rounding_error);
  return true;
}

// A value on the grid. It may pass single precision only if the header is bad.
float value_on_grid(const ValueHeader& header, std::int64_t number) {
  return static_cast<float>(header.origin + header.quantisation_step * static_cast<double>(number));
}

// Encodes each value as the difference of its grid number from that of the value before it: 0 if it is missing. Rounds
// the values to the grid. Returns false, and then leaves anything in its outputs, if no grid is shorter than the exact
// values.
bool encode_on_grid(double error, std::span<float> values, std::span<std::uint32_t> codes, ValueHeader& header) {
  constexpr double most = 1 << 22;  // of quantisation steps; codes of differences then have three bytes
  const auto present = [](float value) { return std::isfinite(value); };
  const auto first = std::ranges::find_if(values, present);
  header.form = form_grid;
  if (first != values.end()) header.origin = *first;
  const auto same = [&](float value) { return !present(value) || value == *first; };
  if (!std::ranges::all_of(values, same)) {
    if (!(error > 0) || !std::isfinite(error)) return false;
    header.quantisation_step = std::ldexp(1.0, std::ilogb(error / rounding_error));
    header.origin = std::round(header.origin / header.quantisation_step) * header.quantisation_step;
  }
  std::int64_t last = 0;
  std::uint32_t all_bits = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!present(values[i])) {
      codes[i] = 0;
      continue;
    }
    const double steps =
        header.quantisation_step > 0 ? (static_cast<double>(values[i]) - header.origin) / header.quantisation_step : 0;
    if (!(std::abs(steps) < most)) return false;
    const std::int64_t number = nearest_integer(steps);
    codes[i] = static_cast<std::uint32_t>(zigzag(number - last) + 1);
    all_bits |= codes[i];
    last = number;
    values[i] = value_on_grid(header, number);
    if (!(std::abs(values[i]) <= largest_stored_value)) return false;
  }
  header.width = static_cast<std::uint8_t>(bytes_for(all_bits));
  return true;
}

// Returns the largest error of values that are stored with this header.
double error_of(const ValueHeader& header) {
  return header.form == form_grid ? rounding_error * header.quantisation_step : 0;
}

// Describes the values of a chunk as they come back.
StoredValues describe(std::span<const float> values, const ValueBins& bins, const ValueHeader& header) {
  StoredValues result{.error = error_of(header)};
  for (const float value : values) {
    if (std::isnan(value))
      ++result.missing;
    else
      ++result.histogram[static_cast<std::size_t>(bins.bin(double{value}))];
  }
  return result;
}

void read_values_on_grid(const ValueHeader& header, std::span<const std::byte> planes, std::span<float> out) {
  thread_local std::vector<std::uint32_t> codes;
  take_planes(planes, codes, out.size(), header.width);
  std::int64_t last = 0;
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (codes[i] == 0) {
      out[i] = std::bit_cast<float>(missing_value_bits);
      continue;
    }
    last += unzigzag(codes[i] - 1);
    out[i] = value_on_grid(header, last);
  }
}

// Checks the form of a header. The error of positions is at most the edge of the cube.
Result<PositionHeader> check_position_header(std::span<const std::byte> payload, std::size_t count, double edge,
                                             std::string_view what) {
  if (payload.size() < sizeof(PositionHeader))
    return fail(ErrorCode::invalid_data, "{}: payload too short [R17]", what);
  const auto header = read_record<PositionHeader>(payload, 0);
  std::size_t bytes_per_point = 0;
  bool valid = (header.form == form_grid || header.form == form_exact) && header.zero == 0 && header.error >= 0 &&
               header.error <= edge && header.quantisation_step >= 0 && std::isfinite(header.quantisation_step);
  for (int axis = 0; axis < 3; ++axis) {
    bytes_per_point += header.form == form_exact ? sizeof(double) : header.width[axis];
    valid = valid && std::isfinite(header.origin[axis]) && header.width[axis] <= (header.form == form_grid ? 7 : 0);
  }
  if (!valid || payload.size() != sizeof(PositionHeader) + count * bytes_per_point)
    return fail(ErrorCode::invalid_data, "{}: bad position header [R17]", what);
  return header;
}

}  // namespace

Result<std::span<const std::byte>> unpack_payload(const ChunkEntry& entry, std::span<const std::byte> packed,
                                                  std::string_view what) {
  if (packed.size() != entry.packed_bytes || hash_bytes(packed) != entry.hash)
    return fail(ErrorCode::invalid_data, "{}: checksum mismatch", what);
  return unpack_here(packed, entry.unpacked_bytes, what);
}

PackedChunk pack_payload(const Payload& payload) {
  PackedChunk chunk{{}, pack_blocks(payload.bytes, payload.ends)};
  chunk.entry.hash = hash_bytes(chunk.bytes);
  chunk.entry.packed_bytes = static_cast<std::uint32_t>(chunk.bytes.size());
  chunk.entry.unpacked_bytes = static_cast<std::uint32_t>(payload.bytes.size());
  return chunk;
}

PackedChunk pack_payload(const Payload& payload, const ValueSummary& summary) {
  PackedChunk chunk = pack_payload(payload);
  chunk.entry.min = summary.min;
  chunk.entry.max = summary.max;
  chunk.entry.occupancy = summary.occupancy;
  return chunk;
}

ValueSummary ValueBins::summarize(std::span<const float> stored) const {
  ValueSummary summary;
  for (const float value : stored) {
    if (!std::isfinite(value)) continue;
    summary.min = std::min(summary.min, value);
    summary.max = std::max(summary.max, value);
    summary.occupancy |= std::uint64_t{1} << bin(value);
  }
  return summary;
}

PackedChunk pack_positions(std::span<const dvec3> positions, double error, double* stated_error) {
  PositionHeader header{};
  const bool grid = make_grid(positions, error, header);
  if (!grid) header = {.form = form_exact, .width = {}, .zero = 0, .error = 0, .origin = {}, .quantisation_step = 0};
  if (stated_error) *stated_error = header.error;

  Payload payload;
  payload.bytes.reserve(sizeof header + positions.size() * sizeof(dvec3));
  append_record(payload.bytes, header);
  std::vector<std::uint64_t> codes(grid ? positions.size() : 0);
  std::vector<double> coordinates(grid ? 0 : positions.size());
  for (int axis = 0; axis < 3; ++axis) {
    if (grid) {
      for (std::size_t i = 0; i < positions.size(); ++i)
        codes[i] = grid_code(positions[i][axis], header.origin[axis], header.quantisation_step);
      payload.add_noisy(codes, header.width[axis]);
    } else {
      for (std::size_t i = 0; i < positions.size(); ++i) coordinates[i] = positions[i][axis];
      payload.add_noisy(coordinates);
    }
    payload.end_block();
  }
  return pack_payload(payload);
}

PackedChunk pack_centroids(std::span<const dvec3> centroids, double error, const Cube& cube) {
  const dvec3 low = cube.origin - centroid_margin * cube.edge;
  const dvec3 high = cube.origin + (1 + centroid_margin) * cube.edge;
  const auto is_inside = [&](const dvec3& p) { return glm::clamp(p, low, high) == p; };
  if (std::ranges::all_of(centroids, is_inside)) return pack_positions(centroids, std::min(error, cube.edge));
  std::vector<dvec3> inside(centroids.begin(), centroids.end());
  for (dvec3& p : inside) p = glm::clamp(p, low, high);
  return pack_positions(inside, std::min(error, cube.edge));
}

PackedChunk pack_values(std::span<const float> stored, double error, const ValueBins& bins, StoredValues* result) {
  ValueHeader header{};
  std::vector<float> values(stored.begin(), stored.end());
  for (float& value : values)
    if (!(std::abs(value) <= largest_stored_value)) value = std::bit_cast<float>(missing_value_bits);
  std::vector<float> rounded = values;
  std::vector<std::uint32_t> codes(stored.size());
  if (!encode_on_grid(error, rounded, codes, header)) {
    header = {.form = form_exact, .width = sizeof(float), .zero = {}, .origin = 0, .quantisation_step = 0};
    rounded = values;
    for (std::size_t i = 0; i < values.size(); ++i) codes[i] = std::bit_cast<std::uint32_t>(values[i]);
  }
  if (result) *result = describe(rounded, bins, header);
  Payload payload;
  payload.bytes.reserve(sizeof header + codes.size() * header.width);
  append_record(payload.bytes, header);
  payload.add(codes, header.width, 1);
  return pack_payload(payload, bins.summarize(rounded));
}

PackedChunk pack_octants(std::span<const std::uint8_t> depths, std::span<const std::uint8_t> counts) {
  Payload payload;
  payload.bytes.reserve(2 * depths.size());
  payload.add(depths);
  payload.add(counts);
  return pack_payload(payload);
}

namespace {

// Returns the coordinate of a code. It rises with the code on a grid.
double coordinate_of(const PositionCodes& codes, int axis, std::uint64_t code) {
  return codes.exact ? std::bit_cast<double>(code)
                     : codes.origin[axis] + codes.quantisation_step * static_cast<double>(code);
}

// Whether the points lie within `margin` edges of the cube, and the stated error. A cube that is small beside its
// distance from 0 has no exact other end. So distances are compared.
bool are_inside(const PositionCodes& codes, const Cube& cube, double margin) {
  const double least = -margin * cube.edge - codes.error, most = (1 + margin) * cube.edge + codes.error;
  bool inside = true;
  for (int axis = 0; axis < 3; ++axis) {
    const std::vector<std::uint64_t>& of_axis = codes.axes[static_cast<std::size_t>(axis)];
    if (codes.exact)
      for (const std::uint64_t code : of_axis) inside = inside && std::isfinite(coordinate_of(codes, axis, code));
    const auto [low, high] = codes.range(axis, 0, of_axis.size());
    inside = inside && low - cube.origin[axis] >= least && high - cube.origin[axis] <= most;
  }
  return inside;
}

// Unpacks points that lie within `margin` edges of the cube, and their stated error.
Status unpack_points(const ChunkEntry& entry, std::span<const std::byte> packed, std::size_t points, const Cube& cube,
                     double margin, std::string_view what, PositionCodes& out) {
  SPLATVOL_TRY_ASSIGN(payload, unpack_payload(entry, packed, what));
  SPLATVOL_TRY_ASSIGN(header, check_position_header(payload, points, cube.edge, what));
  auto planes = payload.subspan(sizeof(PositionHeader));
  out.exact = header.form == form_exact;
  out.origin = {header.origin[0], header.origin[1], header.origin[2]};
  out.quantisation_step = header.quantisation_step;
  out.error = header.error;
  for (std::size_t axis = 0; axis < 3; ++axis)
    planes = take_planes(planes, out.axes[axis], points, out.exact ? sizeof(double) : header.width[axis]);
  if (!are_inside(out, cube, margin))
    return fail(ErrorCode::invalid_data, "{}: a point lies outside of the cube [R17]", what);
  return {};
}

Status unpack_points(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<dvec3> out, const Cube& cube,
                     double margin, std::string_view what) {
  PositionCodes codes;
  SPLATVOL_TRY(unpack_points(entry, packed, out.size(), cube, margin, what, codes));
  for (int axis = 0; axis < 3; ++axis)
    for (std::size_t i = 0; i < out.size(); ++i)
      out[i][axis] = coordinate_of(codes, axis, codes.axes[static_cast<std::size_t>(axis)][i]);
  return {};
}

}  // namespace

std::pair<double, double> PositionCodes::range(int axis, std::size_t begin, std::size_t end) const {
  const auto codes = std::span(axes[static_cast<std::size_t>(axis)]).subspan(begin, end - begin);
  double low = std::numeric_limits<double>::infinity(), high = -low;
  if (codes.empty()) return {low, high};
  if (exact) {
    for (const std::uint64_t code : codes) {
      low = std::min(low, std::bit_cast<double>(code));
      high = std::max(high, std::bit_cast<double>(code));
    }
    return {low, high};
  }
  std::int64_t least = std::numeric_limits<std::int64_t>::max(), largest = 0;  // codes have at most 7 bytes
  for (const std::uint64_t code : codes) {
    least = std::min(least, static_cast<std::int64_t>(code));
    largest = std::max(largest, static_cast<std::int64_t>(code));
  }
  return {coordinate_of(*this, axis, static_cast<std::uint64_t>(least)),
          coordinate_of(*this, axis, static_cast<std::uint64_t>(largest))};
}

Status unpack_vertices(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<dvec3> out,
                       const Cube& cube, std::string_view what) {
  return unpack_points(entry, packed, out, cube, vertex_margin, what);
}

Status unpack_positions(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<dvec3> out,
                        const Cube& cube, std::string_view what) {
  return unpack_points(entry, packed, out, cube, 0, what);
}

Status unpack_centroids(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<dvec3> out,
                        const Cube& cube, std::string_view what) {
  return unpack_points(entry, packed, out, cube, centroid_margin, what);
}

Status unpack_position_codes(const ChunkEntry& entry, std::span<const std::byte> packed, std::size_t points,
                             const Cube& cube, std::string_view what, PositionCodes& out) {
  return unpack_points(entry, packed, points, cube, 0, what, out);
}

Status unpack_centroid_codes(const ChunkEntry& entry, std::span<const std::byte> packed, std::size_t points,
                             const Cube& cube, std::string_view what, PositionCodes& out) {
  return unpack_points(entry, packed, points, cube, centroid_margin, what, out);
}

Status unpack_values(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<float> out,
                     std::string_view what) {
  SPLATVOL_TRY(unpack_values_and_error(entry, packed, out, what));
  return {};
}

Result<double> unpack_values_and_error(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<float> out,
                                       std::string_view what) {
  SPLATVOL_TRY_ASSIGN(payload, unpack_payload(entry, packed, what));
  if (payload.size() < sizeof(ValueHeader)) return fail(ErrorCode::invalid_data, "{}: payload too short [R17]", what);
  const auto header = read_record<ValueHeader>(payload, 0);
  const bool grid = header.form == form_grid;
  const bool valid = (grid ? header.width <= 3 : header.form == form_exact && header.width == sizeof(float)) &&
                     std::ranges::all_of(header.zero, [](std::uint8_t byte) { return byte == 0; }) &&
                     std::isfinite(header.origin) && header.quantisation_step >= 0 &&
                     std::isfinite(header.quantisation_step);
  if (!valid || payload.size() != sizeof(ValueHeader) + out.size() * header.width)
    return fail(ErrorCode::invalid_data, "{}: bad header of values [R17]", what);
  const auto planes = payload.subspan(sizeof(ValueHeader));
  if (grid)
    read_values_on_grid(header, planes, out);
  else
    read_planes<float>(planes, out);
  std::uint32_t outside = 0;  // an integer, so that compilers make vectors of the loop
  for (const float value : out)
    outside |= static_cast<std::uint32_t>(value < entry.min) | static_cast<std::uint32_t>(value > entry.max);
  if (outside != 0)
    return fail(ErrorCode::invalid_data, "{}: a value is out of the range that its chunk states [R17]", what);
  return error_of(header);
}

Status unpack_octants(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<std::uint8_t> depths,
                      std::span<std::uint8_t> counts, std::string_view what) {
  SPLATVOL_TRY_ASSIGN(payload, unpack_payload(entry, packed, what));
  if (payload.size() != depths.size() + counts.size())
    return fail(ErrorCode::invalid_data, "{}: wrong payload size [R17]", what);
  read_planes(payload, depths);
  read_planes(payload.subspan(depths.size()), counts);
  if (std::ranges::max(depths) > max_octant_depth || std::ranges::min(counts) == 0)
    return fail(ErrorCode::invalid_data, "{}: octant depth or count out of range [R17]", what);
  return {};
}

}  // namespace splatvol::format
