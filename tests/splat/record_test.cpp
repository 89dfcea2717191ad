#include "splat/record.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace splatvol {
namespace {

std::vector<MomentsSplat> random_materials(std::size_t count, double smallest) {
  std::mt19937 engine(1);
  std::uniform_real_distribution<double> number(0, 1);
  std::vector<MomentsSplat> materials(count);
  for (MomentsSplat& m : materials) {
    m.center = 100.0 * dvec3(number(engine), number(engine), number(engine));
    m.mass = std::exp2(-40 * number(engine));
    const double size = smallest * std::exp2(10 * number(engine));
    m.deviations = {size, size * 0.5, size * 0.1};
    m.orientation = glm::normalize(
        glm::dquat(number(engine) - 0.5, number(engine) - 0.5, number(engine) - 0.5, number(engine) - 0.5));
    m.boundary = 3.0 * dvec3(number(engine) - 0.5, 0, number(engine) - 0.5);
    m.value = number(engine);
    m.value_deviation = 0.1 * number(engine);
    m.correlations = dvec3(number(engine), -number(engine), 0.5);
  }
  return materials;
}

TEST(LogCode, ComesBackWithinHalfAStep) {
  for (const double number : {1.0, 0.3, 1e-20, 1e-100}) {
    const double back = log_number(log_code(number, 1.0), 1.0);
    EXPECT_NEAR(std::log2(back / number), 0, 1.0 / 256 + 1e-12) << number;
  }
  EXPECT_EQ(log_code(0, 1.0), 0);
  EXPECT_EQ(log_code(1e-300, 1.0), 1);  // too small for the scale, and still not nothing
  EXPECT_EQ(log_number(largest_log_code, 0.7), 0.7);
  EXPECT_EQ(log_number(0, 0.7), 0);
}

TEST(PackedPosition, HoldsOffsetsToTheLast) {
  for (const glm::ivec3 offset :
       {glm::ivec3(0), glm::ivec3(largest_offset, -largest_offset, 1), glm::ivec3(-1, -2, -largest_offset)})
    EXPECT_EQ(PackedPosition::pack(offset).offset(), offset);
}

TEST(PackedOrientation, TurnsAxesAsBefore) {
  for (const MomentsSplat& m : random_materials(500, 1)) {
    const dmat3 before = glm::mat3_cast(m.orientation);
    const dmat3 after = glm::mat3_cast(PackedOrientation::unpack(PackedOrientation::pack(m.orientation)));
    for (int k = 0; k < 3; ++k) EXPECT_LT(glm::distance(before[k], after[k]), 1e-5);
  }
}

TEST(RecordRow, HoldsMaterials) {
  const std::vector<MomentsSplat> materials = random_materials(500, 0.01);
  const dvec3 origin(1e6, -1e6, 0);
  const double length = 0.25;
  const RecordRow row = pack_row(materials, origin, length);
  ASSERT_EQ(row.shapes->size(), materials.size());
  ASSERT_EQ(row.values->size(), materials.size());
  for (std::uint32_t i = 0; i < materials.size(); ++i) {
    const MomentsSplat &before = materials[i], after = unpack(row, i);
    const RecordBlock& block = row.shapes->blocks()[block_of(*row.shapes, i)];
    const dvec3 center = (block.origin - origin) / length + after.center;
    EXPECT_LT(glm::distance(center, before.center), before.deviations.z / 32);
    EXPECT_NEAR(std::log2(after.mass / before.mass), 0, 1.0 / 255);
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(std::log2(after.deviations[k] / before.deviations[k]), 0, 1.0 / 255);
      EXPECT_NEAR(after.boundary[k], before.boundary[k], 0.5 / 128 + 1e-9);
      EXPECT_NEAR(after.correlations[k], before.correlations[k], 0.5 / 127 + 1e-9);
    }
    EXPECT_NEAR(after.value, before.value, 1e-7);
    EXPECT_NEAR(std::log2(after.value_deviation / before.value_deviation), 0, 1.0 / 255);
  }
}

// A small splat far from others needs steps as small as itself.
TEST(RecordRow, SplitsIntoBlocksForSmallSplats) {
  std::vector<MomentsSplat> materials(4);
  materials[1].center = dvec3(1e-9, 0, 0);
  materials[2].center = dvec3(1, 1, 1);
  materials[3].center = dvec3(2, 2, 2);
  for (std::size_t i = 0; i < 4; ++i) {
    materials[i].mass = 1;
    materials[i].deviations = dvec3(i < 2 ? 1e-10 : 1);
  }
  const RecordRow row = pack_row(materials, dvec3(0), 1);
  ASSERT_EQ(row.shapes->blocks().size(), 2U);
  EXPECT_EQ(row.shapes->blocks()[0].end, 2U);
  const auto world = [&](std::uint32_t i) {
    return row.shapes->blocks()[block_of(*row.shapes, i)].origin + unpack(row, i).center;
  };
  EXPECT_LT(glm::distance(world(1) - world(0), dvec3(1e-9, 0, 0)), 1e-12);
  EXPECT_LT(glm::distance(world(3), dvec3(2)), 1e-5);

  DrawList list;
  append(list, row, 1, 2);
  ASSERT_EQ(list.ranges.size(), 2U);
  EXPECT_EQ(list.splats, 2U);
  EXPECT_EQ(list.ranges[0], (DrawRange{row, 0, 1, 1}));
  EXPECT_EQ(list.ranges[1], (DrawRange{row, 1, 2, 1}));
}

TEST(RecordRow, HoldsOctantSplats) {
  const std::vector<OctantSplat> splats{{vec3(1, 2, 3), 0.5F, 0.25F, 7}, {vec3(-1, 0, 3), 0.75F, 0.5F, 0}};
  const RecordRow row = pack_row(splats, dvec3(10), 2);
  for (std::uint32_t i = 0; i < 2; ++i) {
    const OctantSplat splat = unpack_octant(row, i);
    const dvec3 position = row.shapes->blocks()[0].origin + 2.0 * dvec3(splat.position);
    EXPECT_LT(glm::distance(position, 10.0 + 2.0 * dvec3(splats[i].position)), 1e-5);
    EXPECT_EQ(splat.value, splats[i].value);
    EXPECT_EQ(splat.size, splats[i].size);
    EXPECT_EQ(splat.gradient, splats[i].gradient);
  }
}

}  // namespace
}  // namespace splatvol
