#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <random>

#include "format/columns.h"
#include "tests/support/random.h"
#include "tests/support/results.h"

namespace splatvol::test {
namespace {

using namespace format;
using testing::HasSubstr;

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();
constexpr double rounding = 1e-12;

// Half a quantisation step of a log code, with the rounding of double precision.
const double log_code_factor = std::exp2(1.0 / 256) * (1 + rounding);

// The edge of a cube that everything fits into.
constexpr double wide = 1e301;

constexpr auto unpack_shapes = [](const ChunkEntry& entry, std::span<const std::byte> packed, std::span<SplatShape> out,
                                  std::string_view what) { return unpack_moments(entry, packed, out, wide, what); };
constexpr auto unpack_signals = unpack_value_moments;

template <class Element, class Unpack>
std::vector<Element> unpacked(const PackedChunk& chunk, std::size_t count, Unpack unpack) {
  std::vector<Element> out(count);
  EXPECT_EQ(message_of(unpack(chunk.entry, chunk.bytes, out, "test")), "");
  return out;
}

Bytes payload_of(const PackedChunk& chunk) { return unpack(chunk.bytes, chunk.entry.unpacked_bytes, "test").value(); }

// Packs a payload as it is, as another writer or an attacker might.
PackedChunk with_payload(ChunkEntry entry, const Bytes& payload) {
  PackedChunk chunk{entry, pack(payload)};
  chunk.entry.hash = hash_bytes(chunk.bytes);
  chunk.entry.packed_bytes = static_cast<std::uint32_t>(chunk.bytes.size());
  chunk.entry.unpacked_bytes = static_cast<std::uint32_t>(payload.size());
  return chunk;
}

// Whether rule R17 refuses a chunk after a change to its header.
template <class Header, class Element, class Unpack>
bool refused(const PackedChunk& good, std::size_t count, Unpack unpack_column,
             const std::function<void(Header&, Bytes&)>& change) {
  Bytes payload = payload_of(good);
  auto header = read_record<Header>(payload, 0);
  payload.erase(payload.begin(), payload.begin() + sizeof(Header));
  change(header, payload);
  Bytes changed;
  append_record(changed, header);
  changed.insert(changed.end(), payload.begin(), payload.end());
  const PackedChunk chunk = with_payload(good.entry, changed);
  std::vector<Element> out(count);
  const Status status = unpack_column(chunk.entry, chunk.bytes, out, "test");
  if (!status) {
    EXPECT_THAT(status.error().message, HasSubstr("[R17]"));
  }
  return !status;
}

// Tries every shorter payload, and a longer one.
template <class Element, class Unpack>
void expect_exact_size(const PackedChunk& good, std::size_t count, Unpack unpack_column) {
  const Bytes payload = payload_of(good);
  std::vector<Element> out(count);
  for (std::size_t size = 0; size <= payload.size() + 3; ++size) {
    Bytes changed = payload;
    changed.resize(size);
    const PackedChunk chunk = with_payload(good.entry, changed);
    EXPECT_EQ(unpack_column(chunk.entry, chunk.bytes, out, "test").has_value(), size == payload.size()) << size;
  }
  Bytes flipped = good.bytes;
  flipped.back() ^= std::byte{1};
  EXPECT_EQ(unpack_column(good.entry, flipped, out, "chunk 3").error().message, "chunk 3: checksum mismatch");
}

// --- Shapes.

class Shapes {
 public:
  explicit Shapes(std::uint32_t seed) : random_(seed) {}

  double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_); }

  glm::dquat orientation() {
    std::normal_distribution<double> normal;
    return glm::normalize(random_quaternion(normal, random_));
  }

  SplatShape shape(double size, double middle_ratio, double short_ratio) {
    return {uniform(0.5, 2) * size * size * size, size * dvec3(1, middle_ratio, short_ratio), orientation(),
            dvec3(uniform(-2, 2), uniform(-2, 2), uniform(-2, 2)), uniform(0.1, 10)};
  }

  std::vector<SplatShape> shapes(std::size_t count, double size, double middle_ratio, double short_ratio) {
    std::vector<SplatShape> shapes(count);
    for (SplatShape& s : shapes) s = shape(size * uniform(0.1, 1), middle_ratio, short_ratio);
    return shapes;
  }

 private:
  std::mt19937_64 random_;
};

bool within_factor(double a, double b, double factor) {
  return (a == 0 && b == 0) || (a <= b * factor && b <= a * factor);
}

// Returns the largest movement of the end of an axis towards a shorter axis, as a share of the shorter deviation.
double worst_tilt(const SplatShape& in, const SplatShape& out) {
  const dmat3 before = glm::mat3_cast(in.orientation), after = glm::mat3_cast(out.orientation);
  double worst = 0;
  for (int k = 0; k < 3; ++k)
    for (int j = k + 1; j < 3; ++j)
      if (in.deviations[k] > 0)
        worst = std::max(worst, std::abs(glm::dot(after[k], before[j])) * in.deviations[k] / in.deviations[j]);
  return worst;
}

