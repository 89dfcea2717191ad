#include "format/columns.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>
#include <random>

#include "tests/support/random.h"
#include "tests/support/results.h"

namespace splatvol::test {
namespace {

using namespace format;
using testing::AnyOf;
using testing::HasSubstr;

constexpr double infinity = std::numeric_limits<double>::infinity();
const Cube anywhere{dvec3(-1e300), 2e300};
constexpr float missing = std::numeric_limits<float>::quiet_NaN();

std::vector<dvec3> random_positions(std::size_t count, const dvec3& origin, const dvec3& extent,
                                    std::uint32_t seed = 1) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<dvec3> positions(count);
  for (dvec3& p : positions) p = origin + extent * random_vector(uniform, random);
  return positions;
}

std::vector<dvec3> unpacked(const PackedChunk& chunk, std::size_t count) {
  std::vector<dvec3> positions(count);
  EXPECT_EQ(message_of(unpack_positions(chunk.entry, chunk.bytes, positions, anywhere, "test")), "");
  return positions;
}

std::vector<float> unpacked_values(const PackedChunk& chunk, std::size_t count) {
  std::vector<float> values(count);
  EXPECT_EQ(message_of(unpack_values(chunk.entry, chunk.bytes, values, "test")), "");
  return values;
}

double largest_error(const std::vector<dvec3>& a, const std::vector<dvec3>& b) {
  double largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    for (int axis = 0; axis < 3; ++axis) largest = std::max(largest, std::abs(a[i][axis] - b[i][axis]));
  return largest;
}

PositionHeader header_of(const PackedChunk& chunk) {
  return read_record<PositionHeader>(unpack(chunk.bytes, chunk.entry.unpacked_bytes, "test").value(), 0);
}

// Positions come back within the requested bound, and within the bound that the chunk states.
void expect_within(const std::vector<dvec3>& positions, double error) {
  const PackedChunk chunk = pack_positions(positions, error);
  const double stated = header_of(chunk).error;
  EXPECT_LE(stated, error);
  EXPECT_LE(largest_error(positions, unpacked(chunk, positions.size())), stated) << "error " << error;
}

TEST(PositionColumn, KeepsTheBoundAtEveryScale) {
  for (const double scale : {1e-6, 1e-3, 1.0, 1e3, 1e6})
    for (const double away : {0.0, 1.0, -1.0, 1e3, 1e7, -1e7})
      for (const double error : {0.3, 1e-2, 1e-3, 1e-5, 1e-8, 1e-11, 1e-14})
        expect_within(random_positions(300, dvec3(away * scale), dvec3(scale)), error * scale);
}

TEST(PositionColumn, KeepsTheBoundFarFromTheOriginWithFineDetail) {
  for (const double away : {1e7, -1e7, 1e9})
    for (const double error : {1e-3, 1e-6, 1e-9}) expect_within(random_positions(300, dvec3(away), dvec3(1)), error);
}

TEST(PositionColumn, KeepsTheBoundWhereTheWidestIndicesAreRounded) {
  // Coordinates of both signs, with the most quantisation steps that a grid may span: the difference from the origin is
  // rounded too.
  for (const double reach : {0x1p44, 0x1p45, 0x1p46}) {
    auto positions = random_positions(2000, dvec3(-reach), dvec3(2 * reach));
    expect_within(positions, 0.51);
    expect_within(positions, 0.5101);
    expect_within(positions, 1.019);
  }
}

TEST(PositionColumn, TakesAnisotropicGroups) {
  for (const dvec3 extent : {dvec3(1, 1e-9, 1e6), dvec3(0, 1, 1), dvec3(0, 0, 1), dvec3(1e-300, 1, 0)}) {
    const auto positions = random_positions(200, dvec3(3, -5, 7), extent);
    for (const double error : {1e-2, 1e-6, 1e-12}) expect_within(positions, error);
  }
}

TEST(PositionColumn, SinglePrecisionComesBackExactly) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> uniform(1, 2);
  std::vector<dvec3> positions(500);
  for (dvec3& p : positions) p = {uniform(random), -uniform(random), uniform(random)};
  const PackedChunk chunk = pack_positions(positions, 0x1p-24);
  EXPECT_EQ(header_of(chunk).form, 1);
  EXPECT_EQ(unpacked(chunk, positions.size()), positions);
}

