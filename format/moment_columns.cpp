// The column of the shape of each splat: `moments`.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <vector>

#include "format/codes.h"
#include "format/payload.h"
#include "splat/log_code.h"

namespace splatvol::format {
namespace {

// --- Vectors: one number for each of several splats.

constexpr std::size_t lanes = 4;
using Lanes [[gnu::vector_size(lanes * sizeof(double))]] = double;
using LaneBits [[gnu::vector_size(lanes * sizeof(double))]] = std::uint64_t;
using Mask [[gnu::vector_size(lanes * sizeof(double))]] = std::int64_t;

inline Lanes at_least(double low, const Lanes& x) { return x < low ? Lanes{} + low : x; }
inline Lanes at_most(double high, const Lanes& x) { return x > high ? Lanes{} + high : x; }
inline Lanes larger(const Lanes& x, const Lanes& y) { return x > y ? x : y; }
inline Lanes magnitude(const Lanes& x) { return std::bit_cast<Lanes>(std::bit_cast<LaneBits>(x) << 1 >> 1); }
inline Lanes root(Lanes x) {
  for (std::size_t l = 0; l < lanes; ++l) x[l] = std::sqrt(x[l]);
  return x;
}
inline bool any(const Mask& mask) { return (mask[0] | mask[1] | mask[2] | mask[3]) != 0; }

// Doubles this large are integers.
constexpr double integers = 0x1.8p52;
inline Lanes rounded(const Lanes& x) { return (x + integers) - integers; }
inline LaneBits nearest_integers(const Lanes& x) {
  return std::bit_cast<LaneBits>(x + integers) - std::bit_cast<std::uint64_t>(integers);
}

// --- Log codes (splat/log_code.h), many at a time.

// Returns the logarithm to base 2 within 1e-8; exact for powers of two. Inline, unlike the library's. Requires normal
// numbers.
inline Lanes normal_log2(const Lanes& numbers) {
  constexpr unsigned mantissa_bits = 52;
  constexpr std::uint64_t root = std::bit_cast<std::uint64_t>(0.5 * std::numbers::sqrt2);
  constexpr std::uint64_t bias = 1024;
  // number = mantissa 2^exponent with sqrt(1/2) <= mantissa < sqrt(2), and ln(mantissa) = 2 artanh(s).
  const auto bits = std::bit_cast<LaneBits>(numbers);
  const LaneBits exponent = (bits - root) >> mantissa_bits << mantissa_bits;
  const Lanes mantissa = std::bit_cast<Lanes>(bits - exponent);
  const LaneBits octaves = (exponent + (bias << mantissa_bits)) >> mantissa_bits;
  const Lanes s = (mantissa - 1) / (mantissa + 1), x = s * s;
  const Lanes series = 1 + x * (1.0 / 3 + x * (1.0 / 5 + x * (1.0 / 7 + x * (1.0 / 9))));
  constexpr double above = 0x1p52;  // from here on, neighbouring doubles differ by 1
  return std::bit_cast<Lanes>(octaves | std::bit_cast<std::uint64_t>(above)) - (above + bias) +
         2 * std::numbers::log2e * s * series;
}

constexpr double least_normal = std::numeric_limits<double>::min();

inline double fast_log2(double number) {
  return number >= least_normal ? normal_log2(Lanes{} + number)[0] : std::log2(number);
}

class LogEncoder {
 public:
  explicit LogEncoder(double scale) : log_scale_(fast_log2(scale)) {}

  [[nodiscard]] LaneBits operator()(const Lanes& numbers) const {
    Lanes logs = normal_log2(numbers);
    if (any((numbers > 0) & (numbers < least_normal)))
      for (std::size_t l = 0; l < lanes; ++l) logs[l] = fast_log2(numbers[l]);
    const Lanes code = largest_log_code + log_codes_per_octave * (logs - log_scale_);
    return numbers > 0 ? nearest_integers(at_least(1, at_most(largest_log_code, code))) : LaneBits{};
  }

 private:
  double log_scale_;
};

class LogCodes {
 public:
  explicit LogCodes(double scale) : scale_(scale) {}

