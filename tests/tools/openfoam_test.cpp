// Time series of cases that OpenFOAM itself has computed.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "tests/support/programs.h"

namespace splatvol::test {
namespace {

namespace fs = std::filesystem;

// Debian's programs look for their settings there.
constexpr const char* environment = "env WM_PROJECT_DIR=/usr/share/openfoam";

// A cavity whose lid moves, 3-D: icoFoam's tutorial with cubic cells.
struct OpenFoamSeries : ProgramTest {
  void SetUp() override {
    for (const char* program : {"blockMesh", "polyDualMesh", "icoFoam", "decomposePar"})
      if (run(fmt::format("command -v {}", program)).code != 0)
        GTEST_SKIP() << "no " << program << " on this machine (Debian's package openfoam)";
    write_settings();
    write("constant/transportProperties", "dictionary", "transportModel Newtonian; nu 0.01;");
    write("0/p", "volScalarField",
          "dimensions [0 2 -2 0 0 0 0]; internalField uniform 0;\n"
          "boundaryField { lid { type zeroGradient; } walls { type zeroGradient; } }");
    write("0/U", "volVectorField",
          "dimensions [0 1 -1 0 0 0 0]; internalField uniform (0 0 0);\n"
          "boundaryField { lid { type fixedValue; value uniform (1 0 0); } walls { type noSlip; } }");
    compute("blockMesh");
  }

  void write_settings() const {
    write("system/blockMeshDict", "dictionary",
          "convertToMeters 0.1; edges ();\n"
          "vertices ((0 0 0)(1 0 0)(1 1 0)(0 1 0)(0 0 1)(1 0 1)(1 1 1)(0 1 1));\n"
          "blocks (hex (0 1 2 3 4 5 6 7) (6 6 6) simpleGrading (1 1 1));\n"
          "boundary (lid { type wall; faces ((3 7 6 2)); } walls { type wall;\n"
          "  faces ((0 4 7 3)(2 6 5 1)(1 5 4 0)(0 3 2 1)(4 5 6 7)); });");
    write("system/controlDict", "dictionary",
          "application icoFoam; startFrom startTime; startTime 0; stopAt endTime; endTime 0.04; deltaT 0.005;\n"
          "writeControl timeStep; writeInterval 4; writeFormat binary; writePrecision 8; timePrecision 6;");
    write("system/fvSchemes", "dictionary",
          "ddtSchemes { default Euler; } gradSchemes { default Gauss linear; }\n"
          "divSchemes { default none; div(phi,U) Gauss linear; }\n"
          "laplacianSchemes { default Gauss linear corrected; }\n"
          "interpolationSchemes { default linear; } snGradSchemes { default corrected; }");
    write("system/fvSolution", "dictionary",
          "solvers { p { solver PCG; preconditioner DIC; tolerance 1e-6; relTol 0.05; } pFinal { $p; relTol 0; }\n"
          "U { solver smoothSolver; smoother symGaussSeidel; tolerance 1e-5; relTol 0; } }\n"
          "PISO { nCorrectors 2; nNonOrthogonalCorrectors 0; pRefCell 0; pRefValue 0; }");
    write("system/decomposeParDict", "dictionary",
          "numberOfSubdomains 2; method simple; coeffs { n (2 1 1); delta 0.001; }");
  }
  void write(const std::string& name, const std::string& kind, const std::string& text) const {
    FolderTest::write("flow/" + name,
                      fmt::format("FoamFile {{ version 2.0; format ascii; class {}; object {}; }}\n{}\n", kind,
                                  fs::path(name).filename().string(), text));
  }
  void compute(const std::string& program) const {
    const Outcome outcome = run(fmt::format("cd flow && {} {}", environment, program));
    ASSERT_EQ(outcome.code, 0) << program << ": " << outcome.text;
  }

  // Expects that each step has the points, values and moments of a file that is built at its time. `first`, `rest`: the
  // times before an append, and those that it adds.
  void expect_steps(const std::string& first, const std::string& rest) const {
    expect_done("svbuild flow --times all -o all.svol");
    expect_done("svinfo all.svol --verify");
    const std::vector<std::string> times = {"0", "0.02", "0.04"};
    // By name: where values agree, a single file stores attributes once, and lists their other names last.
    const std::string attributes =
        "--attribute p --attribute U --attribute 'U[0]' --attribute 'U[1]' --attribute 'U[2]'";
    for (std::size_t step = 0; step < times.size(); ++step) {
      expect_done(fmt::format("svbuild flow --time {} -o one.svol", times[step]));
      expect_done("svexport one.svol -o one.vtu " + attributes);
      expect_done(fmt::format("svexport all.svol --step {} -o step.vtu {}", step, attributes));
      EXPECT_TRUE(read("one.vtu") == read("step.vtu")) << step;
    }
    // At the beginning all values are zero. Points merge as they do later.
    expect_done(fmt::format("svbuild flow --times {} -o grown.svol", first));
    expect_done(fmt::format("svbuild flow --times {} --append -o grown.svol", rest));
    expect_done("svexport grown.svol --step 2 -o grown.vtu " + attributes);
    EXPECT_TRUE(read("one.vtu") == read("grown.vtu"));
  }
  void decompose() const {
    compute("decomposePar -time 0:1");
    for (const char* name : {"0", "0.02", "0.04", "constant/polyMesh"}) fs::remove_all(path("flow") + "/" + name);
  }
};

TEST_F(OpenFoamSeries, PatchesAreTheBoundary) {
  const auto expect_patches = [&](int lid, int walls) {
    const Outcome outcome = run("svbuild flow --boundary -o one.svol");
    EXPECT_EQ(outcome.code, 0) << outcome.text;
    EXPECT_THAT(outcome.text, testing::HasSubstr(fmt::format("{} of patch \"lid\"", lid)));
    EXPECT_THAT(outcome.text, testing::HasSubstr(fmt::format("{} of patch \"walls\"", walls)));
    EXPECT_THAT(outcome.text, testing::Not(testing::HasSubstr("outer")));
    expect_done("svinfo one.svol --verify");
  };
  compute("icoFoam");
  expect_patches(72, 360);
  expect_done("svbuild flow --boundary --times all -o all.svol");
  EXPECT_THAT(run("svinfo all.svol --verify").text, testing::HasSubstr("walls"));
  expect_refusal("svbuild flow --boundary --times 0.02: --append -o all.svol",
                 "an append does not change the boundary");
  decompose();
  expect_patches(72, 360);
}

TEST_F(OpenFoamSeries, OfHexahedra) {
  compute("icoFoam");
  expect_steps("0:0.01", "0.02:");
  decompose();
  expect_steps("0:0.01", "0.02:");
}

TEST_F(OpenFoamSeries, OfPolyhedra) {
  compute("polyDualMesh 75 -overwrite");
  compute("icoFoam");
  const std::string patches = run("svbuild flow --boundary -o one.svol").text;
  EXPECT_THAT(patches, testing::HasSubstr("158 of patch \"lid\""));
  EXPECT_THAT(patches, testing::Not(testing::HasSubstr("outer")));
  // Their file keeps positions exactly. If all its values were zero it would be exact, and so would appended steps.
  expect_steps("0:0.03", "0.04:");
  decompose();
  expect_steps("0:0.03", "0.04:");
}

}  // namespace
}  // namespace splatvol::test