TEST(PositionColumn, NeighbouringGroupsShareTheirLattice) {
  const auto positions = random_positions(100, dvec3(5), dvec3(1));
  const std::vector<dvec3> first(positions.begin(), positions.begin() + 60);
  const std::vector<dvec3> second(positions.begin() + 40, positions.end());
  const auto a = unpacked(pack_positions(first, 1e-3), first.size());
  const auto b = unpacked(pack_positions(second, 1e-3), second.size());
  for (std::size_t i = 0; i < 20; ++i) EXPECT_EQ(a[40 + i], b[i]);
}

TEST(PositionColumn, ASinglePointTakesNoPlanes) {
  const std::vector<dvec3> one = {{0.1, -0.2, 1e7}};
  EXPECT_EQ(pack_positions(one, 1e-3).entry.unpacked_bytes, sizeof(PositionHeader));
  for (const double error : {1e300, 1.0, 1e-6, 1e-12, 0.0}) expect_within(one, error);
}

TEST(PositionColumn, EqualPointsTakeNoPlanes) {
  const std::vector<dvec3> equal(500, {0.1, 0.2, 0.3});
  EXPECT_EQ(pack_positions(equal, 1e-6).entry.unpacked_bytes, sizeof(PositionHeader));
  expect_within(equal, 1e-6);
  expect_within(std::vector<dvec3>(500, dvec3(0)), 1e-6);
}

TEST(PositionColumn, SpendsBytesOnlyWhereThePointsExtend) {
  const auto flat = random_positions(1000, dvec3(0, 0, 2.5), dvec3(1, 1, 0));
  const PositionHeader header = header_of(pack_positions(flat, 1e-3));
  EXPECT_EQ(header.width[0], 2);
  EXPECT_EQ(header.width[1], 2);
  EXPECT_EQ(header.width[2], 0);
}

TEST(PositionColumn, NoErrorMeansExact) {
  for (const double scale : {1e-300, 1e-6, 1.0, 1e7, 1e300}) {
    const auto positions = random_positions(200, dvec3(-scale), dvec3(2 * scale));
    for (const double error : {0.0, -1.0, std::numeric_limits<double>::quiet_NaN()}) {
      const PackedChunk chunk = pack_positions(positions, error);
      EXPECT_EQ(header_of(chunk).form, 2);
      EXPECT_EQ(header_of(chunk).error, 0);
      EXPECT_EQ(unpacked(chunk, positions.size()), positions);
    }
  }
}

TEST(PositionColumn, WhatNoGridCanHoldIsExact) {
  const auto wide = random_positions(100, dvec3(-1e300), dvec3(2e300));
  for (const double error : {1e-300, 1e-9, 1.0, 5e-324}) {
    const PackedChunk chunk = pack_positions(wide, error);
    EXPECT_EQ(header_of(chunk).form, 2);
    EXPECT_EQ(unpacked(chunk, wide.size()), wide);
  }
}

TEST(PositionColumn, ErrorsBeyondAllBoundsAreHarmless) {
  for (const double error : {1e9, 1e300, 1e308, std::numeric_limits<double>::max(), infinity})
    for (const double scale : {1.0, 1e300}) {
      const auto positions = random_positions(100, dvec3(-scale), dvec3(2 * scale));
      const PackedChunk chunk = pack_positions(positions, error);
      EXPECT_LE(largest_error(positions, unpacked(chunk, positions.size())), error);
    }
}