  double operator()(unsigned code) const {
    static_assert((largest_log_code + 1) % log_codes_per_octave == 0);
    constexpr unsigned octaves = (largest_log_code + 1) / log_codes_per_octave;
    constexpr unsigned exponent_bias = 1023, mantissa_bits = 52;
    const unsigned above = code + 1;
    const std::uint64_t exponent = exponent_bias - octaves + above / log_codes_per_octave;
    return code == 0
               ? 0
               : scale_ * (roots_[above % log_codes_per_octave] * std::bit_cast<double>(exponent << mantissa_bits));
  }

 private:
  using Roots = std::array<double, log_codes_per_octave>;
  static Roots make_roots() {
    Roots roots;
    for (unsigned k = 0; k < log_codes_per_octave; ++k) roots[k] = std::exp2(k / double{log_codes_per_octave});
    return roots;
  }
  static const Roots& roots() {
    static const Roots roots = make_roots();
    return roots;
  }

  const Roots& roots_ = roots();
  double scale_;
};

// --- Orientations: the index of the quaternion's largest component, and the other three components.

constexpr int min_orientation_width = 3;  // bytes
constexpr int max_orientation_width = 8;
constexpr double largest_component = 0.5 * std::numbers::sqrt2;  // that one of the other three can be
constexpr double tilt_tolerance = 1.0 / 16;

int bits_of_component(int width) { return (8 * width - 2) / 3; }

// Returns the code of zero. Zero has a code, so that axes that are the coordinate axes come back exactly.
std::int64_t middle_code(int bits) { return (std::int64_t{1} << (bits - 1)) - 1; }

glm::dquat orientation_of(std::uint64_t code, int bits) {
  const std::int64_t middle = middle_code(bits), mask = (std::int64_t{1} << bits) - 1;
  const double quantisation_step = largest_component / static_cast<double>(middle);
  const auto component = [&](int k) {
    return quantisation_step * static_cast<double>((static_cast<std::int64_t>(code >> (2 + k * bits)) & mask) - middle);
  };
  const double a = component(0), b = component(1), c = component(2);
  const double squares = a * a + b * b + c * c;
  const double rest = std::sqrt(std::max(0.0, 1 - squares));
  const std::uint64_t largest = code & 3;
  const double x = largest == 0 ? rest : a;
  const double y = largest == 0 ? a : largest == 1 ? rest : b;
  const double z = largest == 3 ? c : largest == 2 ? rest : b;
  const double w = largest == 3 ? rest : c;
  return glm::dquat(w, x, y, z) * (1 / std::sqrt(std::max(1.0, squares)));
}

// The largest mass in a file (spec 8): 2^64 cubes of the edge.
double largest_mass_of(double edge) { return 0x1p64 * edge * edge * edge; }

// Shapes, one vector for each of their numbers.
struct ShapeLanes {
  Lanes x, y, z, w;  // orientations
  Lanes deviations[3], mass;