void expect_shapes_near(const std::vector<SplatShape>& in, double tilt = 1.0 / 16) {
  const PackedChunk chunk = pack_moments(in, wide);
  EXPECT_LE(chunk.entry.unpacked_bytes, 64 + 64 * in.size());  // R10
  EXPECT_EQ(chunk.entry.occupancy, 0u);
  const auto out = unpacked<SplatShape>(chunk, in.size(), unpack_shapes);
  for (std::size_t i = 0; i < in.size(); ++i) {
    EXPECT_TRUE(within_factor(in[i].mass, out[i].mass, log_code_factor)) << in[i].mass << " " << out[i].mass;
    for (int k = 0; k < 3; ++k)
      EXPECT_TRUE(within_factor(in[i].deviations[k], out[i].deviations[k], log_code_factor))
          << in[i].deviations[k] << " " << out[i].deviations[k];
    EXPECT_NEAR(glm::length(out[i].orientation), 1, rounding);
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(in[i].boundary[k], out[i].boundary[k], 1.0 / 256 + rounding);
    EXPECT_TRUE(within_factor(in[i].density, out[i].density, std::exp2(1.0 / 64) + rounding)) << in[i].density;
    // The tilt also has a term of second order in the angle. A tenth of the first covers it, up to the largest angle,
    // 1/16.
    EXPECT_LE(worst_tilt(in[i], out[i]), 1.1 * tilt) << in[i].deviations[0] / in[i].deviations[2];
  }
}

std::uint8_t orientation_width(const std::vector<SplatShape>& shapes) {
  return read_record<MomentsHeader>(payload_of(pack_moments(shapes, wide)), 0).orientation_width;
}

TEST(MomentsColumn, KeepsItsBoundsAtEveryAspectRatio) {
  Shapes random(1);
  for (const double ratio : {1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4})
    for (const double size : {1e-30, 1e-6, 1.0, 1e30}) {
      expect_shapes_near(random.shapes(200, size, 1, 1 / ratio));          // pancakes
      expect_shapes_near(random.shapes(200, size, 1 / ratio, 1 / ratio));  // needles
      expect_shapes_near(random.shapes(200, size, 1 / std::sqrt(ratio), 1 / ratio));
    }
}

TEST(MomentsColumn, NeedlesAndPancakesComeAsNearAsTwentyBitsReach) {
  // Each of three components is off by up to half a quantisation step of sqrt(1/2) / (2^19 - 1), the fourth by up to
  // the sum of the three. Together this is sqrt(12) halves, and twice that as an angle.
  const double angle = std::sqrt(12.0) * std::sqrt(0.5) / (0x1p19 - 1);
  Shapes random(2);
  for (const double ratio : {1e5, 1e8})
    for (const double middle : {1.0, 1 / ratio})
      expect_shapes_near(random.shapes(500, 1, middle, 1 / ratio), angle * ratio);
}

TEST(MomentsColumn, SpendsBitsOnlyWhereTheyTell) {
  Shapes random(3);
  int last = 2;
  for (const double ratio : {2.0, 20.0, 100.0, 600.0, 3e3, 2e4}) {
    const int width = orientation_width(random.shapes(1000, 1, 1 / ratio, 1 / ratio));
    EXPECT_EQ(width, last + 1) << ratio;
    last = width;
  }
  std::vector<SplatShape> balls = random.shapes(1000, 1, 1, 1);
  EXPECT_EQ(orientation_width(balls), 3);
  balls[700] = random.shape(1, 1e-3, 1e-3);
  EXPECT_GE(orientation_width(balls), 6);
  expect_shapes_near(balls);
}

TEST(MomentsColumn, AxesOfSpaceComeBackExactly) {
  std::vector<SplatShape> shapes(4, SplatShape{1, {1, 1e-4, 1e-8}, {}});
  shapes[0].orientation = {1, 0, 0, 0};
  shapes[1].orientation = {0, 1, 0, 0};
  shapes[2].orientation = {0, 0, -1, 0};
  shapes[3].orientation = {0, 0, 0, 1};
  EXPECT_EQ(orientation_width(shapes), 3);
  const auto out = unpacked<SplatShape>(pack_moments(shapes, wide), 4, unpack_shapes);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(std::abs(glm::dot(out[i].orientation, shapes[i].orientation)), 1);
}

TEST(MomentsColumn, EveryComponentMayBeTheLargestWithEitherSign) {
  const double half_step = 0.5 * std::sqrt(0.5) / 63;  // 7 bits, 3 bytes
  for (int largest = 0; largest < 4; ++largest)
    for (const double sign : {1.0, -1.0}) {
      std::vector<SplatShape> shapes(1, SplatShape{1, dvec3(1), {}});
      glm::dquat q(0.2, -0.3, 0.1, 0.25);
      q[largest] = sign;
      shapes[0].orientation = glm::normalize(q);
      const glm::dquat back = unpacked<SplatShape>(pack_moments(shapes, wide), 1, unpack_shapes)[0].orientation;
      // The same turn, with the largest component made positive.
      for (int k = 0; k < 4; ++k) EXPECT_NEAR(back[k], sign * shapes[0].orientation[k], 2 * half_step);
      EXPECT_GT(back[largest], 0);
    }
}