TEST(PositionColumn, StaysUnderTheLimitOfR10) {
  for (const std::size_t count : {1, 2, 100, 4096}) {
    const auto positions = random_positions(count, dvec3(-1), dvec3(1));
    for (const double error : {0.0, 1e-13, 1e-3})
      EXPECT_LE(pack_positions(positions, error).entry.unpacked_bytes, 64 + 64 * count);
  }
}

// Packs a payload as it is, as another writer or an attacker might.
PackedChunk chunk_of(const Bytes& payload) {
  PackedChunk chunk{{}, pack(payload)};
  chunk.entry = {hash_bytes(chunk.bytes),
                 static_cast<std::uint32_t>(chunk.bytes.size()),
                 static_cast<std::uint32_t>(payload.size()),
                 -largest_stored_value,
                 largest_stored_value,
                 0};
  return chunk;
}

TEST(PositionColumn, RefusesBadHeaders) {
  const PositionHeader good{1, {1, 0, 2}, 0, 0.1, {1, 2, 3}, 0.5};
  const auto refuses = [](const PositionHeader& header, std::size_t plane_bytes) {
    Bytes payload;
    append_record(payload, header);
    payload.resize(payload.size() + plane_bytes, std::byte{9});
    const PackedChunk chunk = chunk_of(payload);
    std::vector<dvec3> positions(10);
    const std::string message = message_of(unpack_positions(chunk.entry, chunk.bytes, positions, anywhere, "test"));
    EXPECT_THAT(message, AnyOf("", HasSubstr("[R17]")));
    return message != "";
  };
  EXPECT_FALSE(refuses(good, 30));
  EXPECT_TRUE(refuses(good, 29));
  EXPECT_TRUE(refuses(good, 31));
  EXPECT_TRUE(refuses(good, 0));

  const auto changed = [&](auto change) {
    PositionHeader header = good;
    change(header);
    return header;
  };
  EXPECT_TRUE(refuses(changed([](auto& h) { h.form = 0; }), 30));
  EXPECT_TRUE(refuses(changed([](auto& h) { h.form = 3; }), 30));
  EXPECT_TRUE(refuses(changed([](auto& h) { h.form = 2; }), 240));  // exact with widths
  EXPECT_TRUE(refuses(changed([](auto& h) { h.width[0] = 8; }), 100));
  EXPECT_TRUE(refuses(changed([](auto& h) { h.width[0] = 255; }), 2570));
  EXPECT_TRUE(refuses(changed([](auto& h) { h.zero = 1; }), 30));
  for (const double bad : {-1.0, infinity, std::numeric_limits<double>::quiet_NaN()}) {
    EXPECT_TRUE(refuses(changed([bad](auto& h) { h.error = bad; }), 30));
    EXPECT_TRUE(refuses(changed([bad](auto& h) { h.quantisation_step = bad; }), 30));
    if (!(bad < 0)) {
      EXPECT_TRUE(refuses(changed([bad](auto& h) { h.origin[1] = bad; }), 30));
    }
  }
  EXPECT_TRUE(refuses(changed([](auto& h) { h.quantisation_step = 1e308; }), 30));  // 9 * 1e308 is infinite
}

TEST(PositionColumn, RefusesExactCoordinatesThatAreNotFinite) {
  const std::vector<dvec3> positions = {{1, 2, 3}, {4, infinity, 6}};
  const PackedChunk chunk = pack_positions(positions, 0);
  std::vector<dvec3> out(2);
  EXPECT_FALSE(unpack_positions(chunk.entry, chunk.bytes, out, anywhere, "test"));
}

