// svrender's options and statistics.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>

#include "format/boundary.h"
#include "pictures/image.h"
#include "tests/support/program_json.h"
#include "tests/support/test_volume.h"

namespace splatvol {
namespace {

using testing::HasSubstr;

using test::Outcome;

class Svrender : public test::ProgramTest {
 protected:
  void SetUp() override {
    ASSERT_TRUE(test::write_test_volume(test::volume_of_x(2000), path("v.svol")));
    scene_ = {{"camera",
               {{"position", {0.5, 0.5, 4}},
                {"focal_point", {0.5, 0.5, 0.5}},
                {"up", {0, 1, 0}},
                {"vertical_fov_degrees", 30}}},
              {"image", {{"width", 64}, {"height", 48}}},
              {"background", {0, 0, 0}},
              {"attribute", "a0"},
              {"transfer_function",
               {{"domain", {0, 1}}, {"colors", {{0, 1, 0.5, 0.25}, {1, 1, 0.5, 0.25}}}, {"density", {{0, 3}, {1, 3}}}}},
              {"lighting", false}};
    write_scene();
  }
  void write_scene() const { write("s.json", scene_.dump()); }

  Outcome run(const std::string& arguments) const { return ProgramTest::run("svrender " + arguments); }
  void expect_refusal(const std::string& arguments, const std::string& reason) const {
    ProgramTest::expect_refusal("svrender " + arguments, reason);
  }
  void expect_wrong(const std::string& options) const {
    const Outcome outcome = run("v.svol --scene s.json -o no.png " + options);
    EXPECT_EQ(outcome.code, 2) << options;
    EXPECT_LT(outcome.text.size(), 250u) << outcome.text;
  }
  Image picture_of(const std::string& name) const { return read_exr(path(name)).value(); }
  nlohmann::json statistics() const { return nlohmann::json::parse(read("stats.json")); }

