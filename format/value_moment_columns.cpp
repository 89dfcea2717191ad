// The columns of the values of each splat: `value_moments`, `gradient`.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <vector>

#include "format/codes.h"
#include "format/payload.h"
#include "format/stored_value.h"

namespace splatvol::format {
namespace {

// A mean is stored in steps as long as a share of its own deviation, from the mean before it. Rounding moves it by at
// most half a step; the rest is rounding of double precision.
constexpr double rounding_error = 0.51;
constexpr std::uint8_t form_steps = 1;
constexpr std::uint8_t form_exact = 2;
constexpr double steps_per_deviation = 8;
constexpr double most_steps = 1 << 23;  // codes then have three bytes
constexpr int codes_per_octave_of_value = 8;
constexpr double correlation_scale = 15;

// How far some of the material's values may be from its mean (spec R22): the standard deviation, a code of it, and half
// a step of the mean; besides, a share of the mean.
constexpr double deviations_of_interval = 1.16;
constexpr double interval_rounding = 1e-6;

// Deviations of values: 0 if the code is 0, else scale 2^((1 - code) / 8).
class ValueDeviations {
 public:
  static constexpr unsigned largest_code = 65535;

  explicit ValueDeviations(double scale) : log_scale_(std::log2(scale)), shares_(scaled(scale)) {}

  [[nodiscard]] unsigned encode(double deviation) const {
    if (!(deviation > 0)) return 0;
    const double octaves = log_scale_ - std::log2(deviation);
    return 1 + static_cast<unsigned>(
                   std::clamp<std::int64_t>(nearest_integer(codes_per_octave_of_value * octaves), 0, largest_code - 1));
  }
  [[nodiscard]] double operator()(unsigned code) const {
    if (code == 0) return 0;
    constexpr unsigned exponent_bias = 1023, mantissa_bits = 52;
    const unsigned below = code - 1, octaves = below / codes_per_octave_of_value;
    const double share = shares_[below % codes_per_octave_of_value];
    if (octaves >= exponent_bias) return std::ldexp(share, -static_cast<int>(octaves));
    return share * std::bit_cast<double>(std::uint64_t{exponent_bias - octaves} << mantissa_bits);
  }

 private:
  using Shares = std::array<double, codes_per_octave_of_value>;
  static Shares make_shares() {
    Shares shares;
    for (int k = 0; k < codes_per_octave_of_value; ++k) shares[k] = std::exp2(-k / double{codes_per_octave_of_value});
    return shares;
  }
  static Shares scaled(double scale) {
    static const Shares shares = make_shares();
    Shares result;
    for (int k = 0; k < codes_per_octave_of_value; ++k) result[k] = scale * shares[k];
    return result;
  }

  double log_scale_;
  Shares shares_;
};

double step_of(const ValueMomentsHeader& header, double deviation) {
  return std::max(header.least_step, deviation / steps_per_deviation);
}

// Returns the length of the range of values; 0 if there is none. No deviation and no least step is larger.
double length_of(float min, float max) { return min <= max ? double{max} - double{min} : 0; }

// Values as they are encoded. Leaves out those of material without a value, and moves means into the range of a
// summary: otherwise rounding could put a mean where a transfer function is not expected to show it. Bounds deviations
// by the length of the range.
template <class Value>
class PresentValues {
 public:
  PresentValues(std::span<const Value> values, const ValueSummary& summary)
      : values_(values), min_(summary.min), max_(summary.max), length_(length_of(summary.min, summary.max)) {}

  [[nodiscard]] std::size_t size() const { return values_.size(); }
  [[nodiscard]] bool has(std::size_t i) const { return values_[i].coverage > 0; }
  [[nodiscard]] double mean(std::size_t i) const { return std::max(min_, std::min<double>(values_[i].mean, max_)); }
  [[nodiscard]] double deviation(std::size_t i) const {
    return has(i) ? std::min<double>(values_[i].deviation, length_) : 0;
  }
  [[nodiscard]] double correlation(std::size_t i, int axis) const { return has(i) ? values_[i].correlation[axis] : 0; }
  [[nodiscard]] double coverage(std::size_t i) const { return has(i) ? values_[i].coverage : 0; }