TEST(PositionColumn, PointsOutsideOfTheCubeAreRefused) {
  const Cube cube{{1, 2, 3}, 0.5};
  for (const double error : {0.0, 1e-3})
    for (int axis = 0; axis < 3; ++axis)
      for (const double away : {-0.01, 0.0, 0.5, 0.51}) {
        std::vector<dvec3> positions = random_positions(20, cube.origin, dvec3(cube.edge));
        positions[7][axis] = cube.origin[axis] + away;
        const PackedChunk chunk = pack_positions(positions, error);
        std::vector<dvec3> out(20);
        const Status status = unpack_positions(chunk.entry, chunk.bytes, out, cube, "test");
        EXPECT_EQ(status.has_value(), away >= 0 && away <= 0.5) << away;
        if (!status) {
          EXPECT_THAT(status.error().message, HasSubstr("outside of the cube [R17]"));
        }
      }
}

TEST(PositionColumn, AnErrorIsAtMostTheEdge) {
  PositionHeader header{1, {0, 0, 0}, 0, 0.5, {1, 2, 3}, 0};
  for (const double error : {0.5, 0.6, 1e300}) {
    header.error = error;
    Bytes payload;
    append_record(payload, header);
    const PackedChunk chunk = chunk_of(payload);
    std::vector<dvec3> out(3);
    EXPECT_EQ(unpack_positions(chunk.entry, chunk.bytes, out, {{1, 2, 3}, 0.5}, "test").has_value(), error == 0.5);
  }
}

TEST(CentroidColumn, StaysWithinAnEdgeOfTheCube) {
  const Cube cube{{1, 2, 3}, 0.5};
  for (int axis = 0; axis < 3; ++axis)
    for (const double away : {-0.51, -0.5, 0.0, 1.0, 1.01, 1e30}) {
      std::vector<dvec3> centroids = random_positions(20, cube.origin, dvec3(cube.edge));
      centroids[7][axis] = cube.origin[axis] + away;
      std::vector<dvec3> out(20);
      const PackedChunk chunk = pack_positions(centroids, 1e-3);
      const Status status = unpack_centroids(chunk.entry, chunk.bytes, out, cube, "test");
      EXPECT_EQ(status.has_value(), away >= -0.5 && away <= 1) << away;
      if (!status) {
        EXPECT_THAT(status.error().message, HasSubstr("outside of the cube [R17]"));
      }
      // A writer cannot break the rule.
      const PackedChunk cut = pack_centroids(centroids, 1e-3, cube);
      ASSERT_TRUE(unpack_centroids(cut.entry, cut.bytes, out, cube, "test"));
      EXPECT_NEAR(out[7][axis], cube.origin[axis] + std::clamp(away, -0.5, 1.0), 1e-3);
    }
}

TEST(PositionColumn, ChecksTheHashFirst) {
  const auto positions = random_positions(50, dvec3(0), dvec3(1));
  const PackedChunk chunk = pack_positions(positions, 1e-4);
  std::vector<dvec3> out(50);
  for (std::size_t i = 0; i < chunk.bytes.size(); ++i) {
    Bytes flipped = chunk.bytes;
    flipped[i] ^= std::byte{0x10};
    EXPECT_EQ(message_of(unpack_positions(chunk.entry, flipped, out, anywhere, "chunk 3")),
              "chunk 3: checksum mismatch");
    EXPECT_FALSE(unpack_positions(chunk.entry, std::span(chunk.bytes).first(i), out, anywhere, "test"));
  }
}

TEST(ValueColumn, ComesBackBitByBit) {
  std::mt19937 random(11);
  std::vector<float> values(1000);
  for (float& value : values) {
    do value = std::bit_cast<float>(static_cast<std::uint32_t>(random()));
    while (!(std::abs(value) <= largest_stored_value));
  }
  values[3] = -0.0F;
  values[4] = std::numeric_limits<float>::denorm_min();
  values[5] = largest_stored_value;
  const PackedChunk chunk = pack_values(values, 0, {-1, 1});
  const std::vector<float> out = unpacked_values(chunk, values.size());
  for (std::size_t i = 0; i < values.size(); ++i)
    EXPECT_EQ(std::bit_cast<std::uint32_t>(out[i]), std::bit_cast<std::uint32_t>(values[i]));
}

