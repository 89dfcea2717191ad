// Rows of the file to records: against the numbers that the format's functions unpack.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "format/columns.h"
#include "streamer/store/decode.h"
#include "tests/support/random.h"

namespace splatvol::test {
namespace {

constexpr double edge = 100;
const Cube cube{dvec3(1e5, -1e5, 7), edge};

struct Points {
  std::vector<dvec3> positions;
  std::vector<SplatShape> shapes;
  std::vector<SplatValue> values;
};

// Materials of sizes up to `size`, over `octaves` octaves.
Points random_points(std::size_t count, double size, double octaves) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> number(0, 1);
  std::normal_distribution<double> normal;
  Points points;
  for (std::size_t i = 0; i < count; ++i) {
    points.positions.push_back(cube.origin + edge * dvec3(number(random), number(random), number(random)));
    SplatShape shape;
    const double deviation = size * std::exp2(-octaves * number(random));
    shape.deviations = deviation * dvec3(1, number(random), i % 7 == 0 ? 0 : 1e-3);
    if (shape.deviations.z > shape.deviations.y) std::swap(shape.deviations.y, shape.deviations.z);
    shape.mass = i % 11 == 0 ? 0 : number(random) * deviation * deviation * deviation;
    shape.orientation = glm::normalize(random_quaternion(normal, random));
    if (i % 3 == 0) shape.boundary = 3.9 * dvec3(number(random) - 0.5, number(random) - 0.5, -number(random) / 2);
    shape.density = i % 2 == 0 ? 1 : std::exp2(7 * number(random) - 4);
    points.shapes.push_back(shape);
    const dvec3 correlation = 0.5 * dvec3(number(random), -number(random), number(random));
    points.values.push_back({number(random), i % 5 == 0 ? 0 : 0.1 * std::exp2(-9 * number(random)), correlation, 0,
                             i % 13 == 0 ? 0 : number(random)});
  }
  return points;
}

ChunkBytes bytes_of(const format::PackedChunk& chunk) { return {chunk.entry, chunk.bytes}; }

// Rows, and what the format's functions unpack from the same chunks.
struct Decoded {
  RecordRow row;
  Points numbers;
};

Decoded decode(const Points& points, double error) {
  const std::size_t count = points.positions.size();
  const format::PackedChunk positions = format::pack_centroids(points.positions, error, cube);
  const format::PackedChunk shapes = format::pack_moments(points.shapes, edge);
  const format::PackedChunk values = format::pack_value_moments(points.values, 1e-6, {0, 1, 1});
  const auto size = static_cast<std::uint32_t>(count);
  auto shape_row = decode_shapes(KernelKind::moments, bytes_of(positions), bytes_of(shapes), size, cube, "test");
  auto value_row = decode_values(KernelKind::moments, {bytes_of(values)}, size, "test");
  EXPECT_TRUE(shape_row && value_row);
  Decoded decoded{
      {std::make_shared<ShapeRow>(std::move(*shape_row)), std::make_shared<ValueRow>(std::move(*value_row))},
      {std::vector<dvec3>(count), std::vector<SplatShape>(count), std::vector<SplatValue>(count)}};
  Points& numbers = decoded.numbers;
  EXPECT_TRUE(format::unpack_centroids(positions.entry, positions.bytes, numbers.positions, cube, "test"));
  EXPECT_TRUE(format::unpack_moments(shapes.entry, shapes.bytes, numbers.shapes, edge, "test"));
  EXPECT_TRUE(format::unpack_value_moments(values.entry, values.bytes, numbers.values, "test"));
  return decoded;
}

void expect_shape(const MomentsSplat& material, const SplatShape& shape) {
  for (int k = 0; k < 3; ++k) {
    EXPECT_DOUBLE_EQ(material.deviations[k], shape.deviations[k]) << "log codes stay";
    EXPECT_DOUBLE_EQ(material.boundary[k], shape.boundary[k]);
  }
  const dmat3 before = glm::mat3_cast(shape.orientation), after = glm::mat3_cast(material.orientation);
  for (int k = 0; k < 3; ++k) EXPECT_LT(glm::distance(before[k], after[k]), 1e-5);
}

void expect_value(const MomentsSplat& material, const SplatValue& value) {
  EXPECT_EQ(material.value, static_cast<double>(static_cast<float>(value.mean)));
  EXPECT_DOUBLE_EQ(material.value_deviation, value.deviation);
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(material.correlations[k], value.correlation[k], 0.5 / 127 + 1e-9);
}

void expect_same(const Decoded& decoded) {
  const auto& [row, numbers] = decoded;
  ASSERT_EQ(row.shapes->size(), numbers.shapes.size());
  ASSERT_EQ(row.values->size(), numbers.shapes.size());
  for (std::uint32_t i = 0; i < row.shapes->size(); ++i) {
    const MomentsSplat material = unpack(row, i);
    const SplatShape& shape = numbers.shapes[i];
    const SplatValue& value = numbers.values[i];
    const RecordBlock& block = row.shapes->blocks()[block_of(*row.shapes, i)];
    const dvec3& d = shape.deviations;
    EXPECT_LE(glm::distance(block.origin + material.center, numbers.positions[i]), (d.z > 0   ? d.z
                                                                                    : d.y > 0 ? d.y
                                                                                              : d.x) /
                                                                                           32 +
                                                                                       1e-10);
    EXPECT_NEAR(material.mass, shape.mass * shape.density * value.coverage, 1e-12 * material.mass);
    expect_shape(material, shape);
    if (value.coverage > 0) expect_value(material, value);
  }
}

TEST(DecodeRows, GivesTheNumbersOfTheFile) {
  const Decoded decoded = decode(random_points(1000, 1, 4), 1e-4);
  EXPECT_EQ(decoded.row.shapes->blocks().size(), 1U) << "the grid of the file fits into one block";
  expect_same(decoded);
  for (std::uint32_t i = 0; i < 1000; ++i)
    EXPECT_EQ(decoded.row.shapes->blocks()[0].origin + unpack(decoded.row, i).center, decoded.numbers.positions[i])
        << "positions stay on the grid";
}

TEST(DecodeRows, TakesGridsThatAreTooFineForABlock) {
  const Decoded decoded = decode(random_points(500, 1e-3, 10), 1e-9);
  EXPECT_GT(decoded.row.shapes->blocks().size(), 1U);
  expect_same(decoded);
}

TEST(DecodeRows, TakesExactPositions) { expect_same(decode(random_points(500, 1, 3), 0)); }

// Each width of an orientation, 3 to 8 bytes, has codes of its own.
TEST(DecodeRows, TakesOrientationsOfAllWidths) {
  std::vector<bool> widths(9);
  for (const double aspect : {1.0, 10.0, 60.0, 300.0, 3e3, 1e4, 1e6}) {
    Points points = random_points(100, 1, 0);
    for (SplatShape& shape : points.shapes) shape.deviations = dvec3(1, 0.5, 0.5) / dvec3(1, 1, aspect);
    const format::PackedChunk packed = format::pack_moments(points.shapes, edge);
    widths[(packed.entry.unpacked_bytes - sizeof(format::MomentsHeader)) / 100 - 15] = true;
    expect_same(decode(points, 1e-9));
  }
  EXPECT_GE(std::ranges::count(widths, true), 4);
}

TEST(DecodeRows, KeepsAxesOfCoordinatesExactly) {
  Points points = random_points(64, 1, 0);
  for (SplatShape& shape : points.shapes) {
    shape.deviations = dvec3(1, 0.5, 0.25);
    shape.orientation = glm::dquat(1, 0, 0, 0);
  }
  const Decoded decoded = decode(points, 1e-4);
  for (std::uint32_t i = 0; i < 64; ++i) EXPECT_EQ(unpack(decoded.row, i).orientation, glm::dquat(1, 0, 0, 0));
}

TEST(DecodeRows, RefusesWhatTheFormatRefuses) {
  const Points points = random_points(100, 1, 4);
  const format::PackedChunk positions = format::pack_centroids(points.positions, 1e-4, cube);
  const format::PackedChunk values = format::pack_value_moments(points.values, 1e-6, {0, 1, 1});
  format::PackedChunk shapes = format::pack_moments(points.shapes, edge);
  const Cube small{cube.origin, edge / 1000};
  EXPECT_FALSE(decode_shapes(KernelKind::moments, bytes_of(positions), bytes_of(shapes), 100, small, "test"));
  EXPECT_FALSE(decode_shapes(KernelKind::moments, bytes_of(positions), bytes_of(shapes), 99, cube, "test"));
  EXPECT_FALSE(decode_values(KernelKind::moments, {bytes_of(values)}, 101, "test"));
  shapes.bytes[shapes.bytes.size() / 2] ^= std::byte{1};
  EXPECT_FALSE(decode_shapes(KernelKind::moments, bytes_of(positions), bytes_of(shapes), 100, cube, "test"));
}

TEST(DecodeRows, GivesOctantSplats) {
  const Points points = random_points(300, 1, 4);
  std::vector<std::uint8_t> depths, counts;
  std::vector<float> stored;
  std::vector<vec3> gradients;
  for (std::size_t i = 0; i < 300; ++i) {
    depths.push_back(static_cast<std::uint8_t>(i % 20));
    counts.push_back(static_cast<std::uint8_t>(1 + i % 8));
    stored.push_back(i % 9 == 0 ? NAN : static_cast<float>(points.values[i].mean));
    gradients.push_back(i % 4 == 0 ? vec3(0) : vec3(1, -2, static_cast<float>(i)));
  }
  const format::PackedChunk positions = format::pack_positions(points.positions, 1e-3);
  const format::PackedChunk octants = format::pack_octants(depths, counts);
  const format::PackedChunk values = format::pack_values(stored, 1e-3, {0, 1});
  const format::PackedChunk directions = format::pack_gradients(gradients);
  auto shape_row = decode_shapes(KernelKind::octant, bytes_of(positions), bytes_of(octants), 300, cube, "test");
  const ChunkBytes gradient_bytes = bytes_of(directions);
  auto value_row = decode_values(KernelKind::octant, {bytes_of(values), &gradient_bytes}, 300, "test");
  ASSERT_TRUE(shape_row && value_row);
  const RecordRow row{std::make_shared<ShapeRow>(std::move(*shape_row)),
                      std::make_shared<ValueRow>(std::move(*value_row))};
  std::vector<dvec3> unpacked(300);
  ASSERT_TRUE(format::unpack_positions(positions.entry, positions.bytes, unpacked, cube, "test"));
  for (std::uint32_t i = 0; i < 300; ++i) {
    const OctantSplat splat = unpack_octant(row, i);
    const RecordBlock& block = row.shapes->blocks()[block_of(*row.shapes, i)];
    EXPECT_LE(glm::distance(block.origin + dvec3(splat.position), unpacked[i]), 1e-5);
    EXPECT_EQ(splat.size, static_cast<float>(std::ldexp(edge, -depths[i]) / std::cbrt(counts[i])));
    EXPECT_EQ(std::isnan(splat.value), i % 9 == 0);
    if (i % 9 != 0) {
      EXPECT_NEAR(splat.value, stored[i], 1e-3);
    }
    EXPECT_EQ(splat.gradient == 0, i % 4 == 0);
    if (i % 4 != 0) {
      EXPECT_LT(static_cast<std::int8_t>(splat.gradient >> 8), 0) << "y is negative";
    }
  }
}

}  // namespace
}  // namespace splatvol::test