 private:
  std::span<const Value> values_;
  double min_, max_, length_;
};

// Encodes each mean as the number of steps from the mean before it, as a reader decodes that one. Returns false, and
// then leaves anything in `codes`, if the means are too far from each other for their steps.
template <class Value>
bool encode_steps(const PresentValues<Value>& values, std::span<const double> deviations, ValueMomentsHeader& header,
                  std::span<std::uint32_t> codes) {
  std::size_t i = 0;
  while (i < values.size() && !values.has(i)) ++i;
  header.form = form_steps;
  header.origin = i == values.size() ? 0 : values.mean(i);
  double last = header.origin;
  std::uint32_t all_bits = 0;
  for (; i < values.size(); ++i) {
    codes[i] = 0;
    if (!values.has(i)) continue;
    const double mean = values.mean(i), rise = mean - last;
    if (rise == 0) continue;
    const double step = step_of(header, deviations[i]);
    const double steps = rise / step;
    if (!(std::abs(steps) < most_steps)) return false;
    const std::int64_t number = nearest_integer(steps);
    last += step * static_cast<double>(number);
    if (!(std::abs(mean - last) <= rounding_error * step)) return false;
    codes[i] = static_cast<std::uint32_t>(zigzag(number));
    all_bits |= codes[i];
  }
  header.width = static_cast<std::uint8_t>((std::bit_width(all_bits) + 7) / 8);
  return true;
}

// Encodes means in single precision, so that they come back as near as values do.
template <class Value>
void encode_exact(const PresentValues<Value>& values, ValueMomentsHeader& header, std::span<std::uint32_t> codes) {
  header.form = form_exact;
  header.origin = 0;
  header.width = sizeof(float);
  for (std::size_t i = 0; i < values.size(); ++i)
    codes[i] = values.has(i) ? std::bit_cast<std::uint32_t>(static_cast<float>(values.mean(i))) : 0;
}

// Encodes deviations. Fills `decoded` with the deviations as they come back.
template <class Value>
std::vector<std::uint16_t> encode_deviations(const PresentValues<Value>& values, ValueMomentsHeader& header,
                                             std::span<double> decoded) {
  for (std::size_t i = 0; i < values.size(); ++i)
    header.deviation_scale = std::max(header.deviation_scale, values.deviation(i));
  const ValueDeviations deviation(header.deviation_scale);
  std::vector<std::uint16_t> codes(values.size());
  unsigned largest = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    codes[i] = static_cast<std::uint16_t>(deviation.encode(values.deviation(i)));
    decoded[i] = deviation(codes[i]);
    largest = std::max<unsigned>(largest, codes[i]);
  }
  header.deviation_width = largest > 255 ? 2 : largest > 0 ? 1 : 0;
  return codes;
}

std::int8_t signed_code(double number) { return static_cast<std::int8_t>(nearest_integer(127 * number)); }

std::int8_t correlation_code(double number) {
  return static_cast<std::int8_t>(nearest_integer(correlation_scale * number));
}

std::uint8_t share_code(double number) { return static_cast<std::uint8_t>(nearest_integer(255 * number)); }

bool is_valid(const ValueMomentsHeader& header, const ChunkEntry& entry, std::size_t payload_bytes,
              std::size_t points) {
  const double length = length_of(entry.min, entry.max);
  const bool steps = header.form == form_steps && header.width <= 3;
  const bool exact = header.form == form_exact && header.width == sizeof(float);
  return (steps || exact) && header.deviation_width <= 2 && header.least_step <= length &&
         header.deviation_scale <= length && std::isfinite(header.origin) && is_scale(header.least_step) &&
         is_scale(header.deviation_scale) && all_zero(header.zero) &&
         payload_bytes == sizeof(ValueMomentsHeader) + points * (header.width + header.deviation_width + 4U);
}

// Whether a mean lies in [low, high], but for the error of its form.
bool is_bounded(double mean, double low, double high, double error) {
  return std::isfinite(mean) && low - mean <= error && mean - high <= error;
}

// Decodes the means, one after the other. Returns whether they are within [min, max] of the chunk.
bool decode_means(const ValueMomentsHeader& header, const ChunkEntry& entry, std::span<const std::uint32_t> codes,
                  ValueMomentCodes& out) {
  const auto low = static_cast<double>(entry.min), high = static_cast<double>(entry.max);
  const ValueDeviations deviation(header.deviation_scale);
  double last = header.origin;
  bool valid = true;
  for (std::size_t i = 0; i < codes.size(); ++i) {
    double error = 0;
    if (header.form == form_exact) {
      last = double{std::bit_cast<float>(codes[i])};
    } else {
      const double step = step_of(header, deviation(out.deviations[i]));
      last += step * static_cast<double>(unzigzag(codes[i]));
      error = rounding_error * step;
    }
    out.means[i] = last;
    valid = valid && std::isfinite(last) && (out.coverages[i] == 0 || is_bounded(last, low, high, error));
  }
  return valid;
}

bool are_correlations(const ValueMomentCodes& codes) {
  int largest = 0;
  for (const std::vector<std::int8_t>& axis : codes.correlations)
    for (const std::int8_t code : axis) largest = std::max(largest, std::abs(int{code}));
  return largest <= static_cast<int>(correlation_scale);
}

template <class Value>
PackedChunk pack(const PresentValues<Value>& values, double least_step, const ValueSummary& summary) {
  ValueMomentsHeader header{};
  header.least_step = std::min(least_step, length_of(summary.min, summary.max));
  std::vector<double> decoded(values.size());
  const std::vector<std::uint16_t> deviations = encode_deviations(values, header, decoded);
  std::vector<std::uint32_t> means(values.size());
  if (!encode_steps(values, decoded, header, means)) encode_exact(values, header, means);
  PlanesOf<std::int8_t, 3> correlations(values.size());
  PlanesOf<std::uint8_t, 1> coverages(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    for (int k = 0; k < 3; ++k) correlations[k][i] = correlation_code(values.correlation(i, k));
    coverages[0][i] = std::max(share_code(values.coverage(i)), static_cast<std::uint8_t>(values.has(i)));
  }

  Payload payload;
  append_record(payload.bytes, header);
  payload.add(means, header.width, header.form == form_exact ? 1 : sizeof(std::uint32_t));
  payload.add(deviations, header.deviation_width);
  payload.end_block();
  correlations.append_to(payload);
  coverages.append_to(payload);
  return pack_payload(payload, summary);
}

}  // namespace