  // Takes the first four, within the bounds of a file. If there are fewer, repeats the last.
  ShapeLanes(std::span<const SplatShape> shapes, double edge) {
    const std::size_t last = shapes.size() - 1;
    const SplatShape &a = shapes[0], &b = shapes[std::min<std::size_t>(1, last)],
                     &c = shapes[std::min<std::size_t>(2, last)], &d = shapes[std::min<std::size_t>(3, last)];
    const auto gather = [&](const auto& number_of) {
      return Lanes{number_of(a), number_of(b), number_of(c), number_of(d)};
    };
    x = gather([](const SplatShape& shape) { return shape.orientation.x; });
    y = gather([](const SplatShape& shape) { return shape.orientation.y; });
    z = gather([](const SplatShape& shape) { return shape.orientation.z; });
    w = gather([](const SplatShape& shape) { return shape.orientation.w; });
    for (int k = 0; k < 3; ++k)
      deviations[k] = at_most(edge, gather([k](const SplatShape& shape) { return shape.deviations[k]; }));
    mass = at_most(largest_mass_of(edge), gather([](const SplatShape& shape) { return shape.mass; }));
  }
};

// Encodes orientations. Returns whether rounding keeps to the tolerance: whether the end of each axis, as
// orientation_of decodes it, moves towards a shorter axis by at most `tilt_tolerance` of the shorter deviation.
bool encode_orientations(const ShapeLanes& shapes, int bits, LaneBits& codes) {
  const auto middle = static_cast<double>(middle_code(bits));
  const Lanes &qx = shapes.x, &qy = shapes.y, &qz = shapes.z, &qw = shapes.w;
  const Lanes x = magnitude(qx), y = magnitude(qy), z = magnitude(qz), w = magnitude(qw);
  const Mask late = larger(z, w) > larger(x, y), odd = late ? w > z : y > x;
  const Mask is_x = ~late & ~odd, is_y = ~late & odd, is_z = late & ~odd, is_w = late & odd;  // the largest
  const Lanes left_out = late ? (odd ? qw : qz) : (odd ? qy : qx);
  const Lanes scale = middle / (left_out < 0 ? Lanes{} - largest_component : Lanes{} + largest_component);
  const auto in_steps = [&](const Lanes& component) {
    return at_least(-middle, at_most(middle, rounded(component * scale)));
  };
  const Lanes first = in_steps(is_x ? qy : qx), second = in_steps(late ? qy : qz), third = in_steps(is_w ? qz : qw);
  const auto field = [&](const Lanes& number, int k) { return nearest_integers(number + middle) << (2 + k * bits); };
  codes = std::bit_cast<LaneBits>((late & 2) | (odd & 1)) | field(first, 0) | field(second, 1) | field(third, 2);

  const double quantisation_step = largest_component / middle;
  const Lanes a = quantisation_step * first, b = quantisation_step * second, c = quantisation_step * third;
  const Lanes squares = a * a + b * b + c * c;
  const Lanes rest = root(at_least(0, 1 - squares)), factor = 1 / root(at_least(1, squares));
  const Lanes sx = factor * (is_x ? rest : a), sy = factor * (is_x ? a : is_y ? rest : b);
  const Lanes sz = factor * (is_w ? c : is_z ? rest : b), sw = factor * (is_w ? rest : c);
  // The angles of the turn from q to s about the axes of q: twice the vector part of conjugate(q) s.
  const Lanes tx = 2 * magnitude(qw * sx - qx * sw - qy * sz + qz * sy);
  const Lanes ty = 2 * magnitude(qw * sy - qy * sw - qz * sx + qx * sz);
  const Lanes tz = 2 * magnitude(qw * sz - qz * sw - qx * sy + qy * sx);
  const auto& d = shapes.deviations;
  return !any(~((tz * d[0] <= tilt_tolerance * d[1]) & (ty * d[0] <= tilt_tolerance * d[2]) &
                (tx * d[1] <= tilt_tolerance * d[2])));
}

// --- Boundaries and densities.

constexpr double boundary_scale = 128;
constexpr int largest_boundary_code = 511;

// Codes move the foot of a boundary by less than the rest of the edge.
constexpr double largest_foot = 0.95;  // edges, from the centroid, of a writer
constexpr double densities_per_octave = 32;
constexpr int density_one = 128;

std::int16_t boundary_code(double foot) {
  return static_cast<std::int16_t>(
      std::clamp<std::int64_t>(nearest_integer(foot * boundary_scale), -largest_boundary_code, largest_boundary_code));
}

std::uint8_t density_code(double density) {
  if (density == 1) return density_one;  // the usual case if no densities were fitted
  const double code = density_one + densities_per_octave * std::log2(density);
  return static_cast<std::uint8_t>(nearest_integer(std::clamp(code, 0.0, 255.0)));
}

std::array<double, 256> make_densities() {
  std::array<double, 256> densities;
  for (int code = 0; code < 256; ++code) densities[code] = std::exp2((code - density_one) / densities_per_octave);
  return densities;
}

// Encodes orientations with the fewest bytes each that keep all of them within the tolerance. Returns the bytes.
int encode_all_orientations(std::span<const SplatShape> shapes, double edge, std::span<std::uint64_t> orientations) {
  int width = min_orientation_width;
  for (std::size_t i = 0; i < shapes.size();) {
    LaneBits codes;
    const bool enough = encode_orientations(ShapeLanes(shapes.subspan(i), edge), bits_of_component(width), codes) ||
                        width == max_orientation_width;
    for (std::size_t l = 0; l < lanes && i + l < shapes.size(); ++l) orientations[i + l] = codes[l];
    i = enough ? i + lanes : 0;
    width += enough ? 0 : 1;
  }
  return width;
}

// Encodes masses and deviations. The mass is stored as a multiple of the product of the deviations, which varies little
// among splats of one form.
PlanesOf<std::uint16_t, 4> encode_sizes(std::span<const SplatShape> shapes, double edge, const MomentsHeader& header) {
  PlanesOf<std::uint16_t, 4> sizes(shapes.size());  // mass, deviations
  const LogEncoder mass_code(header.mass_scale), deviation_code(header.deviation_scale);
  for (std::size_t i = 0; i < shapes.size(); i += lanes) {
    const ShapeLanes numbers(shapes.subspan(i), edge);
    const LaneBits codes[3] = {deviation_code(numbers.deviations[0]), deviation_code(numbers.deviations[1]),
                               deviation_code(numbers.deviations[2])};
    const LaneBits mass = mass_code(numbers.mass) - codes[0] - codes[1] - codes[2];
    for (std::size_t l = 0; l < lanes && i + l < shapes.size(); ++l) {
      sizes[0][i + l] = static_cast<std::uint16_t>(mass[l]);
      for (int k = 0; k < 3; ++k) sizes[k + 1][i + l] = static_cast<std::uint16_t>(codes[k][l]);
    }
  }
  return sizes;
}

// Returns the boundary of a shape within the bounds of a file.
dvec3 boundary_within(const SplatShape& shape, double edge) {
  const double foot = glm::length(glm::min(shape.deviations, dvec3(edge)) * (shape.boundary / edge));
  return foot > largest_foot ? shape.boundary * (largest_foot / foot) : shape.boundary;
}

// The feet of boundaries, in deviations along the principal axes.
dvec3 foot_of(const MomentCodes& codes, std::size_t i) {
  return dvec3(codes.boundaries[0][i], codes.boundaries[1][i], codes.boundaries[2][i]) / boundary_scale;
}

// Returns the largest magnitude of the codes of boundaries.
int farthest_of(const MomentCodes& codes) {
  int least = 0, largest = 0;
  for (const std::vector<std::int16_t>& axis : codes.boundaries)
    for (const std::int16_t code : axis) {
      least = std::min<int>(least, code);
      largest = std::max<int>(largest, code);
    }
  return std::max(-least, largest);
}

bool do_descend(const MomentCodes& codes) {
  const auto& [first, second, third] = codes.deviations;
  unsigned ascending = 0;  // an integer, so that compilers make vectors of the loop
  for (std::size_t i = 0; i < first.size(); ++i)
    ascending |= static_cast<unsigned>(first[i] < second[i]) | static_cast<unsigned>(second[i] < third[i]);
  return ascending == 0;
}

// Whether no boundary is farther away than an edge.
bool are_near(const MomentCodes& codes, int farthest, double edge) {
  const LogCodes deviation(codes.deviation_scale);
  unsigned widest = 0;
  for (const std::uint16_t code : codes.deviations[0]) widest = std::max<unsigned>(widest, code);
  const double largest = deviation(widest);
  constexpr double safe = 0.5;  // of an edge: no point comes near it in most chunks
  if (std::numbers::sqrt3 * largest * farthest / boundary_scale <= safe * edge) return true;
  for (std::size_t i = 0; i < codes.masses.size(); ++i) {
    const dvec3 foot = foot_of(codes, i);
    if (foot == dvec3(0)) continue;
    const auto& d = codes.deviations;
    const dvec3 deviations(deviation(d[0][i]), deviation(d[1][i]), deviation(d[2][i]));
    if (!(squared_length(deviations * (foot / edge)) <= 1)) return false;
  }
  return true;
}

// Checks the bounds that the specification sets for the shapes of a file.
Status check_shapes(const MomentCodes& codes, double edge, std::string_view what) {
  if (!do_descend(codes)) return fail(ErrorCode::invalid_data, "{}: deviations do not descend [R17]", what);
  const int farthest = farthest_of(codes);
  if (farthest > largest_boundary_code)
    return fail(ErrorCode::invalid_data, "{}: a boundary is out of range [R17]", what);
  if (codes.deviation_scale > edge || codes.mass_scale > largest_mass_of(edge))
    return fail(ErrorCode::invalid_data, "{}: material larger than the cube [R17]", what);
  if (!are_near(codes, farthest, edge))
    return fail(ErrorCode::invalid_data, "{}: a boundary is farther away than an edge of the cube [R17]", what);
  return {};
}

}  // namespace

PackedChunk pack_moments(std::span<const SplatShape> shapes, double edge) {
  MomentsHeader header{};
  for (const SplatShape& shape : shapes) {
    header.mass_scale = std::max(header.mass_scale, shape.mass);
    header.deviation_scale = std::max(header.deviation_scale, shape.deviations[0]);
  }
  header.mass_scale = std::min(header.mass_scale, largest_mass_of(edge));
  header.deviation_scale = std::min(header.deviation_scale, edge);
  std::vector<std::uint64_t> orientations(shapes.size());
  const int width = encode_all_orientations(shapes, edge, orientations);
  header.orientation_width = static_cast<std::uint8_t>(width);
  PlanesOf<std::uint16_t, 4> sizes = encode_sizes(shapes, edge, header);
  PlanesOf<std::int16_t, 3> boundaries(shapes.size());
  PlanesOf<std::uint8_t, 1> densities(shapes.size());
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    if (shapes[i].boundary != dvec3(0)) {
      const dvec3 boundary = boundary_within(shapes[i], edge);
      for (int k = 0; k < 3; ++k) boundaries[k][i] = boundary_code(boundary[k]);
    }
    densities[0][i] = density_code(shapes[i].density);
  }