TEST(ValueColumn, WhatIsNotFiniteIsMissing) {
  using Limits = std::numeric_limits<float>;
  const std::vector<float> values = {
      1, missing, -missing, Limits::signaling_NaN(), Limits::infinity(), -Limits::infinity(), Limits::max(), 3};
  const PackedChunk chunk = pack_values(values, 0, {1, 3});
  EXPECT_EQ(chunk.entry.min, 1);
  EXPECT_EQ(chunk.entry.max, 3);
  EXPECT_EQ(chunk.entry.occupancy, 1 | std::uint64_t{1} << 63);
  const std::vector<float> out = unpacked_values(chunk, values.size());
  for (std::size_t i = 1; i < 7; ++i) EXPECT_EQ(std::bit_cast<std::uint32_t>(out[i]), 0x7FC00000u);
  EXPECT_EQ(out[7], 3);
}

TEST(ValueColumn, NoPresentValueHasAnEmptyRange) {
  const PackedChunk chunk = pack_values(std::vector<float>(100, missing), 1, ValueBins{std::nan(""), std::nan("")});
  EXPECT_EQ(chunk.entry.min, std::numeric_limits<float>::infinity());
  EXPECT_EQ(chunk.entry.max, -std::numeric_limits<float>::infinity());
  EXPECT_EQ(chunk.entry.occupancy, 0u);
}

TEST(ValueColumn, RefusesInfinityAndOtherLengths) {
  Bytes payload;
  append_record(payload, ValueHeader{2, 4, {}, 0, 0});
  append_planes<float>(payload, std::vector<float>{1, std::numeric_limits<float>::infinity()});
  const PackedChunk chunk = chunk_of(payload);
  std::vector<float> two(2), three(3), one(1);
  EXPECT_FALSE(unpack_values(chunk.entry, chunk.bytes, two, "test"));
  const PackedChunk good = pack_values(std::vector<float>{1, 2}, 0, {});
  EXPECT_TRUE(unpack_values(good.entry, good.bytes, two, "test"));
  EXPECT_FALSE(unpack_values(good.entry, good.bytes, three, "test"));
  EXPECT_FALSE(unpack_values(good.entry, good.bytes, one, "test"));
}

std::vector<float> random_values(std::size_t count, float low, float high) {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> value(low, high);
  std::vector<float> values(count);
  for (float& v : values) v = value(random);
  return values;
}

TEST(ValueColumn, OnAGridValuesStayWithinTheirError) {
  for (const float scale : {1e-30F, 1.0F, 1e30F})
    for (const double error : {10.0, 0.3, 1e-3, 1e-5, 1e-9}) {
      std::vector<float> values = random_values(2000, -scale, 3 * scale);
      for (std::size_t i = 0; i < values.size(); i += 7) values[i] = missing;
      const double bound = error * double{scale};
      const PackedChunk chunk = pack_values(values, bound, {-1, 3});
      const std::vector<float> out = unpacked_values(chunk, values.size());
      const ValueSummary summary = ValueBins{-1, 3}.summarize(out);
      EXPECT_EQ(chunk.entry.min, summary.min);
      EXPECT_EQ(chunk.entry.max, summary.max);
      EXPECT_EQ(chunk.entry.occupancy, summary.occupancy);
      for (std::size_t i = 0; i < values.size(); ++i)
        if (std::isnan(values[i]))
          EXPECT_TRUE(std::isnan(out[i]));
        else
          EXPECT_NEAR(out[i], values[i], bound + 1e-7 * std::abs(values[i]));
    }
}