PackedChunk pack_value_moments(std::span<const SplatValue> values, double least_step, const ValueSummary& summary) {
  return pack(PresentValues(values, summary), least_step, summary);
}

PackedChunk pack_value_moments(std::span<const StoredValue> values, double least_step, const ValueSummary& summary) {
  return pack(PresentValues(values, summary), least_step, summary);
}

PackedChunk pack_gradients(std::span<const vec3> directions) {
  PlanesOf<std::int8_t, 3> codes(directions.size());
  for (std::size_t i = 0; i < directions.size(); ++i) {
    const dvec3 d(directions[i]);  // squares of floats may overflow or vanish in single precision
    const double length = glm::length(d);
    if (!(length > 0 && std::isfinite(length))) continue;
    for (int k = 0; k < 3; ++k) codes[k][i] = signed_code(d[k] / length);
  }
  Payload payload;
  for (int k = 0; k < 3; ++k) {
    payload.add(codes.field(k));
    payload.end_block();
  }
  return pack_payload(payload);
}

Status unpack_value_moment_codes(const ChunkEntry& entry, std::span<const std::byte> packed, std::size_t points,
                                 std::string_view what, ValueMomentCodes& out) {
  SPLATVOL_TRY_ASSIGN(payload, unpack_payload(entry, packed, what));
  SPLATVOL_TRY_ASSIGN(header, read_header<ValueMomentsHeader>(payload, what));
  if (!is_valid(header, entry, payload.size(), points))
    return fail(ErrorCode::invalid_data, "{}: bad header of value moments [R17]", what);
  out.deviation_scale = header.deviation_scale;
  out.least_step = header.form == form_steps ? header.least_step : 0;
  thread_local std::vector<std::uint32_t> means;
  auto planes = take_planes(payload.subspan(sizeof(ValueMomentsHeader)), means, points, header.width);
  planes = take_planes(planes, out.deviations, points, header.deviation_width);
  for (std::vector<std::int8_t>& correlations : out.correlations) planes = take_planes(planes, correlations, points);
  take_planes(planes, out.coverages, points);
  out.means.resize(points);
  if (!decode_means(header, entry, means, out) || !are_correlations(out))
    return fail(ErrorCode::invalid_data, "{}: a mean or a correlation is out of range [R17]", what);
  return {};
}

