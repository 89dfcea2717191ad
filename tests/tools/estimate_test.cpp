// svbuild --estimate beside builds.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/support/program_json.h"

namespace splatvol::test {
namespace {

using nlohmann::json;

struct Estimate : ProgramTest {
  // Expects that the middle of the estimated size is within a factor of 2 of the real one.
  void expect_size(const std::string& input) const {
    const json estimate = document_of(run("svbuild --estimate --json " + input));
    EXPECT_TRUE(std::filesystem::is_empty(folder_) || !std::filesystem::exists(path("out.svol")));
    const json built = document_of(run("svbuild --json -o out.svol " + input));
    ASSERT_TRUE(estimate.contains("file_bytes") && built.contains("file_bytes")) << input;
    const double low = estimate["file_bytes"][0], high = estimate["file_bytes"][1], real = built["file_bytes"];
    EXPECT_GT(std::sqrt(low * high), real / 2) << input;
    EXPECT_LT(std::sqrt(low * high), real * 2) << input;
    EXPECT_EQ(estimate["connectivity"], built["connectivity"]) << input;
    EXPECT_LT(estimate["least_memory"].get<double>(), estimate["memory_bytes"][1].get<double>()) << input;
    std::filesystem::remove(path("out.svol"));
  }

  // A table of points at random with some smooth values.
  void write_table(const std::string& name, int points, int attributes) const {
    std::ofstream out(path(name));
    out << "x,y,z";
    for (int a = 0; a < attributes; ++a) out << ",v" << a;
    std::uint32_t state = 1;
    const auto random = [&state] {
      return static_cast<double>((state = state * 1664525 + 1013904223) >> 8) / (1 << 24);
    };
    for (int i = 0; i < points; ++i) {
      const double x = random(), y = random(), z = random();
      out << fmt::format("\n{},{},{}", x, y, z);
      for (int a = 0; a < attributes; ++a) out << ',' << std::sin((5 + a) * x + a) * std::cos(4 * y + a * z);
    }
    out << '\n';
  }
};

TEST_F(Estimate, IsWithinAFactorOfTwoOfTheFile) {
  expect_size("gen:points:count=2e4");
  expect_size("gen:points:count=2e5 --connectivity boxes");
  expect_size("gen:mesh:cells=3e5");
  expect_size("gen:points:count=2e5 --connectivity boxes --exact");
  expect_size("gen:points:count=2e4");
}

TEST_F(Estimate, OfSeveralAttributesIsToo) {
  write_table("three.csv", 20000, 3);
  write_table("nine.csv", 20000, 9);
  expect_size("three.csv");
  expect_size("nine.csv --connectivity boxes");
  expect_size("nine.csv --attribute v3 --connectivity boxes");
}

TEST_F(Estimate, OfMeshFilesIsToo) {
  expect_done("svgen mesh --cells 1e5 -o mesh");
  expect_size("mesh");
  expect_size("mesh --cells own");
  const json estimate = document_of(run("svbuild --estimate --json mesh"));
  EXPECT_TRUE(estimate["counted_by_reading"].get<bool>());
  EXPECT_GT(estimate["reader_bytes"].get<double>(), 1 << 20);
}

TEST_F(Estimate, WritesNothing) {
  expect_done("svbuild --estimate gen:points:count=1e12");
  expect_done("svbuild --estimate gen:points:count=1e5 -o out.svol --temp .");
  expect_done("svbuild --estimate gen:mesh:cells=1e4 -o out.svol");
  EXPECT_TRUE(std::filesystem::is_empty(folder_));
}

TEST_F(Estimate, RefusesWhatABuildRefuses) {
  expect_refusal("svbuild --estimate none.vtu", "none.vtu");
  expect_refusal("svbuild --estimate gen:points:count=1e5 --times all", "no time steps");
  expect_refusal("svbuild --estimate gen:points:count=1e5 -o out.png", "out.png", 2);
  expect_refusal("svbuild gen:points:count=1e5", "--output is required", 2);
  expect_refusal("svbuild --estimate", "inputs", 2);
}

TEST_F(Estimate, IsForReaders) {
  const Outcome outcome = run("svbuild --estimate gen:points:count=1e7 --threads 3 --memory 1G");
  EXPECT_EQ(outcome.code, 0);
  for (const std::string words : {"10000000 points", "of disk", "of memory", "on 3 threads", "1 GiB", "as it declares"})
    EXPECT_THAT(outcome.text, testing::HasSubstr(words));
}

}  // namespace
}  // namespace splatvol::test