TEST(MomentsColumn, EqualComponentsComeBack) {
  Shapes random(4);
  std::vector<SplatShape> shapes;
  for (const double x : {-0.5, 0.5})
    for (const double y : {-0.5, 0.5})
      for (const double z : {-0.5, 0.5})
        for (const double ratio : {1.0, 1e2, 1e4}) {
          shapes.push_back(random.shape(1, 1 / ratio, 1 / ratio));
          shapes.back().orientation = {0.5, x, y, z};
        }
  for (const double x : {-1, 1}) {
    shapes.push_back(random.shape(1, 1e-2, 1e-4));
    shapes.back().orientation = glm::normalize(glm::dquat(0, 1, 0, x));
  }
  expect_shapes_near(shapes);
}

TEST(MomentsColumn, ZeroStaysZero) {
  Shapes random(5);
  std::vector<SplatShape> shapes = random.shapes(20, 1, 0.5, 0.1);
  shapes[3].mass = 0;
  shapes[4] = {};
  shapes[5].deviations = dvec3(0);
  shapes[6].deviations = {1, 1, 0};
  shapes[7].deviations = {1, 0, 0};
  const auto out = unpacked<SplatShape>(pack_moments(shapes, wide), shapes.size(), unpack_shapes);
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    EXPECT_TRUE(within_factor(shapes[i].mass, out[i].mass, log_code_factor)) << i;
    for (int k = 0; k < 3; ++k)
      EXPECT_TRUE(within_factor(shapes[i].deviations[k], out[i].deviations[k], log_code_factor)) << i;
    EXPECT_NEAR(glm::length(out[i].orientation), 1, rounding);
  }
  expect_shapes_near(std::vector<SplatShape>(1));
  expect_shapes_near(std::vector<SplatShape>(10, SplatShape{7, dvec3(0), {}}));
}

TEST(MomentsColumn, HoldsManyDecadesInOneChunk) {
  Shapes random(6);
  std::vector<SplatShape> shapes;
  for (int decade = -25; decade <= 25; ++decade)  // of masses, 150
    shapes.push_back(random.shape(std::pow(10, decade), 0.3, 0.1));
  expect_shapes_near(shapes);

  // Masses under 2^-511 of the largest all come back equal, and above 0.
  shapes = {{1e300, dvec3(1e300), {1, 0, 0, 0}}, {1e-300, dvec3(1e-300), {1, 0, 0, 0}}};
  const auto out = unpacked<SplatShape>(pack_moments(shapes, wide), 2, unpack_shapes);
  EXPECT_GT(out[1].mass, 0);
  EXPECT_LT(out[1].mass, 1e147);
  EXPECT_GT(out[1].deviations[2], 0);
}

TEST(MomentsColumn, OnePointIsExactButForItsOrientation) {
  Shapes random(7);
  for (const double size : {1e-30, 1.0, 1e30}) {
    const std::vector<SplatShape> one = {random.shape(size, 1, 1)};
    expect_shapes_near(one);
    const auto out = unpacked<SplatShape>(pack_moments(one, wide), 1, unpack_shapes);
    EXPECT_EQ(out[0].mass, one[0].mass);
    EXPECT_EQ(out[0].deviations[0], one[0].deviations[0]);
  }
}

TEST(MomentsColumn, RefusesBadHeaders) {
  Shapes random(8);
  const std::vector<SplatShape> shapes = random.shapes(10, 1, 0.9, 0.8);
  const PackedChunk good = pack_moments(shapes, wide);
  const auto refuses = [&](const std::function<void(MomentsHeader&, Bytes&)>& change) {
    return refused<MomentsHeader, SplatShape>(good, 10, unpack_shapes, change);
  };
  EXPECT_FALSE(refuses([](MomentsHeader&, Bytes&) {}));
  for (const double bad : {-1.0, infinity, -infinity, not_a_number}) {
    EXPECT_TRUE(refuses([bad](MomentsHeader& h, Bytes&) { h.mass_scale = bad; }));
    EXPECT_TRUE(refuses([bad](MomentsHeader& h, Bytes&) { h.deviation_scale = bad; }));
  }
  for (const int width : {0, 1, 2, 4, 9, 11, 255})
    EXPECT_TRUE(refuses([width](MomentsHeader& h, Bytes&) { h.orientation_width = static_cast<std::uint8_t>(width); }));
  for (const std::size_t width : {0, 1, 2, 9, 11, 255})  // some with enough planes
    EXPECT_TRUE(refuses([width](MomentsHeader& h, Bytes& planes) {
      h.orientation_width = static_cast<std::uint8_t>(width);
      planes.resize(10 * (8 + width));
    }));
  for (int i = 0; i < 7; ++i) EXPECT_TRUE(refuses([i](MomentsHeader& h, Bytes&) { h.zero[i] = 1; }));
  expect_exact_size<SplatShape>(good, 10, unpack_shapes);
}