Status unpack_value_moments(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<SplatValue> out,
                            std::string_view what) {
  ValueMomentCodes codes;
  SPLATVOL_TRY(unpack_value_moment_codes(entry, packed, out.size(), what, codes));
  const ValueDeviations deviation(codes.deviation_scale);
  for (std::size_t i = 0; i < out.size(); ++i) {
    const auto& c = codes.correlations;
    const dvec3 correlation = dvec3(c[0][i], c[1][i], c[2][i]) / correlation_scale;
    out[i] = {codes.means[i], deviation(codes.deviations[i]), correlation,
              std::sqrt(std::max(0.0, 1 - squared_length(correlation))), static_cast<double>(codes.coverages[i]) / 255};
  }
  return {};
}

Status unpack_value_intervals(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<ValueInterval> out,
                              std::string_view what) {
  thread_local ValueMomentCodes codes;
  SPLATVOL_TRY(unpack_value_moment_codes(entry, packed, out.size(), what, codes));
  const ValueDeviations deviation(codes.deviation_scale);
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] = {};
    if (codes.coverages[i] == 0) continue;
    const double mean = codes.means[i];
    const double reach = deviations_of_interval * deviation(codes.deviations[i]) + rounding_error * codes.least_step +
                         interval_rounding * std::abs(mean);
    out[i] = {static_cast<float>(std::max(mean - reach, double{entry.min})),
              static_cast<float>(std::min(mean + reach, double{entry.max}))};
  }
  return {};
}

Status unpack_gradient_codes(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<std::uint32_t> out,
                             std::string_view what) {
  SPLATVOL_TRY_ASSIGN(payload, unpack_payload(entry, packed, what));
  if (payload.size() != 3 * out.size()) return fail(ErrorCode::invalid_data, "{}: wrong payload size [R17]", what);
  if (std::ranges::find(payload, std::byte{0x80}) != payload.end())  // -128
    return fail(ErrorCode::invalid_data, "{}: a gradient is out of range [R17]", what);
  read_planes<std::uint32_t>(payload, out, 3);
  return {};
}

Status unpack_gradients(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<vec3> out,
                        std::string_view what) {
  std::vector<std::uint32_t> codes(out.size());
  SPLATVOL_TRY(unpack_gradient_codes(entry, packed, codes, what));
  const auto component = [](std::uint32_t code, int k) { return static_cast<std::int8_t>(code >> 8 * k); };
  for (std::size_t i = 0; i < out.size(); ++i)
    out[i] = vec3(component(codes[i], 0), component(codes[i], 1), component(codes[i], 2)) / 127.0F;
  return {};
}

}  // namespace splatvol::format
