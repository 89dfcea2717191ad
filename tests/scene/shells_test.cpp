// Shells that stand for contours, and the peaks of older scenes.
#include "scene/shells.h"

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

// Scenes of earlier versions have a peak by its value and its width.
TEST(Isovalue, IsAPeakOfItsWidth) {
  for (const ValueAxis axis : {ValueAxis::linear, ValueAxis::log, ValueAxis::asinh}) {
    auto document = nlohmann::json::parse(scene_to_json(scene_with(axis)));
    nlohmann::json& written = document.at("transfer_function");
    written.erase("density");
    written["isovalue"] = {{"value", 7.3}, {"width", 0.5}, {"density", 20}};
    const TransferFunction function = parse_scene(document.dump()).value().transfer_function;
    EXPECT_NEAR(function.extinction(7.3), 20, 1e-9);
    EXPECT_NEAR(function.extinction(7.3 + 0.125), 10, 0.3);
    for (const double outside : {-1.0, 0.02, 7.04, 7.56, 99.0, 1e6}) EXPECT_EQ(function.extinction(outside), 0);
  }
}

TEST(Isovalue, EndsWithTheDomain) {
  auto document = nlohmann::json::parse(scene_to_json(scene_with(ValueAxis::linear)));
  nlohmann::json& written = document.at("transfer_function");
  written.erase("density");
  for (const double value : {-2.0, 100.0, -1.9, 99.9}) {
    written["isovalue"] = {{"value", value}, {"width", 1}, {"density", 5}};
    const TransferFunction function = parse_scene(document.dump()).value().transfer_function;
    EXPECT_NEAR(function.extinction(std::min(value, 100 - 1e-9)), 5, 1e-6);
    EXPECT_EQ(function.extinction(-2.001), 0);
    EXPECT_EQ(function.extinction(100.001), 0);
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

Scene with_contours(ValueAxis axis) {
  Scene scene = scene_with(axis);
  scene.transfer_function.densities = {{0, 0}};
  scene.contours = {{.values = {10, 30}, .opacity = 0.5}, {.values = {200}, .color = dvec3(0, 0, 1)}};
  return scene;
}

TEST(Shells, StandForContours) {
  for (const ValueAxis axis : {ValueAxis::linear, ValueAxis::log, ValueAxis::asinh}) {
    const Scene scene = with_contours(axis);
    const TransferFunction shells = with_shells(scene, 10).transfer_function;
    EXPECT_TRUE(with_shells(scene, 10).contours.empty());
    for (const double value : {10.0, 30.0, 200.0}) EXPECT_GT(shells.extinction(value), 0) << value;
    EXPECT_GT(shells.extinction(200), shells.extinction(10)) << "opaque";
    for (const double value : {1.0, 18.0, 80.0}) EXPECT_EQ(shells.extinction(value), 0) << value;
    EXPECT_EQ(shells.color(200), dvec3(0, 0, 1));
    for (const double value : {10.0, 30.0, 80.0})
      EXPECT_NEAR(shells.color(value).r, scene.transfer_function.color(value).r, 1e-9) << value;
  }
}

TEST(Shells, LeaveTheVolumeAsItIs) {
  Scene scene = with_contours(ValueAxis::linear);
  scene.transfer_function.densities = {{0, 1}, {1, 2}};
  const double of_shell =
      with_shells(scene, 10).transfer_function.extinction(200) - scene.transfer_function.extinction(200);
  for (const double factor : {1.0, 4.0}) {
    scene.transfer_function.density_factor = factor;
    const TransferFunction shells = with_shells(scene, 10).transfer_function;
    for (const double value : {-1.0, 20.0, 50.0, 99.0, 150.0})
      EXPECT_NEAR(shells.extinction(value), scene.transfer_function.extinction(value), 1e-9) << value;
    EXPECT_NEAR(shells.extinction(200) - scene.transfer_function.extinction(200), of_shell, 1e-9 * of_shell);
  }
  scene.contours.clear();
  EXPECT_EQ(with_shells(scene, 10), scene);
}

// Two shells share what lies between them. A logarithmic axis has no negative values.
TEST(Shells, OfHardContours) {
  Scene scene = with_contours(ValueAxis::linear);
  scene.contours = {{.values = {50, 50.001, -2, 100}}};
  const TransferFunction shells = with_shells(scene, 10).transfer_function;
  EXPECT_TRUE(std::ranges::is_sorted(shells.densities, {}, &TransferFunction::Density::t));
  for (const double value : {50.0, 50.001, -2.0, 100.0}) EXPECT_GT(shells.extinction(value), 0) << value;
  Scene logarithmic = with_contours(ValueAxis::log);
  logarithmic.contours = {{.values = {-5}}};
  EXPECT_EQ(with_shells(logarithmic, 10).transfer_function, logarithmic.transfer_function);
}

}  // namespace
}  // namespace splatvol