TEST(MomentsColumn, RefusesDeviationsThatDoNotDescend) {
  for (const dvec3& deviations : {dvec3(1, 2, 0.5), dvec3(1, 0.5, 0.75), dvec3(0, 0, 1), dvec3(1, 0, 1)}) {
    std::vector<SplatShape> shapes(5, SplatShape{1, dvec3(2, 1, 0.5), {1, 0, 0, 0}});
    shapes[2].deviations = deviations;
    const PackedChunk chunk = pack_moments(shapes, wide);
    std::vector<SplatShape> out(5);
    EXPECT_THAT(unpack_moments(chunk.entry, chunk.bytes, out, wide, "test").error().message,
                HasSubstr("descend [R17]"));
  }
}

// The bytes of one point, whose planes are next to each other for every number.
template <class Header>
PackedChunk chunk_of_one(const Header& header, const std::vector<int>& bytes) {
  Bytes payload;
  append_record(payload, header);
  for (const int byte : bytes) payload.push_back(static_cast<std::byte>(byte));
  return with_payload({}, payload);
}

TEST(MomentsColumn, IsReadAsTheSpecificationSays) {
  // Deviation codes 65535, 65535 - 128, 65535 - 256. Mass code 65535 - 192, stored less these, modulo 2^16.
  const int mass = (65535 - 192) - (65535 + 65407 + 65279) + 2 * 65536;
  // The largest component is y (1); 7 bits each, 63 in the middle: x = sqrt(1/2) / 3, z = 0, w = -sqrt(1/2) / 7.
  const int orientation = 1 | (63 + 21) << 2 | 63 << 9 | (63 - 9) << 16 | 1 << 23;
  const PackedChunk chunk = chunk_of_one(MomentsHeader{8, 3, 3, {}},
                                         {mass & 255, mass >> 8, 255, 255, 127, 255, 255, 254, orientation & 255,
                                          orientation >> 8 & 255, orientation >> 16 & 255, 192, 0, 1, 254, 0, 0, 112});
  const SplatShape shape = unpacked<SplatShape>(chunk, 1, unpack_shapes)[0];
  EXPECT_NEAR(shape.mass, 8 / std::pow(2, 1.5), rounding);
  EXPECT_NEAR(glm::distance(shape.deviations, dvec3(3, 1.5, 0.75)), 0, rounding);
  const double x = std::sqrt(0.5) / 3, w = -std::sqrt(0.5) / 7;
  const glm::dquat expected(w, x, std::sqrt(1 - x * x - w * w), 0);
  for (int k = 0; k < 4; ++k) EXPECT_NEAR(shape.orientation[k], expected[k], rounding);
  EXPECT_EQ(shape.boundary, dvec3(1.5, -511 / 128.0, 0));
  EXPECT_NEAR(shape.density, std::sqrt(0.5), rounding);
}

TEST(MomentsColumn, ABoundaryOutOfRangeIsRefused) {
  for (const int code : {511, 512, -511, -512, 32767, -32768}) {
    std::vector<int> bytes(11 + 7);
    bytes[13] = code & 255;
    bytes[14] = code >> 8 & 255;
    std::vector<SplatShape> out(1);
    const PackedChunk chunk = chunk_of_one(MomentsHeader{1, 1, 3, {}}, bytes);
    EXPECT_EQ(unpack_moments(chunk.entry, chunk.bytes, out, wide, "chunk").has_value(), std::abs(code) <= 511) << code;
  }
}

TEST(MomentsColumn, WhatIsTooFarOrTooDenseIsClamped) {
  std::vector<SplatShape> shapes(2, SplatShape{1, dvec3(1), {1, 0, 0, 0}, dvec3(1e9, -5, 3), 1e9});
  shapes[1].density = 1e-9;
  const auto out = unpacked<SplatShape>(pack_moments(shapes, wide), 2, unpack_shapes);
  EXPECT_EQ(out[0].boundary, dvec3(511, -511, 384) / 128.0);
  EXPECT_GT(out[0].density, 15);
  EXPECT_EQ(out[1].density, 1.0 / 16);
}