  nlohmann::json scene_;
};

TEST_F(Svrender, LeavesOutPatchesThatMemoryHasNoRoomFor) {
  const auto triangles = [](std::uint32_t count) {
    TriangleMesh mesh;
    for (std::uint32_t i = 0; i < count; ++i) {
      for (int k = 0; k < 3; ++k) mesh.points.emplace_back(1e-5 * i, k == 1, k == 2);
      mesh.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
    }
    return mesh;
  };
  test::TestVolume volume = test::make_test_volume(test::random_points(100, 1), {std::vector<double>(100, 0.5)});
  const auto packed =
      format::pack_boundary(std::vector<Patch>{{"large", triangles(40'000)}, {"small", triangles(2)}}, 0);
  volume.info.boundary = packed->info;
  volume.boundary = packed->section;
  ASSERT_TRUE(test::write_test_volume(volume, path("b.svol")));
  scene_["surfaces"] = {{{"boundary", "*"}}};
  write_scene();
  const Outcome little = run("b.svol --scene s.json -o out.png --memory 16M");
  EXPECT_EQ(little.code, 0) << little.text;
  EXPECT_THAT(little.text, HasSubstr("b.svol: the boundary is drawn without 1 of its patches, large: "));
  EXPECT_THAT(little.text, HasSubstr("--memory"));
  expect_done("svrender b.svol --scene s.json -o out.png --tolerance 0 --memory 64M");
}

TEST_F(Svrender, DrawsAPictureAndItsStatistics) {
  expect_done("svrender v.svol --scene s.json -o out.exr --tolerance 0 --repeat 3 --stats stats.json");
  const auto image = read_exr(path("out.exr"));
  ASSERT_TRUE(image) << image.error().message;
  EXPECT_EQ(image->width, 64);
  EXPECT_EQ(image->height, 48);
  const vec4 middle = image->at(32, 24);
  EXPECT_GT(middle.a, 0.3f);
  EXPECT_NEAR(middle.g, 0.5f * middle.r, 1e-3f);
  EXPECT_EQ(image->at(1, 1).a, 0.0f);

  const auto stats = statistics();
  EXPECT_EQ(stats.at("splats"), 2000);
  EXPECT_GT(stats.at("nodes"), 0);
  EXPECT_GT(stats.at("bytes_read"), 0);
  EXPECT_GT(stats.at("bytes_resident_peak"), 2000 * 52);
  EXPECT_GT(stats.at("requests"), 0);
  EXPECT_EQ(stats.at("effective_tolerance"), 0);
  EXPECT_EQ(stats.at("lighting"), false);
  EXPECT_FALSE(stats.at("resolution_histogram").empty());
  for (const char* part : {"cut", "fetch", "upload", "draw", "frame"})
    EXPECT_GT(stats.at("seconds").at(part), 0) << part;
  EXPECT_GT(stats.at("first_image_seconds"), stats.at("seconds").at("fetch"));
  EXPECT_EQ(stats.at("file_bytes"), std::filesystem::file_size(path("v.svol")));

  const std::string exr = read("out.exr");
  for (const char* key : {"software", "attribute", "tolerance", "kernel", "sort", "splats", "scene", "renderer"})
    EXPECT_THAT(exr, HasSubstr(key));
}

// Walls are open, translucent and coloured as in the exact picture.
TEST_F(Svrender, DrawsWallsAsTheReferenceDoes) {
  const nlohmann::json coloring = {
      {"attribute", "value"}, {"domain", {-1, 1}}, {"colors", {{0, 0, 0, 1}, {0.5, 0, 1, 0}, {1, 1, 0, 0}}}};
  scene_["camera"]["position"] = {5, 4, 6};
  scene_["camera"]["focal_point"] = {0, 0, 0};
  scene_["attribute"] = "value";
  expect_done("svbuild gen:mesh:cells=20000 -o walls.svol --exact --boundary");
  std::map<std::string, Image> pictures;
  for (const char* side : {"shown", "translucent", "hidden"}) {
    scene_["surfaces"] = {{{"boundary", "*"}, {"near_side", side}, {"color_by", coloring}, {"opacity", 0.8}}};
    write_scene();
    expect_done("svrender walls.svol --scene s.json --exact -o exact.exr");
    expect_done("svtruth gen:mesh:cells=20000 --scene s.json -o truth.exr");
    pictures[side] = picture_of("exact.exr");
    EXPECT_LE(compare_images(pictures[side], picture_of("truth.exr")).value().rmse, 1e-6) << side;
  }
  const auto difference = [&](const char* one, const char* other) {
    return compare_images(pictures.at(one), pictures.at(other)).value().rmse;
  };
  EXPECT_GT(difference("shown", "hidden"), 0.2);
  EXPECT_GT(difference("shown", "translucent"), 0.1);
  EXPECT_GT(difference("translucent", "hidden"), 0.05);
}

TEST_F(Svrender, DrawsCellsExactly) {
  expect_done("svbuild gen:mesh:cells=20000 -o mesh.svol --exact");
  scene_["camera"]["position"] = {5, 4, 6};
  scene_["camera"]["focal_point"] = {0, 0, 0};
  scene_["attribute"] = "value";
  scene_["transfer_function"]["density"] = {{0, 0.5}, {0.5, 4}, {1, 0}};
  const nlohmann::json plain = scene_;
  const auto check = [&](const char* what) {
    write_scene();
    expect_done("svrender mesh.svol --scene s.json --exact -o exact.exr --stats stats.json");
    expect_done("svtruth gen:mesh:cells=20000 --scene s.json -o truth.exr");
    const auto difference = compare_images(picture_of("exact.exr"), picture_of("truth.exr"));
    ASSERT_TRUE(difference);
    EXPECT_LE(difference->rmse, 1e-5) << what;
    EXPECT_EQ(statistics().at("exact"), true);
    EXPECT_GT(statistics().at("segments"), 1000) << what;
    EXPECT_LE(statistics().at("bytes_read"), statistics().at("file_bytes")) << "the second picture reads nothing";
  };
  check("unlit");
  scene_["lighting"] = true;
  scene_["camera"]["projection"] = "orthographic";
  scene_["camera"]["parallel_height"] = 3;
  check("parallel");
  scene_["clip_planes"] = {{{"point", {0, 0, 0}}, {"normal", {-1, -0.2, 0.3}}}};
  check("clipped");
  scene_["contours"] = {{{"values", {0.3, 0.6}}, {"opacity", 0.5}}};
  scene_["slices"] = {{{"point", {0, 0.1, 0}}, {"normal", {0.1, 1, 0}}, {"opacity", 0.5}}};
  check("with contours and a slice");
  EXPECT_THAT(run("mesh.svol --scene s.json -o scene.exr").text, HasSubstr("64 x 48 pixels, exact, "));
  for (const char* option : {"--tolerance 1", "--splats 9", "--device gl", "--progress-frames ."})
    EXPECT_THAT(run(std::string("mesh.svol --scene s.json -o shells.exr ") + option).err,
                HasSubstr("shells stand for"));
  scene_["attribute"] = "a0";
  write_scene();
  EXPECT_THAT(run("v.svol --scene s.json -o shells.exr").err, HasSubstr("the file keeps no cells: build it"));

  scene_ = plain;
  scene_["transfer_function"]["density"] = {{0, 0}};
  scene_["contours"] = {{{"values", {99}}}};
  write_scene();
  EXPECT_THAT(run("mesh.svol --scene s.json -o empty.png").text,
              HasSubstr("no contour is in the picture: 99 lies outside of the values of value"));

  scene_ = plain;
  scene_["exact"] = true;
  write_scene();
  EXPECT_THAT(run("mesh.svol --scene s.json -o scene.exr").text, HasSubstr("64 x 48 pixels, exact, "));
  EXPECT_THAT(run("mesh.svol --scene s.json -o scene.exr --splats 100").text, HasSubstr(" splats in "));
  expect_refusal("mesh.svol --scene s.json -o no.exr --kernel octant",
                 "--kernel octant: an exact picture has no splats");
  for (const char* option : {"--device gl", "--sort none", "--progress-frames ."})
    expect_refusal(std::string("mesh.svol --scene s.json -o no.exr ") + option, "an exact picture ");
  expect_refusal("v.svol --exact -o no.exr", "--drop-cells");
  for (const char* option : {"--tolerance 1", "--max-error .1", "--resolution 0", "--splats 9", "--milliseconds 9"})
    expect_wrong(std::string("--exact ") + option);
}

TEST_F(Svrender, DrawsCellsOfAMovingCameraExactly) {
  expect_done("svbuild gen:mesh:cells=5000 -o mesh.svol");
  expect_done("svrender mesh.svol --exact --size 40x30 --turntable 3 --progress-frames . -o a.exr");
  EXPECT_NE(read("frame-0000.png"), read("frame-0001.png"));
  EXPECT_NE(read("frame-0001.png"), read("frame-0002.png"));
}

// The machine's speed chooses the picture. All machines draw the same when told which.
TEST_F(Svrender, DrawsThePictureOfATimeAgain) {
  expect_done("svbuild gen:mesh:cells=20000 -o mesh.svol");
  for (const auto& [milliseconds, option] : {std::pair("1e-3", "--splats "), {"1e5", "--exact "}}) {
    const std::string frame = "svrender mesh.svol --size 160x120 ";
    const Outcome told = ProgramTest::run(fmt::format("{} --milliseconds {} -o a.exr", frame, milliseconds));
    expect_done(fmt::format("{} --milliseconds {} -o a.exr --stats stats.json", frame, milliseconds));
    const std::string rung = statistics().at("rung");
    EXPECT_TRUE(rung.starts_with(option)) << rung;
    EXPECT_EQ(statistics().at("rungs_tried").back(), rung);
    EXPECT_THAT(told.text, HasSubstr(std::string("the picture of ") + option));
    expect_done(frame + rung + " -o b.exr");
    EXPECT_EQ(picture_of("a.exr").pixels, picture_of("b.exr").pixels) << rung;
  }
}

TEST_F(Svrender, TakesOneGoalOnly) {
  for (const char* options : {"--splats 5 --tolerance 1", "--max-error .01 --splats 5", "--milliseconds 9 --splats 5",
                              "--max-error .01 --resolution 1", "--milliseconds 9 --progress-frames .",
                              "--milliseconds 9 --path 2,1,1", "--max-error -1", "--milliseconds 0", "--splats 0"})
    expect_wrong(options);
}

TEST_F(Svrender, SlicesClipPlanesAndContoursAreOptions) {
  const auto picture = [&](const std::string& options) {
    expect_done("svrender v.svol --scene s.json -o out.exr --tolerance 0 " + options);
    return picture_of("out.exr");
  };
  const auto opaque = [](const Image& image) { return std::ranges::count(image.pixels, 1.0F, &vec4::a); };
  const Image plain = picture("");
  EXPECT_EQ(opaque(plain), 0);
  EXPECT_GT(opaque(picture("--slice 0.5,0.5,0.5:0,0,1")), 100);
  EXPECT_GT(opaque(picture("--slice 0.5,0.5,0.5:0,0,1 --slice 0.5,0.5,0.5:1,0,0")), 100);
  EXPECT_EQ(opaque(picture("--slice 0.5,0.5,5:0,0,1")), 0);
  EXPECT_GT(compare_images(picture("--clip-plane 0.5,0.5,0.5:0.1,0,1"), plain)->rmse, 0.01);
  const auto with_shells = [&](const std::string& options) {
    const Outcome outcome = run("v.svol --scene s.json -o out.exr --tolerance 0 " + options);
    EXPECT_THAT(outcome.err, HasSubstr("shells stand for the contours, as the file keeps no cells"));
    return picture_of("out.exr");
  };
  const Image one = with_shells("--contour 0.5");
  EXPECT_GT(compare_images(one, plain)->rmse, 0.01);
  EXPECT_GT(compare_images(with_shells("--contour 0.5 --contour 0.2"), one)->rmse, 1e-3);
  for (const char* value : {"-7", "5e9"}) {
    const Outcome outcome = run(std::string("v.svol --scene s.json -o out.png --contour=") + value);
    EXPECT_THAT(outcome.err, HasSubstr(fmt::format("{} lies outside of the values of", std::stod(value))));
  }
  for (const char* options :
       {"--slice 1,2:0,0,1", "--slice 1,2,3", "--slice 1,2,3:0,0,0", "--slice 1,2,3:0,0,nan", "--slice 1,2,3:0,0,1,",
        "--clip-plane a,b,c:0,0,1", "--clip-plane 1,2,2e100:0,0,1", "--contour x", "--contour 1:0", "--contour nan"})
    expect_wrong(options);
}

TEST_F(Svrender, OptionsChangeWhatIsDrawn) {
  const auto statistics = [&](const std::string& options) {
    return test::document_of(run("v.svol --scene s.json -o out.png --stats - " + options));
  };
  EXPECT_LT(statistics("--tolerance 50").at("splats"), 400);
  EXPECT_LT(statistics("--tolerance 50 --kernel octant").at("splats"), 100);
  EXPECT_EQ(statistics("--resolution 0").at("splats"), statistics("--tolerance 1e9").at("splats"));
  EXPECT_EQ(statistics("--resolution 100").at("splats"), 2000);
  const auto best = statistics("--splats 900");
  EXPECT_LE(best.at("splats"), 900);
  EXPECT_GT(best.at("expected_error"), 0);
  const auto by_error = statistics("--max-error .02");
  EXPECT_LE(by_error.at("estimated_error"), 1.05 * 0.02);
  EXPECT_GE(by_error.at("pictures_for_error"), 2);
  EXPECT_LT(by_error.at("splats"), 2000) << by_error;
  EXPECT_EQ(statistics("").at("splats"), 2000) << "all points of a small file";
  EXPECT_EQ(statistics("--size 20x10").at("width"), 20);
  for (const char* sort : {"none", "axis", "exact"})
    EXPECT_EQ(statistics(fmt::format("--sort {}", sort)).at("sort"), sort);
  EXPECT_EQ(statistics("--sampling 3").at("sample_spacing"), 3);
  EXPECT_EQ(statistics("").at("sample_spacing"), 1);
  EXPECT_EQ(statistics("--tolerance 12.5 --size 400x500").at("sample_spacing"), 4);  // of 50 pixels
  EXPECT_EQ(statistics("--tolerance 1e30").at("sample_spacing"), 6);
  EXPECT_EQ(statistics("--tolerance 50 --sampling 1").at("sample_spacing"), 1);
  EXPECT_EQ(statistics("--resolution 0").at("sample_spacing"), 1);
  EXPECT_EQ(statistics("").at("kernel"), "moments");
  EXPECT_EQ(statistics("--kernel octant").at("kernel"), "octant");

  // A third of the bytes that a picture of all points held.
  const std::uint64_t all = statistics("--tolerance 0").at("bytes_resident_peak");
  const auto small = statistics(fmt::format("--tolerance 0 --memory {}", all / 3));
  EXPECT_GT(small.at("effective_tolerance"), 0);
  EXPECT_LT(small.at("splats"), 2000);
  EXPECT_LE(small.at("bytes_resident_peak"), all / 3);
}

TEST_F(Svrender, BothKernelsDrawAndAreLit) {
  for (const std::string kernel : {"moments", "octant"}) {
    const auto picture = [&](const nlohmann::json& lighting) {
      scene_["lighting"] = lighting;
      write_scene();
      expect_done("svrender v.svol --scene s.json -o out.exr --tolerance 0 --stats stats.json --kernel " + kernel);
      return picture_of("out.exr");
    };
    const Image unlit = picture(false);
    EXPECT_GT(unlit.at(32, 24).r, 0.1f) << kernel;

    // Ambient light of a half, and no diffuse light: colours halve, and nothing else changes.
    const nlohmann::json half = {{"ambient", 0.5}, {"diffuse", 0}};
    const Image lit = picture(half);
    EXPECT_EQ(statistics().at("lighting"), half);
    for (int y = 0; y < 48; y += 5)
      for (int x = 0; x < 64; x += 5) {
        EXPECT_NEAR(lit.at(x, y).r, 0.5f * unlit.at(x, y).r, 1e-5f) << kernel;
        EXPECT_NEAR(lit.at(x, y).a, unlit.at(x, y).a, 1e-6f) << kernel;
      }

    // Diffuse light on surfaces that are seen face on leaves other surfaces darker.
    const Image diffuse = picture({{"ambient", 0}, {"diffuse", 1}});
    EXPECT_LT(diffuse.at(32, 24).r, unlit.at(32, 24).r) << kernel;
  }
}

// Meshes, which svbuild converts into a cache of this test.
struct SvrenderOfMeshes : Svrender {
  void SetUp() override {
    ::setenv("SPLATVOL_CACHE", path("cache").c_str(), 1);
    std::filesystem::create_directory(path("cache"));
    ProgramTest::expect_done("svgen mesh --cells 3000 --pieces 2 -o mesh");
  }
  void TearDown() override { ::unsetenv("SPLATVOL_CACHE"); }
};

TEST_F(SvrenderOfMeshes, AreConvertedOnce) {
  for (const std::string files : {"mesh/piece0.vtu", "mesh/piece0.vtu mesh/piece1.vtu", "mesh"}) {
    ProgramTest::expect_done("svbuild " + files + " --boundary -o built.svol && svrender built.svol -o built.exr");
    const Outcome first = run(files + " -o first.exr");
    EXPECT_EQ(first.code, 0) << first.text;
    EXPECT_THAT(first.err, HasSubstr("is kept for the next picture"));
    const Outcome second = run(files + " -o second.exr");
    EXPECT_EQ(second.code, 0) << second.text;
    EXPECT_EQ(second.err, "");
    EXPECT_EQ(compare_images(picture_of("first.exr"), picture_of("built.exr"))->max, 0) << files;
    EXPECT_EQ(compare_images(picture_of("first.exr"), picture_of("second.exr"))->max, 0) << files;
  }
}

TEST_F(SvrenderOfMeshes, HaveAllStepsWhereOneIsAskedFor) {
  ProgramTest::expect_done("mv mesh/piece0.vtu a_0.vtu && cp a_0.vtu a_1.vtu");
  write("a.pvd", R"(<VTKFile type="Collection" version="0.1"><Collection><DataSet timestep="1" file="a_0.vtu"/>)"
                 R"(<DataSet timestep="2" file="a_1.vtu"/></Collection></VTKFile>)");
  EXPECT_EQ(run("a.pvd --step 0 -o a.exr").code, 0);
  EXPECT_THAT(run("a.pvd --step 2 -o a.exr").err, HasSubstr("the last"));
}

TEST_F(SvrenderOfMeshes, FailAsSvbuildDoes) {
  write("bad.vtu", "nonsense");
  write("s.json", "{}");
  expect_refusal("bad.vtu -o no.png", "bad.vtu");
  expect_refusal("none.vtu -o no.png", "none.vtu");
  expect_refusal("https://host.invalid/mesh.vtu -o no.png", "download it first");
  expect_refusal("mesh/piece0.vtu s.json -o no.png", "s.json");
  ::setenv("SPLATVOL_MEMORY", "much", 1);
  expect_refusal("mesh/piece0.vtu -o no.png", "SPLATVOL_MEMORY: 'much' is not a size");
  ::unsetenv("SPLATVOL_MEMORY");
}

TEST_F(SvrenderOfMeshes, ATemporaryFileDrawsWithoutACache) {
  ::setenv("SPLATVOL_CACHE", "", 1);
  ::setenv("TMPDIR", path().c_str(), 1);
  const Outcome drawn = run("mesh/piece0.vtu -o a.exr");
  ::unsetenv("TMPDIR");
  EXPECT_EQ(drawn.code, 0) << drawn.text;
  EXPECT_THAT(drawn.err, HasSubstr("the file is temporary"));
  for (const auto& entry : std::filesystem::recursive_directory_iterator(path()))
    EXPECT_NE(entry.path().extension(), ".svol") << "it goes with svrender";
}

TEST_F(Svrender, FramesNeedATaker) {
  for (const char* options : {"-o out.png --path 4,90,1", "-o out.png --turntable 4", "--movie out.mp4",
                              "--movie out.avi --turntable 4", "--turntable 4 --path 4,90,1 --movie out.mp4", ""}) {
    EXPECT_EQ(run(fmt::format("v.svol --scene s.json {}", options)).code, 2) << options;
  }
  EXPECT_THAT(run("v.svol --scene s.json -o out.png --path 4,90,1").text, HasSubstr("--progress-frames"));
}

TEST_F(Svrender, AFullTurnDoesNotRepeatItsFirstFrame) {
  for (const char* turn : {"--path 4,360,1", "--turntable 4"}) {
    std::filesystem::create_directories(path("frames"));
    expect_done(fmt::format("svrender v.svol --scene s.json -o last.png --progress-frames frames {}", turn));
    std::vector<std::string> frames;
    for (int i = 0; i < 4; ++i) frames.push_back(read(fmt::format("frames/frame-000{}.png", i)));
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < i; ++j) EXPECT_NE(frames[i], frames[j]) << turn << ' ' << i << ' ' << j;
    EXPECT_FALSE(std::filesystem::exists(path("frames/frame-0004.png")));
    std::filesystem::remove_all(path("frames"));
  }
}

// Detail and kernel come from the scene, unless an option tells them.
TEST_F(Svrender, ASceneTellsItsUse) {
  const auto statistics_of = [&](const std::string& options) {
    return test::document_of(run("v.svol --scene s.json -o out.png --stats - " + options));
  };
  scene_["tolerance"] = 4;
  scene_["kernel"] = "octant";
  write_scene();
  EXPECT_EQ(statistics_of("")["kernel"], "octant");
  EXPECT_EQ(statistics_of("")["tolerance"], 4);
  EXPECT_EQ(statistics_of("--kernel moments --tolerance 2")["kernel"], "moments");
  EXPECT_EQ(statistics_of("--kernel moments --tolerance 2")["tolerance"], 2);
  scene_["step"] = 1;
  write_scene();
  expect_refusal("v.svol --scene s.json -o out.png", "time series");
}

TEST_F(Svrender, FfmpegJoinsTheFramesOfAMovie) {
  const std::string movie = "v.svol --turntable 3 --size 65x48 --movie turn.mp4";
  // A program that says what it was given, and copies the last frame.
  write("bin/ffmpeg",
        "#!/bin/sh\necho \"$@\" > args\nfor last; do :; done; cp turn.mp4.frames/frame-0002.png \"$last\"\n");
  std::filesystem::permissions(path("bin/ffmpeg"), std::filesystem::perms::owner_all);
  const auto with_path = [&](const std::string& folders, const std::string& arguments) {
    const std::string before = std::getenv("PATH");
    ::setenv("PATH", folders.c_str(), 1);
    Outcome outcome = run(arguments);
    ::setenv("PATH", before.c_str(), 1);
    return outcome;
  };
  const Outcome made = with_path(path("bin:/bin:/usr/bin"), movie + " --splats 100");
  ASSERT_EQ(made.code, 0) << made.text;
  EXPECT_THAT(made.text, testing::AllOf(HasSubstr("turn.mp4: 65 x 48"), testing::Not(HasSubstr("\n: "))));
  EXPECT_TRUE(std::filesystem::exists(path("turn.mp4")));
  EXPECT_FALSE(std::filesystem::exists(path("turn.mp4.frames")));
  EXPECT_THAT(read("args"),
              testing::AllOf(HasSubstr("-framerate 30"), HasSubstr("-frames:v 3"), HasSubstr("frame-%04d.png")));

  // Without ffmpeg, and with one that fails, the frames stay.
  for (const std::string& folders : {path(), path("bin:/nowhere")}) {
    std::filesystem::remove(path("turn.mp4"));
    std::ofstream(path("bin/ffmpeg")) << "#!/bin/sh\necho no such codec >&2\nexit 3\n";  // may still be run
    const Outcome outcome = with_path(folders + ":/bin", movie);
    if (outcome.code == 0) GTEST_SKIP() << "an ffmpeg in /bin";
    EXPECT_EQ(outcome.code, 1);
    EXPECT_THAT(outcome.text, testing::AllOf(HasSubstr("3 frames are in turn.mp4.frames"), HasSubstr("ffmpeg")));
    EXPECT_TRUE(std::filesystem::exists(path("turn.mp4.frames/frame-0002.png")));
    EXPECT_FALSE(std::filesystem::exists(path("turn.mp4")));
    EXPECT_EQ(with_path(folders + ":/bin", movie).code, 1) << "the frames of before are replaced";
    std::filesystem::remove_all(path("turn.mp4.frames"));
  }
}

TEST_F(Svrender, MakesAPageInOneCommand) {
  expect_done(
      "svrender v.svol -o out.png --tolerance 0 --size 320x240 --background white --scalar-bar --title 'A flow'");
  const std::string plain = read("out.png");
  expect_done(
      "svrender v.svol -o out.png --tolerance 0 --size 320x240 --background white --colour-bar --title 'A flow'");
  EXPECT_EQ(read("out.png"), plain) << "an older name of the option";
  expect_done("svrender v.svol -o out.png --tolerance 0 --size 320x240 --background '#ffffff' --transparent");
  EXPECT_NE(plain, read("out.png"));
  expect_refusal("v.svol -o out.exr --title T", "need a .png");
  expect_refusal("v.svol -o out.exr --time-label", "need a .png");
  expect_refusal("v.svol -o out.png --time-label", "v.svol is no time series");
  expect_refusal("v.svol -o out.png --attribute heat", "no attribute \"heat\"");
  EXPECT_EQ(run("v.svol -o out.png --background grey").code, 2);
  EXPECT_EQ(run("v.svol -o out.png --scene s.json --attribute a0").code, 2);
}

TEST_F(Svrender, SaysWhyAPictureIsEmpty) {
  const auto draw = [&] {
    write_scene();
    const Outcome outcome = run("v.svol --scene s.json -o out.png");
    EXPECT_EQ(outcome.code, 0) << outcome.text;
    return outcome.text;
  };
  EXPECT_THAT(draw(), testing::Not(HasSubstr("shows nothing")));
  const nlohmann::json scene = scene_;
  scene_["camera"]["focal_point"] = {0.5, 0.5, 8};
  EXPECT_THAT(draw(), HasSubstr("svrender: out.png shows nothing: the data lies outside of the view"));
  scene_ = scene;
  scene_["transfer_function"]["density"] = {{0, 0}, {1, 0}};
  EXPECT_THAT(draw(), HasSubstr("the transfer function hides every value"));
  scene_ = scene;
  scene_["clip_box"] = {{"low", {5, 5, 5}}, {"high", {6, 6, 6}}};
  EXPECT_THAT(draw(), HasSubstr("the clip box excludes all of the data"));
  scene_ = scene;
  scene_["transfer_function"]["density"] = {{0, 1e-6}, {1, 1e-6}};
  EXPECT_THAT(draw(), HasSubstr("too faint"));
}

TEST_F(Svrender, NamesTheMemoryThatLimitsTheSplats) {
  const auto draw = [&](int kibibytes) {
    return run(fmt::format("v.svol --scene s.json -o out.png --tolerance 0 --device gl --gpu-memory {}K", kibibytes));
  };
  int too_little = 1, enough = 65536;  // the smallest memory that holds a picture
  while (enough - too_little > 8) {
    const int middle = (too_little + enough) / 2;
    (draw(middle).code == 0 ? enough : too_little) = middle;
  }
  EXPECT_THAT(draw(enough).text, HasSubstr(fmt::format("splats that --gpu-memory {}K holds", enough)));
}

// EGL finds no driver: as on a machine without Mesa.
TEST_F(Svrender, DrawsWithoutOpenGl) {
  expect_done("svrender v.svol --scene s.json -o expected.exr --tolerance 0 --device cpu");
  const Image expected = picture_of("expected.exr");
  ::setenv("__EGL_VENDOR_LIBRARY_FILENAMES", "/nonexistent", 1);
  for (const char* device : {"cpu", "auto"}) {
    expect_done(
        fmt::format("svrender v.svol --scene s.json -o out.exr --tolerance 0 --device {} --stats stats.json", device));
    EXPECT_EQ(compare_images(picture_of("out.exr"), expected)->max, 0);
    const auto stats = statistics();
    EXPECT_THAT(stats.at("renderer").get<std::string>(), HasSubstr("processor"));
  }
  expect_refusal("v.svol --scene s.json -o out.exr --device gl", "no OpenGL 4.5");
  ::unsetenv("__EGL_VENDOR_LIBRARY_FILENAMES");
  EXPECT_EQ(run("v.svol --scene s.json -o out.exr --device tpu").code, 2);
}

TEST_F(Svrender, DevicesDrawTheSamePicture) {
  scene_["lighting"] = true;
  write_scene();
  for (const char* options : {"--tolerance 0", "--tolerance 9", "--kernel octant", "--sort axis --tolerance 2"}) {
    expect_done(fmt::format("svrender v.svol --scene s.json -o cpu.exr --device cpu {}", options));
    expect_done(fmt::format("svrender v.svol --scene s.json -o gl.exr --device gl {}", options));
    const ImageDifference difference = compare_images(picture_of("cpu.exr"), picture_of("gl.exr")).value();
    EXPECT_LT(difference.rmse, 1e-4) << options;
    EXPECT_GT(difference.mean_a, 0.01) << options;
  }
}

TEST_F(Svrender, AFileWithoutTheColumnsSaysWhatToDo) {
  test::TestVolumeOptions options;
  options.moments = false;
  options.gradients = false;
  const auto points = test::random_points(100, 1);
  const auto volume = test::make_test_volume(points, {std::vector<double>(100, 0.5)}, options);
  ASSERT_TRUE(test::write_test_volume(volume, path("old.svol")));
  expect_refusal("old.svol --scene s.json -o out.exr", "--kernel octant");
  scene_["lighting"] = true;
  write_scene();
  expect_refusal("old.svol --scene s.json -o out.exr --kernel octant", "gradients");
}

TEST_F(Svrender, RefusesWhatCannotBeDone) {
  expect_refusal("v.svol --scene s.json -o nowhere/out.exr", "nowhere");
  expect_refusal("v.svol --scene s.json -o out.exr --memory 1K", "1024 bytes of memory are too few");
}

TEST_F(Svrender, RefusesScenesThatItCannotDraw) {
  scene_["attribute"] = "pressure";
  write_scene();
  expect_refusal("v.svol --scene s.json -o out.exr", "no attribute \"pressure\"; there are: a0");
  scene_["attribute"] = "a0";
  scene_["lighting"] = 2;
  write_scene();
  expect_refusal("v.svol --scene s.json -o out.exr", "lighting");
  scene_.erase("camera");
  write_scene();
  expect_refusal("v.svol --scene s.json -o out.exr", "camera");
}

TEST_F(Svrender, WrongUsageIsTwo) {
  for (const char* arguments :
       {"", "v.svol", "v.svol --scene s.json", "v.svol --scene s.json -o out.jpg",
        "v.svol --scene s.json -o out.exr --tolerance -1", "v.svol --scene s.json -o out.exr --tolerance nan",
        "v.svol --scene s.json -o out.exr --resolution -1", "v.svol --scene s.json -o out.exr --kernel round",
        "v.svol --scene s.json -o out.exr --memory lots", "v.svol --scene s.json -o out.exr --size 5",
        "v.svol --scene s.json -o out.exr --repeat 0", "v.svol --scene s.json -o out.exr --nonsense"})
    EXPECT_EQ(run(arguments).code, 2) << arguments;
}

}  // namespace
}  // namespace splatvol