  Payload payload;
  payload.bytes.reserve(sizeof header + shapes.size() * (15 + static_cast<std::size_t>(width)));
  append_record(payload.bytes, header);
  payload.add_noisy(sizes.field(0));
  sizes.append_to(payload, 1);
  payload.end_block();
  payload.add_noisy(orientations, header.orientation_width);
  payload.end_block();
  boundaries.append_to(payload);
  densities.append_to(payload);
  return pack_payload(payload);
}

Status unpack_moment_codes(const ChunkEntry& entry, std::span<const std::byte> packed, std::size_t points, double edge,
                           std::string_view what, MomentCodes& out) {
  SPLATVOL_TRY_ASSIGN(payload, unpack_payload(entry, packed, what));
  SPLATVOL_TRY_ASSIGN(header, read_header<MomentsHeader>(payload, what));
  const std::size_t width = header.orientation_width;
  if (!is_scale(header.mass_scale) || !is_scale(header.deviation_scale) || width < min_orientation_width ||
      width > max_orientation_width || !all_zero(header.zero) ||
      payload.size() != sizeof(MomentsHeader) + points * (15 + width))
    return fail(ErrorCode::invalid_data, "{}: bad header of moments [R17]", what);

  out.mass_scale = header.mass_scale;
  out.deviation_scale = header.deviation_scale;
  out.component_bits = bits_of_component(header.orientation_width);
  auto planes = take_planes(payload.subspan(sizeof(MomentsHeader)), out.masses, points);
  for (std::vector<std::uint16_t>& deviations : out.deviations) {
    planes = take_planes(planes, deviations, points);
    for (std::size_t i = 0; i < points; ++i) out.masses[i] = static_cast<std::uint16_t>(out.masses[i] + deviations[i]);
  }
  planes = take_planes(planes, out.orientations, points, width);
  for (std::vector<std::int16_t>& boundary : out.boundaries) planes = take_planes(planes, boundary, points);
  take_planes(planes, out.densities, points);
  return check_shapes(out, edge, what);
}

Status unpack_moments(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<SplatShape> out,
                      double edge, std::string_view what) {
  MomentCodes codes;
  SPLATVOL_TRY(unpack_moment_codes(entry, packed, out.size(), edge, what, codes));
  const LogCodes mass(codes.mass_scale), deviation(codes.deviation_scale);
  static const std::array<double, 256> densities = make_densities();
  for (std::size_t i = 0; i < out.size(); ++i) {
    const auto& d = codes.deviations;
    out[i] = {mass(codes.masses[i]), dvec3(deviation(d[0][i]), deviation(d[1][i]), deviation(d[2][i])),
              orientation_of(codes.orientations[i], codes.component_bits), foot_of(codes, i),
              densities[codes.densities[i]]};
  }
  return {};
}

}  // namespace splatvol::format