TEST(MomentsColumn, RefusesWhatIsLargerThanTheCube) {
  const std::vector<SplatShape> shapes(5, SplatShape{1, dvec3(0.5, 0.4, 0.3), {1, 0, 0, 0}, dvec3(1, 1, 0)});
  const PackedChunk chunk = pack_moments(shapes, 1);
  std::vector<SplatShape> out(5);
  const auto message = [&](double edge) {
    const Status status = unpack_moments(chunk.entry, chunk.bytes, out, edge, "test");
    return status ? "" : status.error().message;
  };
  EXPECT_EQ(message(1), "");
  EXPECT_EQ(message(0.65), "");
  EXPECT_THAT(message(0.63), HasSubstr("farther away than an edge of the cube [R17]"));  // 0.64 away
  EXPECT_THAT(message(0.49), HasSubstr("larger than the cube [R17]"));
  EXPECT_THAT(message(1e-8), HasSubstr("larger than the cube [R17]"));
  const PackedChunk heavy = pack_moments(std::vector<SplatShape>(5, SplatShape{1e30, dvec3(0.1), {}}), 1e10);
  EXPECT_TRUE(unpack_moments(heavy.entry, heavy.bytes, out, 1e4, "test"));
  EXPECT_THAT(unpack_moments(heavy.entry, heavy.bytes, out, 1e3, "test").error().message, HasSubstr("[R17]"));
}

TEST(MomentsColumn, AWriterKeepsToTheBoundsOfAFile) {
  Shapes random(12);
  for (const double edge : {1e-30, 1.0, 1e30}) {
    std::vector<SplatShape> shapes = random.shapes(200, 3 * edge, 0.8, 0.5);
    shapes[0].mass = 1e290;
    shapes[1].boundary = dvec3(4, 4, 4);
    const PackedChunk chunk = pack_moments(shapes, edge);
    std::vector<SplatShape> out(shapes.size());
    EXPECT_EQ(message_of(unpack_moments(chunk.entry, chunk.bytes, out, edge, "test")), "");
    EXPECT_EQ(out[0].mass, 0x1p64 * edge * edge * edge);
  }
}

TEST(MomentsColumn, AnyPlanesGiveFiniteNumbers) {
  std::mt19937 random(9);
  for (int round = 0; round < 200; ++round) {
    const std::size_t width = 3 + random() % 6;
    Bytes payload;
    append_record(
        payload,
        MomentsHeader{
            round % 2 == 0 ? 1.7e308 : 5e-324, round % 3 == 0 ? wide : 1e-300, static_cast<std::uint8_t>(width), {}});
    std::array<std::uint16_t, 4> codes{};
    for (std::uint16_t& code : codes) code = static_cast<std::uint16_t>(random());
    std::ranges::sort(codes.begin() + 1, codes.end(), std::greater());
    append_record(payload, codes);
    for (std::size_t k = 0; k < width; ++k) payload.push_back(round == 0 ? std::byte{255} : std::byte(random() % 256));
    payload.resize(payload.size() + 6);  // no boundary
    payload.push_back(std::byte(random() % 256));
    const PackedChunk chunk = with_payload({}, payload);
    const SplatShape shape = unpacked<SplatShape>(chunk, 1, unpack_shapes)[0];
    EXPECT_TRUE(std::isfinite(shape.mass) && shape.mass >= 0);
    EXPECT_TRUE(std::isfinite(shape.deviations[0]) && shape.deviations[2] >= 0);
    EXPECT_NEAR(glm::length(shape.orientation), 1, rounding);
  }
}

// --- Values.

SplatValue random_value(std::mt19937& random, double low, double high) {
  std::uniform_real_distribution<double> mean(low, high), share(-1, 1);
  return {mean(random),
          (high - low) * (1 + share(random)) / 20,
          {share(random), share(random), share(random)},
          std::abs(share(random)),
          std::abs(share(random))};
}

std::vector<SplatValue> random_signals(std::size_t count, double low, double high) {
  std::mt19937 random(10);
  std::vector<SplatValue> values(count);
  for (SplatValue& value : values) value = random_value(random, low, high);
  return values;
}

ValueSummary everything() {
  constexpr float most = std::numeric_limits<float>::max();
  return {-most, most, ~std::uint64_t{0}};
}

ValueMomentsHeader header_of(const PackedChunk& chunk) { return read_record<ValueMomentsHeader>(payload_of(chunk), 0); }

// Deviations come back within half of a code, an eighth of an octave.
const double deviation_factor = std::exp2(1.0 / 16) * (1 + rounding);

// Returns the largest error of a mean, in steps of this splat. Exact means have the rounding of single precision.
double expect_values_near(const std::vector<SplatValue>& in, double least_step,
                          const ValueSummary& summary = everything()) {
  const PackedChunk chunk = pack_value_moments(in, least_step, summary);
  EXPECT_LE(chunk.entry.unpacked_bytes, 64 + 64 * in.size());  // R10
  EXPECT_EQ(chunk.entry.min, summary.min);
  EXPECT_EQ(chunk.entry.max, summary.max);
  EXPECT_EQ(chunk.entry.occupancy, summary.occupancy);
  const bool exact = header_of(chunk).form == 2;
  const auto out = unpacked<SplatValue>(chunk, in.size(), unpack_signals);
  double largest = 0;
  for (std::size_t i = 0; i < in.size(); ++i) {
    EXPECT_EQ(out[i].coverage > 0, in[i].coverage > 0);
    EXPECT_NEAR(out[i].coverage, in[i].coverage, 1.0 / 255);
    if (!(in[i].coverage > 0)) continue;
    const double step = std::max(least_step, out[i].deviation / 8), error = std::abs(out[i].mean - in[i].mean);
    if (exact)
      EXPECT_LE(error, std::abs(in[i].mean) * 0x1p-24);
    else if (error > 0)
      largest = std::max(largest, error / step);
    EXPECT_TRUE(within_factor(in[i].deviation, out[i].deviation, deviation_factor));
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(out[i].correlation[k], in[i].correlation[k], 1.0 / 30 + rounding);
    const double squares = glm::dot(out[i].correlation, out[i].correlation);
    EXPECT_EQ(out[i].residual, std::sqrt(std::max(0.0, 1 - squares)));
  }
  return largest;
}

