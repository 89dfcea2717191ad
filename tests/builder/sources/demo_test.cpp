// The demo's input: its mesh, its flow, and `svgen flow`, which writes them.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <random>

#include "builder/mesh/tetrahedra.h"
#include "builder/opening/open_source.h"
#include "tests/builder/sources/tetrahedron_faces.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"
#include "tools/bisection_mesh.h"
#include "tools/demo_flow.h"

namespace splatvol::test {
namespace {

using Tetrahedra = std::vector<std::array<std::uint32_t, 4>>;

/// Expects positive volumes that fill the box. Every triangle in a side of the box has one tetrahedron, every other has
/// two.
void expect_fills_box(const std::vector<dvec3>& points, const Tetrahedra& tetrahedra, dvec3 low, dvec3 high) {
  std::map<std::array<std::uint32_t, 3>, int> uses;
  double volume = 0;
  for (const auto& tetrahedron : tetrahedra) {
    const auto& [a, b, c, d] = tetrahedron;
    const double volume_6 = signed_volume_6(points[a], points[b], points[c], points[d]);
    ASSERT_GT(volume_6, 0);
    volume += volume_6 / 6;
    for (const auto& triangle : faces_of(tetrahedron)) ++uses[triangle];
  }
  const dvec3 size = high - low;
  EXPECT_NEAR(volume / (size.x * size.y * size.z), 1, 1e-12);
  for (const auto& [triangle, count] : uses) {
    bool on_side = false;
    for (int axis = 0; axis < 3; ++axis)
      for (const double side : {low[axis], high[axis]})
        on_side = on_side || std::ranges::all_of(triangle, [&](std::uint32_t p) { return points[p][axis] == side; });
    ASSERT_EQ(count, on_side ? 1 : 2);
  }
}

TEST(BisectionMesh, StaysConformingUnderAnyRefinement) {
  for (unsigned seed = 0; seed < 5; ++seed) {
    std::mt19937 random(seed);
    BisectionMesh mesh({-1, 0, 2}, {1, 3, 3});
    for (int round = 0; round < 25; ++round) {
      std::vector<char> marked(mesh.size());
      for (char& mark : marked) mark = random() % (mesh.size() < 200 ? 3 : 40) == 0;
      mesh.refine(marked);
    }
    Tetrahedra tetrahedra;
    for (std::size_t i = 0; i < mesh.size(); ++i) tetrahedra.push_back(mesh.tetrahedron(i));
    expect_fills_box(mesh.points(), tetrahedra, {-1, 0, 2}, {1, 3, 3});
  }
}

TEST(BisectionMesh, RefinesTowardsACornerWithoutSlivers) {
  BisectionMesh mesh(dvec3(0), dvec3(1));
  for (int round = 0; round < 45; ++round) {
    std::vector<char> marked(mesh.size(), 0);
    for (std::size_t i = 0; i < mesh.size(); ++i) marked[i] = std::ranges::count(mesh.tetrahedron(i), 0u) > 0;
    mesh.refine(marked);
  }
  EXPECT_GT(mesh.size(), 45u);
  EXPECT_LT(mesh.size(), 20000u) << "refined at the corner only";
  Tetrahedra tetrahedra;
  double worst = 1;
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    tetrahedra.push_back(mesh.tetrahedron(i));
    const auto& [a, b, c, d] = tetrahedra.back();
    const auto& p = mesh.points();
    double longest = 0;
    for (const auto& [u, v] : {std::pair(a, b), {a, c}, {a, d}, {b, c}, {b, d}, {c, d}})
      longest = std::max(longest, glm::distance(p[u], p[v]));
    worst = std::min(worst, signed_volume_6(p[a], p[b], p[c], p[d]) / (longest * longest * longest));
  }
  EXPECT_GT(worst, 0.05) << "Maubach: a few classes of shapes, however deep";
  expect_fills_box(mesh.points(), tetrahedra, dvec3(0), dvec3(1));
}

TEST(DemoFlow, VorticityIsTheCurlOfAVelocityWithoutSources) {
  const DemoFlow flow;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> unit(-1, 1);
  const double h = 1e-4;
  for (int i = 0; i < 200; ++i) {
    const dvec3 x(1.5 * unit(random), 1.5 * unit(random), 0.7 * unit(random));
    dmat3 gradient;  // gradient[axis] = du / dx_axis
    for (int axis = 0; axis < 3; ++axis) {
      dvec3 shift(0);
      shift[axis] = h;
      gradient[axis] = (flow.at(x + shift).velocity - flow.at(x - shift).velocity) / (2 * h);
    }
    const dvec3 curl(gradient[1].z - gradient[2].y, gradient[2].x - gradient[0].z, gradient[0].y - gradient[1].x);
    EXPECT_NEAR(gradient[0].x + gradient[1].y + gradient[2].z, 0, 1e-4);
    EXPECT_NEAR(glm::length(curl), flow.at(x).vorticity, 2e-3 * std::max(1.0, flow.at(x).vorticity));
    EXPECT_GE(flow.at(x).temperature, 0);
    EXPECT_LE(flow.at(x).temperature, 1);
  }
}

int run(const std::string& arguments) {
  return std::system((std::string(SPLATVOL_BIN) + "/svgen flow " + arguments + " 2>/dev/null").c_str());
}

TEST(SvgenFlow, WritesTheSameConformingMeshEveryTime) {
  const TempFolder folder;
  ASSERT_EQ(run("-o " + folder.path("a.vtu") + " --points 5000 --scene " + folder.path("a.json")), 0);
  ASSERT_EQ(run("-o " + folder.path("b.vtu") + " --points 5000"), 0);
  EXPECT_EQ(folder.read("a.vtu"), folder.read("b.vtu"));
  EXPECT_NE(folder.read("a.json").find("\"vorticity\""), std::string::npos);
  EXPECT_EQ(folder.names().size(), 3u) << "no temporary file is left";

  auto source = value_of(open_source({folder.path("a.vtu")}, {}));
  EXPECT_EQ(source->attributes(), (std::vector<std::string>{"vorticity", "velocity", "velocity[0]", "velocity[1]",
                                                            "velocity[2]", "pressure", "temperature"}));
  const auto piece = value_of(source->next());
  ASSERT_TRUE(piece);
  EXPECT_NEAR(static_cast<double>(piece->points.size()), 5000, 250);
  expect_fills_box(piece->points, piece->tetrahedra, DemoFlow::low, DemoFlow::high);

  EXPECT_NE(run(""), 0);
  EXPECT_NE(run("-o " + folder.path("nowhere/a.vtu") + " --points 1000"), 0);
}

}  // namespace
}  // namespace splatvol::test
