// svinfo --integrate.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "tests/builder/support/built_mesh.h"
#include "tests/support/program_json.h"

namespace splatvol::test {
namespace {

using nlohmann::json;
using namespace ::testing;

struct SvinfoIntegrals : ProgramTest {
  SvinfoIntegrals() {
    build_mesh(lattice(4), [](dvec3 p) { return p.x + 2 * p.y; }, path("cube.svol"),
               {.exact = {.positions = true, .values = true}, .keep_cells = true});
  }
};

TEST_F(SvinfoIntegrals, AreOverThePartsOfCellsInTheRegion) {
  const json all = document_of(run("svinfo cube.svol --integrate --json"));
  EXPECT_DOUBLE_EQ(all["volume"], 1);
  EXPECT_EQ(all["unknown_volume"], 0);
  EXPECT_EQ(all["left_out"], 0);
  ASSERT_EQ(all["attributes"].size(), 1u);
  const json& value = all["attributes"][0];
  EXPECT_EQ(value["name"], "value");
  EXPECT_DOUBLE_EQ(value["volume"], 1);
  EXPECT_EQ(value["missing_volume"], 0);
  EXPECT_DOUBLE_EQ(value["integral"], 1.5);
  EXPECT_DOUBLE_EQ(value["mean"], 1.5);
  EXPECT_EQ(value["min"], 0);
  EXPECT_EQ(value["max"], 3);
  EXPECT_EQ(value["max_at"][1], 1);

  // A prism: x + 2 y <= .4, z from .4 to .9.
  const json part =
      document_of(run("svinfo cube.svol --integrate --json --box -1,-1,0.4,2,2,2 --clip-plane 0,0,0.9:0,0,-1 "
                      "--range value=:0.4 --attribute value --memory 1M"));
  EXPECT_DOUBLE_EQ(part["volume"], 0.5 * 0.04);
  EXPECT_DOUBLE_EQ(part["attributes"][0]["mean"], 0.8 / 3);
  EXPECT_EQ(part["attributes"][0]["max"], 0.4);

  const json none = document_of(run("svinfo cube.svol --integrate --json --box 2,2,2,3,3,3"));
  EXPECT_EQ(none["volume"], 0);
  EXPECT_TRUE(none["attributes"][0]["mean"].is_null());

  EXPECT_THAT(
      run("svinfo cube.svol --integrate --range value=1:2").out,
      AllOf(ContainsRegex("a volume of 0.5\n"), ContainsRegex("value +0.75 +1.5 +1 +2"), HasSubstr("min at (")));
}

TEST_F(SvinfoIntegrals, AreOverSurfaces) {
  const json slice = document_of(run("svinfo cube.svol --integrate --json --slice 0,0,0.3:0,0,2 --box 0,0,0,0.5,1,1"));
  EXPECT_DOUBLE_EQ(slice["area"], 0.5);
  EXPECT_DOUBLE_EQ(slice["attributes"][0]["mean"], 1.25);
  EXPECT_DOUBLE_EQ(slice["attributes"][0]["area"], 0.5);
  EXPECT_TRUE(slice["flux"].is_null());
  const json contour = document_of(run("svinfo cube.svol --integrate --json --contour value=1"));
  EXPECT_NEAR(contour["area"], std::sqrt(5.0) / 2, 1e-12);
  EXPECT_EQ(contour["attributes"][0]["mean"], 1);
  EXPECT_TRUE(contour["enclosed_volume"].is_null());
  EXPECT_THAT(run("svinfo cube.svol --integrate --slice 0.5,0,0:1,0,0").out,
              AllOf(ContainsRegex("an area of 1\n"), ContainsRegex("value +1.5 +1.5 +0.5 +2.5")));
}

TEST_F(SvinfoIntegrals, SayWhatIsWrong) {
  expect_refusal("svinfo cube.svol --integrate --attribute heat", "value");
  expect_refusal("svinfo cube.svol --integrate --range heat=0:1", "value");
  expect_refusal("svinfo cube.svol --integrate --contour heat=0", "value");
  expect_refusal("svinfo cube.svol --integrate --contour value=1 --flux U", "U[0]");
  for (const std::string arguments :
       {"--box 0,0,0,1,1,1", "--range value=0:1", "--integrate --range value", "--integrate --range =1:2",
        "--integrate --range value=2:1", "--integrate --range value=a:b", "--integrate --box 1,0,0,0,1,1",
        "--integrate --clip-plane 0,0,0:0,0,0", "--contour value=1", "--integrate --contour value",
        "--integrate --contour value=1 --slice 0,0,0:1,0,0", "--integrate --slice 0,0,0", "--integrate --flux U",
        "--integrate --scene view.json", "--attribute value"})
    EXPECT_EQ(run("svinfo cube.svol " + arguments).code, 2) << arguments;
}

}  // namespace
}  // namespace splatvol::test