TEST(ValueMomentsColumn, MeansStayWithinHalfOfTheirSteps) {
  for (const double scale : {1e-30, 1e-6, 1.0, 1e30})
    for (const double away : {0.0, 1.0, -1.0, 1e3})
      for (const double step : {10.0, 0.3, 1e-2, 1e-4, 0.0})
        EXPECT_LE(expect_values_near(random_signals(300, (away - 1) * scale, (away + 1) * scale), step * scale), 0.51);
}

TEST(ValueMomentsColumn, ErrorsDoNotAddUp) {
  const auto values = random_signals(60'000, -1, 1);
  EXPECT_LE(expect_values_near(values, 0), 0.51);
}

TEST(ValueMomentsColumn, SpendsBytesOnlyWhereMeansDiffer) {
  const auto header = [](double range, double deviation, double step) {
    std::vector<SplatValue> values = random_signals(500, 5, 5 + range);
    for (SplatValue& value : values) value.deviation = deviation;
    return header_of(pack_value_moments(values, step, everything()));
  };
  EXPECT_EQ(header(1, 0.1, 10).width, 0);
  EXPECT_EQ(header(1, 0.1, 0).width, 1);
  EXPECT_EQ(header(1, 0.01, 0).width, 2);
  EXPECT_EQ(header(1, 1e-5, 0).width, 3);
  EXPECT_EQ(header(1, 1e-7, 0).form, 2);
  EXPECT_EQ(header(1, 1e-7, 0.01).width, 1);
  EXPECT_EQ(header(1, 0, 0).form, 2);
  EXPECT_EQ(header(1, 0, 0.01).deviation_width, 0);
  std::vector<SplatValue> equal = random_signals(50, 0, 1);
  for (SplatValue& value : equal) value.mean = 0.1;
  for (const double step : {0.0, 1.0, 1e300, infinity}) {
    EXPECT_EQ(header_of(pack_value_moments(equal, step, everything())).width, 0);
    EXPECT_EQ(unpacked<SplatValue>(pack_value_moments(equal, step, everything()), 50, unpack_signals)[49].mean, 0.1);
  }
}

TEST(ValueMomentsColumn, AFillValueCostsTheOthersNothing) {
  std::vector<SplatValue> values = random_signals(500, 1, 2);
  values[200].mean = 9.97e36;
  values[200].deviation = values[201].deviation = 3e36;
  values[202].deviation = 0;
  expect_values_near(values, 0);
  EXPECT_EQ(header_of(pack_value_moments(values, 0, everything())).deviation_width, 2);
}

TEST(ValueMomentsColumn, MissingValuesContributeNothing) {
  std::vector<SplatValue> values = random_signals(100, 1, 2);
  for (std::size_t i = 0; i < values.size(); i += 3)
    values[i] = {not_a_number, infinity, dvec3(not_a_number), not_a_number, 0};
  values[1] = {1e30, 1e30, dvec3(0.5), 1, 0};
  EXPECT_LE(expect_values_near(values, 1e-3), 0.51);
  EXPECT_EQ(header_of(pack_value_moments(values, 1e-3, everything())).width, 2);
  EXPECT_LT(header_of(pack_value_moments(values, 1e-3, everything())).deviation_scale, 1);

  expect_values_near(std::vector<SplatValue>(1), 0, {});
  expect_values_near(std::vector<SplatValue>(70), 1e-3, {});
}

TEST(ValueMomentsColumn, TinyCoverageIsNotNone) {
  std::vector<SplatValue> values = random_signals(5, 1, 2);
  values[0].coverage = 0;
  values[1].coverage = 1e-300;
  values[2].coverage = 1.0 / 511;
  values[3].coverage = 1;
  expect_values_near(values, 1e-3);
  const auto out = unpacked<SplatValue>(pack_value_moments(values, 1e-3, everything()), 5, unpack_signals);
  EXPECT_EQ(out[1].coverage, 1.0 / 255);
  EXPECT_EQ(out[3].coverage, 1);
}

TEST(ValueMomentsColumn, ExtremesComeBackExactly) {
  const std::vector<SplatValue> values = {
      {1, 0, dvec3(1, -1, 0), 0, 1}, {1, 3, dvec3(0, 0, -1), 0, 1}, {1, 3, dvec3(0), 1, 1}};
  const auto out = unpacked<SplatValue>(pack_value_moments(values, 0, {-5, 7, 1}), 3, unpack_signals);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(out[i].mean, values[i].mean);
    EXPECT_EQ(out[i].deviation, values[i].deviation);
    EXPECT_EQ(out[i].correlation, values[i].correlation);
    EXPECT_EQ(out[i].residual, values[i].residual);
    EXPECT_EQ(out[i].coverage, values[i].coverage);
  }
}