TEST(ValueColumn, DescribesTheValuesAsTheyComeBack) {
  std::vector<float> values = random_values(2000, -1, 3);
  for (std::size_t i = 0; i < values.size(); i += 7) values[i] = missing;
  const ValueBins bins{-1, 3};
  for (const double error : {0.0, 1e-3, 0.3}) {
    StoredValues stored;
    const PackedChunk chunk = pack_values(values, error, bins, &stored);
    std::vector<float> out = unpacked_values(chunk, values.size());
    Histogram histogram{};
    std::uint64_t gone = 0;
    double largest = 0;
    for (std::size_t i = 0; i < out.size(); ++i) {
      if (std::isnan(out[i])) {
        ++gone;
        continue;
      }
      ++histogram[static_cast<std::size_t>(bins.bin(double{out[i]}))];
      largest = std::max(largest, std::abs(double{out[i]} - double{values[i]}));
    }
    EXPECT_EQ(stored.histogram, histogram);
    EXPECT_EQ(stored.missing, gone);
    EXPECT_LE(largest, stored.error);
    EXPECT_LE(stored.error, error);
    EXPECT_EQ(stored.error, unpack_values_and_error(chunk.entry, chunk.bytes, out, "test").value());
    EXPECT_EQ(stored.error > 0, error > 0);
  }
}

TEST(ValueColumn, RefusesValuesBeyondTheRangeOfTheirChunk) {
  for (const double error : {0.0, 1e-2}) {
    PackedChunk chunk = pack_values(random_values(100, 1, 2), error, {1, 2});
    std::vector<float> out(100);
    EXPECT_TRUE(unpack_values(chunk.entry, chunk.bytes, out, "test"));
    const float max = chunk.entry.max;
    chunk.entry.max = 1.9F;
    EXPECT_THAT(unpack_values(chunk.entry, chunk.bytes, out, "test").error().message, HasSubstr("[R17]"));
    chunk.entry.max = max;
    chunk.entry.min = 1.1F;
    EXPECT_FALSE(unpack_values(chunk.entry, chunk.bytes, out, "test"));
  }
}

TEST(ValueColumn, AValueFarFromTheOthersMakesThemExact) {
  std::vector<float> values = random_values(500, 1, 2);
  values[100] = 9.97e36F;
  const PackedChunk chunk = pack_values(values, 1e-3, {1, 1e37});
  const std::vector<float> out = unpacked_values(chunk, values.size());
  EXPECT_EQ(out, values);
}

TEST(ValueColumn, EqualValuesTakeNoBytes) {
  const PackedChunk chunk = pack_values(std::vector<float>(1000, 0.1F), 0, {0, 1});
  const std::vector<float> out = unpacked_values(chunk, 1000);
  EXPECT_EQ(out, std::vector<float>(1000, 0.1F));
  EXPECT_LT(chunk.bytes.size(), 80u);
}

TEST(ValueColumn, IsReadAsTheSpecificationSays) {
  Bytes payload;
  append_record(payload, ValueHeader{1, 1, {}, 10, 0.5});
  append_planes<std::uint8_t>(payload, std::vector<std::uint8_t>{1, 0, 2, 5});
  const PackedChunk chunk = chunk_of(payload);
  const std::vector<float> out = unpacked_values(chunk, 4);
  EXPECT_EQ(out[0], 10);
  EXPECT_TRUE(std::isnan(out[1]));
  EXPECT_EQ(out[2], 9.5F);
  EXPECT_EQ(out[3], 10.5F);
}

