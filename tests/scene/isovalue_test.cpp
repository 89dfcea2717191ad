// Shells round one value.
#include "scene/isovalue.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

namespace splatvol {
namespace {

using ::testing::HasSubstr;

Scene scene_with(ValueAxis axis) {
  Scene scene;
  scene.attribute.assign(1, 'p');  // g++ 12 warns of an assigned literal
  scene.camera.position = {1, 2, 3};
  TransferFunction& function = scene.transfer_function;
  function.axis = axis;
  function.lo = axis == ValueAxis::log ? 0.01 : -2;
  function.hi = 100;
  if (axis == ValueAxis::asinh) function.linear_width = 3;
  function.colors = {{0, dvec3(0)}, {1, dvec3(1)}};
  function.densities = {{0, 1}, {1, 2}};
  return scene;
}

TEST(Isovalue, IsAPeakOfItsWidth) {
  for (const ValueAxis axis : {ValueAxis::linear, ValueAxis::log, ValueAxis::asinh}) {
    Scene scene = scene_with(axis);
    TransferFunction& function = scene.transfer_function;
    EXPECT_FALSE(isovalue_of(function));
    const Isovalue wanted{7.3, 0.5, 20};
    function.densities = densities_of(function, wanted);
    EXPECT_NEAR(function.extinction(7.3), 20, 1e-9);
    EXPECT_NEAR(function.extinction(7.3 + 0.125), 10, 0.3);
    for (const double outside : {-1.0, 0.02, 7.04, 7.56, 99.0, 1e6}) EXPECT_EQ(function.extinction(outside), 0);
    const auto found = isovalue_of(function);
    ASSERT_TRUE(found);
    EXPECT_EQ(*found, wanted) << "the numbers that were meant";
  }
}

TEST(Isovalue, EndsWithTheDomain) {
  Scene scene = scene_with(ValueAxis::linear);
  TransferFunction& function = scene.transfer_function;
  for (const double value : {-2.0, 100.0, -1.9, 99.9}) {
    function.densities = densities_of(function, {value, 1, 5});
    EXPECT_NEAR(function.extinction(std::min(value, 100 - 1e-9)), 5, 1e-6);
    EXPECT_EQ(function.extinction(-2.001), 0);
    EXPECT_EQ(function.extinction(100.001), 0);
    const auto found = isovalue_of(function);
    ASSERT_TRUE(found);
    EXPECT_NEAR(found->value, value, 1e-9);
    EXPECT_NEAR(found->width, 1, 1e-9);
  }
  function.densities = densities_of(function, {10, 1e9, 5});
  EXPECT_NEAR(function.extinction(55), 2.5, 0.1) << "wider than the domain";
}

TEST(Isovalue, ShowsALitShellAndWidensTheDomain) {
  Scene scene = scene_with(ValueAxis::linear);
  ASSERT_TRUE(show_isovalue(scene, 130, std::nullopt, 10));
  EXPECT_NEAR(scene.transfer_function.hi, 131.32, 1e-9);
  EXPECT_EQ(scene.lighting, Lighting());
  EXPECT_GT(scene.transfer_function.extinction(130), 1);

  // The denser the thinner: the optical depth stays.
  Scene thin = scene_with(ValueAxis::linear), thick = thin;
  ASSERT_TRUE(show_isovalue(thin, 50, 1, 10));
  ASSERT_TRUE(show_isovalue(thick, 50, 4, 10));
  EXPECT_NEAR(thin.transfer_function.extinction(50), 4 * thick.transfer_function.extinction(50), 1e-6);
  Scene logarithmic = scene_with(ValueAxis::log);
  const Scene before = logarithmic;
  EXPECT_THAT(show_isovalue(logarithmic, -1, std::nullopt, 10).error().message, HasSubstr("not above 0"));
  EXPECT_EQ(logarithmic, before);
}

TEST(Isovalue, ComesBackFromAFileByItsName) {
  for (const ValueAxis axis : {ValueAxis::linear, ValueAxis::log, ValueAxis::asinh}) {
    Scene scene = scene_with(axis);
    scene.transfer_function.densities = densities_of(scene.transfer_function, {12.7, 0.3, 20.25});
    const auto document = nlohmann::json::parse(scene_to_json(scene));
    const nlohmann::json& function = document.at("transfer_function");
    EXPECT_FALSE(function.contains("density"));
    EXPECT_EQ(function.at("isovalue"), nlohmann::json({{"value", 12.7}, {"width", 0.3}, {"density", 20.25}}));
    EXPECT_EQ(parse_scene(document.dump()).value().transfer_function, scene.transfer_function);
  }
}

TEST(Isovalue, NamesTheWrongPart) {
  auto document = nlohmann::json::parse(scene_to_json(scene_with(ValueAxis::linear)));
  nlohmann::json& function = document.at("transfer_function");
  const auto error_of = [&](const nlohmann::json& isovalue) {
    function["isovalue"] = isovalue;
    const auto scene = parse_scene(document.dump());
    return scene ? std::string("accepted") : scene.error().message;
  };
  EXPECT_THAT(error_of({{"value", 1}, {"width", 1}, {"density", 1}}), HasSubstr("both density and isovalue"));
  function.erase("density");
  EXPECT_EQ(error_of({{"value", 1}, {"width", 1}, {"density", 1}}), "accepted");
  EXPECT_THAT(error_of({{"value", 101}, {"width", 1}, {"density", 1}}), HasSubstr("isovalue.value: 101 is outside"));
  EXPECT_THAT(error_of({{"value", 1}, {"width", 0}, {"density", 1}}), HasSubstr("isovalue.width: not above 0"));
  EXPECT_THAT(error_of({{"value", 1}, {"width", 1}, {"density", -1}}), HasSubstr("isovalue.density: -1 is negative"));
  EXPECT_THAT(error_of({{"value", 1}, {"width", 1}}), HasSubstr("isovalue.density: missing"));
  EXPECT_THAT(error_of({{"value", 1}, {"wide", 1}}), HasSubstr("isovalue.wide: no such field"));
  EXPECT_THAT(error_of(7), HasSubstr("not an object"));
}

}  // namespace
}  // namespace splatvol