TEST(ValueMomentsColumn, RoundingDoesNotCarryMeansPastTheirBounds) {
  // Bounds in single precision, means in double: 0.1F is above 0.1.
  std::vector<SplatValue> values = random_signals(50, 0.1, 0.3);
  values[0].mean = 0.1;
  values[1].mean = 0.3;
  const ValueSummary summary{0.1F, 0.3F, 1};
  for (const double step : {0.0, 1e-9, 1e-3, 0.05, 10.0}) {
    const PackedChunk chunk = pack_value_moments(values, step, summary);
    for (const SplatValue& value : unpacked<SplatValue>(chunk, values.size(), unpack_signals)) {
      const double error = 0.51 * std::max(step, value.deviation / 8);
      EXPECT_GE(value.mean, double{summary.min} - error);
      EXPECT_LE(value.mean, double{summary.max} + error);
    }
  }
}

TEST(ValueMomentsColumn, RefusesMeansOutsideOfTheEntrysBounds) {
  const auto values = random_signals(10, 1, 2);
  const PackedChunk good = pack_value_moments(values, 1e-3, everything());
  const auto refuses = [&](float min, float max) {
    PackedChunk chunk = good;
    chunk.entry.min = min;
    chunk.entry.max = max;
    std::vector<SplatValue> out(10);
    return !unpack_value_moments(chunk.entry, chunk.bytes, out, "test");
  };
  EXPECT_FALSE(refuses(1, 2));
  EXPECT_TRUE(refuses(1.5F, 2));
  EXPECT_TRUE(refuses(1, 1.5F));
  const ValueSummary none;
  EXPECT_TRUE(refuses(none.min, none.max));
  EXPECT_TRUE(refuses(std::numeric_limits<float>::quiet_NaN(), 2));
  EXPECT_TRUE(refuses(1, std::numeric_limits<float>::quiet_NaN()));
}

TEST(ValueMomentsColumn, DeviationsAndStepsAreAtMostTheLengthOfTheRange) {
  const std::vector<SplatValue> values = random_signals(10, 1, 2);
  const PackedChunk good = pack_value_moments(values, 1e-3, {1, 2, 1});
  const auto refuses = [&](const std::function<void(ValueMomentsHeader&, Bytes&)>& change) {
    return refused<ValueMomentsHeader, SplatValue>(good, 10, unpack_signals, change);
  };
  EXPECT_FALSE(refuses([](ValueMomentsHeader&, Bytes&) {}));
  EXPECT_TRUE(refuses([](ValueMomentsHeader& h, Bytes&) { h.deviation_scale = 1.01; }));
  EXPECT_TRUE(refuses([](ValueMomentsHeader& h, Bytes&) { h.least_step = 1.01; }));

  // A writer cannot break the rule, even where rounding to single precision leaves no range.
  std::vector<SplatValue> narrow(10, SplatValue{0.1, 1e-12, dvec3(0), 1, 1});
  const PackedChunk chunk = pack_value_moments(narrow, 1e300, {0.1F, 0.1F, 1});
  const auto out = unpacked<SplatValue>(chunk, 10, unpack_signals);
  EXPECT_EQ(out[3].deviation, 0);
  EXPECT_EQ(out[3].mean, double{0.1F});
}

TEST(ValueMomentsColumn, IsReadAsTheSpecificationSays) {
  PackedChunk chunk = chunk_of_one(ValueMomentsHeader{1, 2, 1, {}, -10, 0.25, 8}, {0x35, 0x12, 17, 15, 0xF1, 0, 255});
  chunk.entry.min = static_cast<float>(-10 - 0.25 * 0x91B);
  chunk.entry.max = chunk.entry.min + 8;
  const SplatValue value = unpacked<SplatValue>(chunk, 1, unpack_signals)[0];
  EXPECT_EQ(value.deviation, 2);
  EXPECT_EQ(value.mean, -10 - 0.25 * 0x91B);
  EXPECT_EQ(value.correlation, dvec3(1, -1, 0));
  EXPECT_EQ(value.residual, 0);
  EXPECT_EQ(value.coverage, 1);

  PackedChunk exact = chunk_of_one(ValueMomentsHeader{2, 4, 0, {}, 0, 0, 0}, {0, 0, 0xC0, 0x3F, 9, 0, 12, 51});
  exact.entry.min = exact.entry.max = 1.5F;
  const SplatValue other = unpacked<SplatValue>(exact, 1, unpack_signals)[0];
  EXPECT_EQ(other.mean, 1.5);
  EXPECT_EQ(other.deviation, 0);
  EXPECT_EQ(other.correlation, dvec3(9, 0, 12) / 15.0);
  EXPECT_NEAR(other.residual, 0, 1e-7);
  EXPECT_EQ(other.coverage, 0.2);
}