TEST(ValueColumn, RefusesBadHeaders) {
  const auto refuses = [](const ValueHeader& header, std::size_t bytes) {
    Bytes payload;
    append_record(payload, header);
    payload.resize(payload.size() + bytes, std::byte{3});
    const PackedChunk chunk = chunk_of(payload);
    std::vector<float> out(4);
    return !unpack_values(chunk.entry, chunk.bytes, out, "test");
  };
  const double none = std::nan("");
  EXPECT_FALSE(refuses({1, 2, {}, 1, 1}, 8));
  EXPECT_FALSE(refuses({2, 4, {}, 0, 0}, 16));
  EXPECT_TRUE(refuses({1, 2, {}, 1, 1}, 7));
  EXPECT_TRUE(refuses({0, 2, {}, 1, 1}, 8));
  EXPECT_TRUE(refuses({3, 4, {}, 1, 1}, 16));
  EXPECT_TRUE(refuses({1, 4, {}, 1, 1}, 16));
  EXPECT_TRUE(refuses({2, 3, {}, 1, 1}, 12));
  EXPECT_TRUE(refuses({1, 2, {0, 0, 0, 0, 0, 1}, 1, 1}, 8));
  for (const double bad : {infinity, -infinity, none}) {
    EXPECT_TRUE(refuses({1, 2, {}, bad, 1}, 8));
    EXPECT_TRUE(refuses({1, 2, {}, 1, bad}, 8));
  }
  EXPECT_TRUE(refuses({1, 2, {}, 1, -1}, 8));
  EXPECT_TRUE(refuses({1, 3, {}, 0, 1e38}, 12));  // infinite values
}

TEST(ValueBins, CoverTheRangeInEqualParts) {
  const ValueBins bins{-2, 6};
  EXPECT_EQ(bins.bin(-2), 0);
  EXPECT_EQ(bins.bin(6), 63);
  EXPECT_EQ(bins.bin(2), 32);
  EXPECT_EQ(bins.bin(-3), 0);
  EXPECT_EQ(bins.bin(7), 63);
  for (int b = 0; b < 64; ++b) {
    EXPECT_EQ(bins.bin(-2 + b / 8.0), b);
    EXPECT_EQ(bins.bin(-2 + (b + 1) / 8.0 - 1e-12), b);
  }
}

TEST(ValueBins, AConstantIsInTheFirst) {
  EXPECT_EQ((ValueBins{5, 5}.bin(5)), 0);
  EXPECT_EQ((ValueBins{}.bin(0)), 0);
}

TEST(ValueBins, SummariesJoinAsTheirValuesDo) {
  const ValueBins bins{0, 64};
  ValueSummary joined = bins.summarize(std::vector<float>{3, 5, missing});
  joined.include(bins.summarize(std::vector<float>{missing}));
  joined.include(bins.summarize(std::vector<float>{60}));
  EXPECT_EQ(joined.min, 3);
  EXPECT_EQ(joined.max, 60);
  EXPECT_EQ(joined.occupancy, 1u << 3 | 1u << 5 | std::uint64_t{1} << 60);
}

TEST(OctantColumn, ComesBack) {
  const std::vector<std::uint8_t> depths = {0, 1, 42, 64, 7}, counts = {1, 255, 8, 3, 2};
  const PackedChunk chunk = pack_octants(depths, counts);
  std::vector<std::uint8_t> depths_out(5), counts_out(5);
  ASSERT_TRUE(unpack_octants(chunk.entry, chunk.bytes, depths_out, counts_out, "test"));
  EXPECT_EQ(depths_out, depths);
  EXPECT_EQ(counts_out, counts);
}

TEST(OctantColumn, RefusesDepthsAndCountsOutOfRange) {
  std::vector<std::uint8_t> depths(2), counts(2);
  const auto refuses = [&](std::vector<std::uint8_t> d, std::vector<std::uint8_t> c) {
    const PackedChunk chunk = pack_octants(d, c);
    return !unpack_octants(chunk.entry, chunk.bytes, depths, counts, "test");
  };
  EXPECT_FALSE(refuses({1, 64}, {1, 1}));
  EXPECT_TRUE(refuses({1, 65}, {1, 1}));
  EXPECT_TRUE(refuses({1, 1}, {1, 0}));
  EXPECT_TRUE(refuses({1}, {1}));
  EXPECT_TRUE(refuses({1, 2, 3}, {1, 2, 3}));
}

}  // namespace
}  // namespace splatvol::test
