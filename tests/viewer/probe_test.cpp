// The probe under the pointer, for known splats.
#include <gtest/gtest.h>

#include <cmath>

#include "viewer/probe.h"

namespace splatvol {
namespace {

TransferFunction constant(double extinction) {
  TransferFunction function;
  function.colors = {{0, dvec3(1)}};
  function.densities = {{0, extinction}};
  return function;
}

Material ball(const dvec3& center, double deviation, double mass, double value) {
  Material splat;
  splat.center = center;
  splat.deviations = dvec3(deviation);
  splat.mass = mass;
  splat.value = value;
  return splat;
}

View view_along_z(bool orthographic) {
  Camera camera;
  camera.projection = orthographic ? Camera::Projection::orthographic : Camera::Projection::perspective;
  camera.parallel_height = 4;
  camera.position = {1e6, 0, 10};
  camera.focal_point = {1e6, 0, 0};
  return make_view(camera, 200, 100).value();
}

template <class Splat>
DrawList list_of(const std::vector<Splat>& splats) {
  DrawList list;
  append(list, pack_row(splats, {1e6, 0, 0}, 1), 0, static_cast<std::uint32_t>(splats.size()), 1);
  return list;
}

TEST(Probe, FindsTheFirstOfTwoOpaqueSplats) {
  for (const bool orthographic : {false, true}) {
    const std::vector<Material> splats = {ball({0, 0, -2}, 0.1, 10, 1), ball({0, 0, 2}, 0.1, 10, 5)};
    const auto found =
        probe(list_of(splats), constant(1000), {.value_offset = 100}, view_along_z(orthographic), 100, 50);
    ASSERT_TRUE(found);
    EXPECT_EQ(found->value, 105);  // the nearer one, with the offset
    EXPECT_NEAR(found->position.z, 2, 1e-9);
    EXPECT_NEAR(found->position.x, 1e6, 1e-6);
    EXPECT_NEAR(found->opacity, 1, 1e-12);
  }
}

TEST(Probe, OpacityIsTheIntegralAlongTheRay) {
  constexpr double deviation = 0.3, mass = 0.02, extinction = 2;
  const std::vector<Material> splats = {ball({0, 0, 0}, deviation, mass, 1), ball({0, 0, -5}, 0.1, 0, 1)};
  const auto found = probe(list_of(splats), constant(extinction), {}, view_along_z(true), 100, 50);
  ASSERT_TRUE(found);
  // A ray through the middle meets the mass over the Gaussian's area.
  const double depth = extinction * mass / (2 * 3.14159265358979 * deviation * deviation);
  EXPECT_NEAR(found->opacity, 1 - std::exp(-depth), 1e-6);
}

TEST(Probe, MeetsNothingBesideOrBehind) {
  const std::vector<Material> splats = {ball({1.5, 0, 0}, 0.1, 10, 1), ball({0, 0, 20}, 0.1, 10, 5)};
  const auto at = [&](double x) { return probe(list_of(splats), constant(1000), {}, view_along_z(true), x, 50); };
  EXPECT_FALSE(at(100));
  ASSERT_TRUE(at(100 + 1.5 * 25));
  EXPECT_FALSE(probe(list_of(splats), constant(0), {}, view_along_z(true), 137.5, 50));
}

TEST(Probe, SeesFlatSplatsAndOctants) {
  std::vector<Material> flat = {ball({0, 0, 0}, 1, 1, 3), ball({0, 0, 0}, 0.1, 0, 0)};
  flat[0].deviations.z = 0;  // faces the eye
  const auto found = probe(list_of(flat), constant(10), {}, view_along_z(true), 100, 50);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->value, 3);
  EXPECT_NEAR(found->position.z, 0, 1e-9);

  const std::vector<OctantSplat> octants = {{{0, 0, 1}, 7, 0.5f, 0}, {{0, 0, 0}, std::nanf(""), 0.5f, 0}};
  const auto round = probe(list_of(octants), constant(100), {}, view_along_z(true), 100, 50);
  ASSERT_TRUE(round);
  EXPECT_EQ(round->value, 7);
}

}  // namespace
}  // namespace splatvol