TEST(ValueMomentsColumn, RefusesBadHeaders) {
  const PackedChunk good = pack_value_moments(random_signals(10, 1, 2), 1e-3, everything());
  ASSERT_EQ(header_of(good).width, 2);
  ASSERT_EQ(header_of(good).deviation_width, 1);
  const auto refuses = [&](const std::function<void(ValueMomentsHeader&, Bytes&)>& change) {
    return refused<ValueMomentsHeader, SplatValue>(good, 10, unpack_signals, change);
  };
  EXPECT_FALSE(refuses([](ValueMomentsHeader&, Bytes&) {}));
  for (const double bad : {-1.0, infinity, -infinity, not_a_number}) {
    EXPECT_TRUE(refuses([bad](ValueMomentsHeader& h, Bytes&) { h.least_step = bad; }));
    EXPECT_TRUE(refuses([bad](ValueMomentsHeader& h, Bytes&) { h.deviation_scale = bad; }));
    if (!std::isfinite(bad)) {
      EXPECT_TRUE(refuses([bad](ValueMomentsHeader& h, Bytes&) { h.origin = bad; }));
    }
  }
  EXPECT_TRUE(refuses([](ValueMomentsHeader& h, Bytes&) { h.least_step = 1e308; }));  // infinite means
  for (const std::size_t width : {4, 5, 255})
    EXPECT_TRUE(refuses([width](ValueMomentsHeader& h, Bytes& planes) {
      h.width = static_cast<std::uint8_t>(width);
      planes.resize(10 * (5 + width));
    }));
  EXPECT_TRUE(refuses([](ValueMomentsHeader& h, Bytes& planes) {
    h.deviation_width = 3;
    planes.resize(10 * 9);
  }));
  EXPECT_TRUE(refuses([](ValueMomentsHeader& h, Bytes&) { h.width = 3; }));
  for (const int form : {0, 2, 3})
    EXPECT_TRUE(refuses([form](ValueMomentsHeader& h, Bytes&) { h.form = static_cast<std::uint8_t>(form); }));
  for (int i = 0; i < 5; ++i) EXPECT_TRUE(refuses([i](ValueMomentsHeader& h, Bytes&) { h.zero[i] = 1; }));
  for (const std::size_t plane : {3, 4, 5})
    for (const int code : {16, 240, 128})  // 16, -16, -128
      EXPECT_TRUE(
          refuses([&](ValueMomentsHeader&, Bytes& planes) { planes[plane * 10 + 3] = static_cast<std::byte>(code); }));
  expect_exact_size<SplatValue>(good, 10, unpack_signals);
}

// --- Gradients.

TEST(GradientColumn, KeepsDirections) {
  Shapes random(11);
  std::vector<vec3> in;
  for (const double length : {1e-40, 1e-30, 1.0, 1e30})
    for (int i = 0; i < 100; ++i)
      in.push_back(vec3(length * dvec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1))));
  const auto out = unpacked<vec3>(pack_gradients(in), in.size(), unpack_gradients);
  for (std::size_t i = 0; i < in.size(); ++i) {
    const dvec3 expected = glm::normalize(dvec3(in[i]));
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(static_cast<double>(out[i][k]), expected[k], 1.0 / 254 + 1e-6);
    EXPECT_GT(glm::length(out[i]), 0.9F);
  }
}

TEST(GradientColumn, WhatHasNoDirectionIsZero) {
  constexpr float huge = std::numeric_limits<float>::max(), inf = std::numeric_limits<float>::infinity();
  const std::vector<vec3> in = {vec3(0), vec3(std::nanf("")), vec3(inf, 0, 0), vec3(huge), vec3(0, -huge, 0)};
  const auto out = unpacked<vec3>(pack_gradients(in), in.size(), unpack_gradients);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(out[i], vec3(0));
  EXPECT_EQ(out[3].x, 73 / 127.0F);
  EXPECT_EQ(out[4], vec3(0, -1, 0));
}

TEST(GradientColumn, RefusesOtherSizesAndMinus128) {
  const PackedChunk good = pack_gradients(std::vector<vec3>(20, vec3(1, 2, -3)));
  expect_exact_size<vec3>(good, 20, unpack_gradients);
  Bytes payload = payload_of(good);
  payload[30] = std::byte{128};
  const PackedChunk bad = with_payload({}, payload);
  std::vector<vec3> out(20);
  EXPECT_THAT(unpack_gradients(bad.entry, bad.bytes, out, "test").error().message, HasSubstr("[R17]"));
}

}  // namespace
}  // namespace splatvol::test
