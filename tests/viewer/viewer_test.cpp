// The viewer without a window: events in, pictures out.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "builder/series/series_files.h"
#include "player/sampling.h"
#include "renderer/device/device.h"
#include "tests/player/waves.h"
#include "tests/viewer/viewer_fixture.h"

namespace splatvol::test {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr int width = 800, height = 600;

// Lets programs of a folder take the place of others.
class ProgramsFrom {
 public:
  explicit ProgramsFrom(const std::string& folder) { ::setenv("PATH", (folder + ":" + before_).c_str(), 1); }
  ~ProgramsFrom() { ::setenv("PATH", before_.c_str(), 1); }

 private:
  std::string before_ = std::getenv("PATH");
};

struct ViewerTest : test::ViewerFixture {
  void SetUp() override {
    ViewerFixture::SetUp();
    write_two_attributes(path("v.svol"));
    resize(width, height);
    open({.volume = path("v.svol"), .settings = {.works_aside = false}});
  }

  // Opens the file again, with a clipboard that `copied` holds.
  void open_with_clipboard(std::string& copied, const std::string& scene_text = "") {
    ViewerOptions options{.volume = path("v.svol"), .scene = scene_text, .settings = {.works_aside = false}};
    options.clipboard.copy = [&](const std::string& text) { copied = text; };
    open(options);
  }
  // Presses keys together.
  void chord(const std::vector<int>& codes) {
    for (const int code : codes) frame({KeyChanged{code, true}});
    for (const int code : codes) frame({KeyChanged{code, false}});
    settle();
  }
  // Drops a scene, as a file, on the window.
  void drop(const Scene& dropped) { frame({FilesDropped{{write("dropped.json", scene_to_json(dropped))}}}); }

  // The area of the picture, without the panel.
  static double brightness(const Image& image) {
    double sum = 0;
    for (const vec4& pixel : image.pixels) sum += static_cast<double>(pixel.r + pixel.g + pixel.b);
    return sum;
  }

  // Where the panel has its check box "lighting".
  static constexpr PointerMoved lighting_box{17, 521};

  const fs::path folder = path();
};

TEST_F(ViewerTest, SettlesOnWhatSvrenderDraws) {
  settle();
  const Image shown = viewer->session()->image().value();
  EXPECT_GT(brightness(shown), 0);
  EXPECT_TRUE(viewer->session()->frame()->progress.complete);
  EXPECT_EQ(viewer->session()->frame()->splats, viewer->session()->info().point_count()) << "all of a small file";

  // Draws the saved scene with Streamer::request, like svrender.
  std::ofstream(path("scene.json")) << scene_to_json(scene());
  const Scene saved = load_scene(path("scene.json")).value();
  const auto streamer = Streamer::open(open_file(path("v.svol")).value(), {64u << 20, saved.attribute}).value();
  const auto renderer = make_rasterizer(Device::automatic, {.in_current_context = true}).value();
  ASSERT_TRUE(renderer->set_transfer_function(saved.transfer_function, streamer->units()));
  const View view = make_view(saved.camera, saved.width, saved.height).value();
  const auto splats = streamer->request(view, saved.transfer_function, {0.0, {}}).value();
  ASSERT_TRUE(renderer->set_draw_list(splats->list));
  ASSERT_TRUE(renderer->draw(view, SortMode::exact, automatic_sample_spacing(view, splats->detail)));
  const auto difference = compare_images(shown, renderer->read_image().value()).value();
  EXPECT_EQ(difference.max, 0);
}

TEST_F(ViewerTest, ShowsTheSamePictureOfBothDevices) {
  std::vector<Image> windows, pictures;
  for (const Device device : {Device::cpu, Device::gl}) {
    open({.volume = path("v.svol"), .settings = {.device = device}});
    press('H');  // hides the numbers, which differ
    press('B');  // and the outline, which lies over OpenGL's picture
    settle();
    pictures.push_back(viewer->session()->image().value());
    EXPECT_EQ(viewer->session()->device_text().find("OpenGL") != std::string::npos, device == Device::gl);
    windows.push_back(screen());
  }
  EXPECT_GT(brightness(pictures[0]), 0);
  EXPECT_LT(compare_images(pictures[0], pictures[1])->rmse, 1e-4);
  // Bytes of sRGB, rounded.
  EXPECT_LT(compare_images(windows[0], windows[1])->rmse, 2e-3);
}

// Where a graphics card draws what moves, the processor draws the exact picture at rest, and the window shows it.
TEST_F(ViewerTest, ShowsTheProcessorsExactPicture) {
  build_mesh(jittered(12, 0.2), waves, path("m.svol"), {.keep_cells = true});
  std::vector<Image> screens;
  for (const Device device : {Device::gl, Device::cpu}) {
    resize(300, 200);
    open({.volume = path("m.svol"), .settings = {.device = device}});
    settle();
    EXPECT_TRUE(viewer->session()->exact());
    press(key::tab);  // without the panel
    settle();
    screens.push_back(screen());
  }
  EXPECT_LE(compare_images(screens[0], screens[1])->max, 0.02);
}

TEST_F(ViewerTest, RestsWhenNothingHappens) {
  press('H');  // hides the numbers: the mean time of frames goes on
  settle();
  const std::uint64_t serial = viewer->session()->frame()->serial;
  const Image before = screen();
  frame({});
  EXPECT_TRUE(viewer->is_settled());
  EXPECT_EQ(viewer->session()->frame()->serial, serial);
  EXPECT_EQ(compare_images(before, screen())->max, 0);
}

// What the HUD tells of a picture that was drawn aside fits into it a frame after the picture has come.
TEST_F(ViewerTest, AFrameFollowsTheLastPicture) {
  build_mesh(lattice(40), waves, path("m.svol"));  // more points than are drawn at once
  open({.volume = path("m.svol"), .settings = {.device = Device::cpu, .quality = {.tolerance_percent = 0}}});
  while (!viewer->session()->is_settled()) {  // ends by the test's time limit
    frame({});
    EXPECT_FALSE(viewer->is_settled());
  }
}

TEST_F(ViewerTest, PlaysSteps) {
  write_series(path("series.svol"));
  open({.volume = path("series.svol")});
  settle();
  frame_seconds = 0.02;
  press(key::space);
  EXPECT_EQ(viewer->session()->step(), 0U) << "behind the last comes the first";
  settle();
  EXPECT_EQ(viewer->session()->step(), 2U);
  EXPECT_TRUE(viewer->session()->is_step_shown());
}

TEST_F(ViewerTest, ADragTurnsThePictureAndNotThePanel) {
  settle();
  const Camera before = scene().camera;
  drag({{600, 300}, {660, 320}});
  EXPECT_NE(scene().camera.position, before.position);
  const Camera turned = scene().camera;
  // The same drag over the panel does not move the camera.
  drag({{100, 500}, {160, 520}});
  EXPECT_EQ(scene().camera.position, turned.position);
  press('R');
  EXPECT_EQ(scene().camera.position, before.position);
}

// A slow frame may see all of a click, or of a drag.
TEST_F(ViewerTest, ClicksWithinAFrameAreNotLost) {
  settle();
  const Camera before = scene().camera;
  frame({lighting_box, ButtonChanged{0, true}, ButtonChanged{0, false}, PointerMoved{600, 300}});
  EXPECT_FALSE(viewer->is_settled()) << "events wait";
  settle();
  EXPECT_TRUE(scene().lighting);
  EXPECT_EQ(scene().camera, before);
  frame({ButtonChanged{0, true}, PointerMoved{660, 320}, ButtonChanged{0, false}, lighting_box, ButtonChanged{0, true},
         ButtonChanged{0, false}});
  settle();
  EXPECT_NE(scene().camera, before);
  EXPECT_FALSE(scene().lighting);
}

TEST_F(ViewerTest, UndoesAndRedoesWhatChangesTheScene) {
  settle();
  const auto undo = [&] { chord({key::left_control, 'Z'}); };
  const auto redo = [&] { chord({key::right_control, key::right_shift, 'Z'}); };
  std::vector<Scene> scenes = {scene()};
  const auto done = [&] {
    settle();
    EXPECT_NE(scene(), scenes.back());
    scenes.push_back(scene());
  };
  // A drag of many motions, one burst of the wheel, a control point, a key, a check box, an attribute, a scene.
  frame({PointerMoved{600, 300}, ButtonChanged{0, true}}, 0.01);
  for (int i = 1; i < 20; ++i) frame({PointerMoved{600.0 + i, 300}}, 0.05);
  frame({ButtonChanged{0, false}}, 0.01);
  done();
  for (int i = 1; i < 10; ++i) frame({Scrolled{0, 1}}, 0.05);
  done();
  click(170, 130);
  done();
  press('P');
  done();
  click(lighting_box.x, lighting_box.y);
  done();
  Scene other = scene();
  other.attribute = "a1";
  other.transfer_function.hi *= 0.5;
  other.clip_box = Box{dvec3(0), dvec3(0.5)};
  other.background = dvec3(1);
  drop(other);
  done();
  EXPECT_EQ(viewer->session()->attribute().name, "a1");

  for (std::size_t i = scenes.size() - 1; i-- > 0;) {
    undo();
    EXPECT_EQ(scene(), scenes[i]) << i;
  }
  undo();
  EXPECT_EQ(scene(), scenes[0]) << "there is no more";
  EXPECT_EQ(viewer->session()->attribute().name, "a0");
  for (std::size_t i = 1; i < scenes.size(); ++i) {
    redo();
    EXPECT_EQ(scene(), scenes[i]) << i;
  }
  // The wheel, and control Z before it has come to rest. Then the other way to redo, and a change instead.
  frame({PointerMoved{600, 300}, Scrolled{0, 1}, KeyChanged{key::left_control, true}, KeyChanged{'Z', true}}, 0.01);
  frame({KeyChanged{'Z', false}, KeyChanged{key::left_control, false}}, 0.01);
  settle();
  EXPECT_EQ(scene(), scenes.back());
  chord({key::left_control, 'Y'});
  EXPECT_NE(scene(), scenes.back());
  undo();
  press('P');
  const Scene changed = scene();
  redo();
  EXPECT_EQ(scene(), changed);
  click(70, 15);  // the button "undo"
  settle();
  EXPECT_EQ(scene(), scenes.back());
}

// While somebody uses the interface, no frame takes the time of a finer picture.
TEST_F(ViewerTest, DoesNotSharpenWhileThePointerMoves) {
  settle();
  press('R');
  frame({ButtonChanged{0, true}, PointerMoved{600, 300}}, 0.01);
  frame({PointerMoved{620, 300}, ButtonChanged{0, false}}, 0.01);
  for (int i = 0; i < 50; ++i) {
    frame({PointerMoved{100.0 + i, 300}}, 0.01);
    ASSERT_FALSE(viewer->is_settled());
    ASSERT_FALSE(viewer->session()->refinement()) << i;
  }
  settle();
  EXPECT_TRUE(viewer->session()->refinement());
}

TEST_F(ViewerTest, MovesCoarselyAndSharpensAtRest) {
  settle();
  EXPECT_FALSE(viewer->session()->frame()->detail.goal);
  frame({PointerMoved{600, 300}}, 0.01);
  frame({ButtonChanged{0, true}}, 0.01);
  frame({PointerMoved{620, 300}}, 0.01);
  EXPECT_FALSE(viewer->is_settled());
  // Until coarser splats have been read, finer ones that are there take their place.
  const auto moving = [&]() -> const FrameSplats& { return *viewer->session()->frame(); };
  for (int i = 0; i < 10000 && !moving().progress.complete; ++i) frame({PointerMoved{620.0 + i % 2, 300}}, 0.01);
  ASSERT_TRUE(moving().detail.goal);
  EXPECT_LE(moving().splats, std::max<std::uint64_t>(moving().detail.goal->max_splats, 20)) << "the coarsest have 20";
  frame({ButtonChanged{0, false}}, 0.01);
  settle();
  EXPECT_FALSE(viewer->session()->frame()->detail.goal);
  EXPECT_TRUE(viewer->session()->refinement()->is_done());
}

TEST_F(ViewerTest, KeysChangeWhatTheySay) {
  press('P');
  EXPECT_EQ(scene().camera.projection, Camera::Projection::orthographic);
  press('L');
  EXPECT_TRUE(scene().lighting);
  press('1');
  EXPECT_LT(glm::length(axes_of(scene().camera).forward - dvec3(-1, 0, 0)), 1e-12);
  settle();
  const Image with_panel = screen();
  press(key::tab);
  settle();
  EXPECT_EQ(scene().width, width);  // the picture fills the window now
  EXPECT_GT(compare_images(with_panel, screen())->max, 0);
  EXPECT_FALSE(viewer->wants_to_close());
  press_with_control('Q');
  EXPECT_TRUE(viewer->wants_to_close());
}

TEST_F(ViewerTest, RSeesAllAgain) {
  settle();
  const Camera all = scene().camera;
  Scene away = scene();
  away.camera.focal_point = away.camera.position + dvec3(0, 0, 50);
  away.attribute = "a1";
  write("away.json", scene_to_json(away));
  open({.volume = path("v.svol"), .scene = path("away.json")});
  settle();
  EXPECT_EQ(scene().camera, away.camera);
  press('R');
  settle();
  EXPECT_EQ(scene().camera, all);
  press('P');
  press('R');
  settle();
  EXPECT_EQ(scene().camera.projection, Camera::Projection::orthographic);
}

TEST_F(ViewerTest, AnyAxisMayBeUp) {
  resize(width, 900);
  settle();
  for (const int axis : {2, 0, 1}) {
    click(210, 572);
    click(210, 597 + 19 * axis);
    settle();
    dvec3 up(0);
    up[axis] = 1;
    EXPECT_EQ(scene().camera.up, up);
    // From all sides, the axis is up, and from above it is a plan.
    for (const int code : {'1', '2', '3'}) {
      press(code);
      const CameraAxes axes = axes_of(scene().camera);
      if (code - '1' == axis)
        EXPECT_LT(glm::length(axes.right - (axis == 0 ? dvec3(0, 1, 0) : dvec3(1, 0, 0))), 1e-12) << axis;
      else
        EXPECT_LT(glm::length(axes.up - up), 1e-12) << axis;
      EXPECT_NEAR(axes.forward[code - '1'], -1, 1e-12);
    }
    press('4');
    const CameraAxes corner = axes_of(scene().camera);
    EXPECT_LT(glm::length(corner.forward + dvec3(std::sqrt(1.0 / 3))), 1e-12);
    EXPECT_GT(glm::dot(corner.up, up), 0.5);
    press('R');
  }
}

// Files are named relative to the present folder.
TEST_F(ViewerTest, SavesInAnySizeAndAsksBeforeItReplaces) {
  const fs::path present = fs::current_path();
  fs::current_path(folder);
  constexpr int tall = 1040;
  resize(width, tall);
  settle();
  const auto click_and_settle = [&](double x, double y) {
    click(x, y);
    settle();
  };
  const auto keep = [&] { click_and_settle(435, 540); };
  const auto replace = [&] { click_and_settle(366, 540); };
  const int shown = scene().width;
  click_and_settle(100, 722);  // the section "save"

  // The picture as it is shown, then another view of it.
  const auto save_picture = [&] { click_and_settle(60, 957); };
  save_picture();
  const std::string first = *read_text_file("v.png");
  const auto size_of = [](const std::string& png) {
    const auto number = [&](std::size_t at) {
      return 256 * static_cast<unsigned char>(png[at + 2]) + static_cast<unsigned char>(png[at + 3]);
    };
    return std::pair(number(16), number(20));
  };
  EXPECT_EQ(size_of(first), std::pair(shown, tall));
  press('P');
  save_picture();
  EXPECT_EQ(*read_text_file("v.png"), first) << "it asks";
  keep();
  EXPECT_EQ(*read_text_file("v.png"), first);
  save_picture();
  replace();
  EXPECT_NE(*read_text_file("v.png"), first);

  // Another size. The window's picture comes back.
  fs::remove("v.png");
  click_and_settle(18, 934);
  click_and_settle(60, 982);
  EXPECT_EQ(size_of(*read_text_file("v.png")), std::pair(1920, 1080));
  EXPECT_EQ(scene().width, shown);

  const auto save_scene = [&] { click_and_settle(40, 768); };
  const auto scene_text = [&] {
    return to_json(
        {scene(),
         {.file = "v.svol", .quality = {.max_error = default_max_error}, .drawing = {.kernel = KernelKind::moments}}});
  };
  save_scene();
  const std::string saved = *read_text_file("v.json");
  EXPECT_EQ(saved, scene_text()) << "the file is named from the scene's folder on";
  press('P');
  save_scene();
  press(key::escape);
  settle();
  EXPECT_EQ(*read_text_file("v.json"), saved);
  save_scene();
  replace();
  EXPECT_EQ(*read_text_file("v.json"), scene_text());
  EXPECT_NE(*read_text_file("v.json"), saved);
  fs::current_path(present);
}

// There the panel covers the picture, and comes with its key or its button.
// A turn: each frame is there, and the camera comes back. A movie that is stopped leaves nothing.
TEST_F(ViewerTest, FilmsATurn) {
  const fs::path present = fs::current_path();
  fs::current_path(folder);
  fs::create_directories("bin");
  // Says what it was given, and takes the last frame for the movie.
  std::ofstream("bin/ffmpeg") << "#!/bin/sh\nls v.mp4.frames/*.png | wc -l > count\nfor last; do :; done\n"
                                 "cp v.mp4.frames/frame-0029.png \"$last\"\n";
  fs::permissions("bin/ffmpeg", fs::perms::owner_all);
  const ProgramsFrom programs(path("bin"));
  constexpr int tall = 1000;
  ASSERT_TRUE(target.resize(width, tall));
  frame({WindowResized{width, tall, width, tall, 1}});
  settle();
  const Camera before = scene().camera;
  click(100, 697);  // the section "camera path"
  settle();
  frame({KeyChanged{key::left_control, true}});
  click(100, 747);  // "seconds"
  frame({KeyChanged{key::left_control, false}});
  frame({TextTyped{'1'}});
  press(key::enter);
  const auto save_movie = [&] { click(70, 901); };

  save_movie();
  for (int i = 0; i < 10; ++i) frame({});
  EXPECT_TRUE(fs::exists("v.mp4.frames/frame-0000.png"));
  EXPECT_NE(scene().camera, before);
  press(key::f1);
  press(key::escape);
  EXPECT_TRUE(fs::exists("v.mp4.frames")) << "the list of keys began after it";
  press(key::escape);
  settle();
  EXPECT_EQ(scene().camera, before);
  EXPECT_FALSE(fs::exists("v.mp4.frames"));
  EXPECT_FALSE(fs::exists("v.mp4"));

  save_movie();
  settle();
  ASSERT_TRUE(fs::exists("v.mp4"));
  EXPECT_EQ(std::stoi(*read_text_file("count")), 30) << "1 second of 30 frames";
  EXPECT_FALSE(fs::exists("v.mp4.frames"));
  EXPECT_EQ(scene().camera, before);
  EXPECT_EQ(scene().width, width - 336) << "the window's picture comes back";
  fs::current_path(present);
}

// The step comes back, too. One that cannot be read ends the movie.
TEST_F(ViewerTest, FilmsTheSteps) {
  const fs::path present = fs::current_path();
  fs::current_path(folder);
  fs::create_directories("bin");
  std::ofstream("bin/ffmpeg") << "#!/bin/sh\nls s.mp4.frames/*.png | wc -l > count\nfor last; do :; done\n"
                                 "cmp -s s.mp4.frames/frame-0001.png s.mp4.frames/frame-0002.png || echo >> count\n"
                                 "cp s.mp4.frames/frame-0003.png \"$last\"\n";
  fs::permissions("bin/ffmpeg", fs::perms::owner_all);
  const ProgramsFrom programs(path("bin"));
  require(build_series_of_files({step_at(0), step_at(1), step_at(2)}, path("s.svols"), false, {},
                                [](const char*, double) {}));
  resize(width, 1100);
  open({.volume = path("s.svols")});
  settle();
  click(100, 772);  // the section "camera path"
  settle();
  click(100, 904);  // "movie of"
  click(40, 967);   // the steps
  settle();
  click(118, 929);  // from 1
  frame({KeyChanged{key::left_control, true}});
  click(100, 979);  // "frames each"
  frame({KeyChanged{key::left_control, false}});
  frame({TextTyped{'2'}});
  press(key::enter);
  const auto save_movie = [&] { click(70, 1051); };

  save_movie();
  settle();
  ASSERT_TRUE(fs::exists("s.mp4"));
  EXPECT_EQ(*read_text_file("count"), "4\n\n") << "two frames of two steps, which differ";
  EXPECT_EQ(viewer->session()->step(), 2U);
  EXPECT_EQ(scene().width, width - 336) << "the window's picture comes back";

  fs::remove("s.mp4");
  fs::remove("s-0001.svol");
  save_movie();
  settle();
  EXPECT_FALSE(fs::exists("s.mp4"));
  EXPECT_FALSE(fs::exists("s.mp4.frames"));
  EXPECT_EQ(viewer->session()->step(), 2U);
  EXPECT_THAT(viewer->session()->troubles(), testing::ElementsAre(HasSubstr("s-0001.svol")));
  fs::current_path(present);
}

TEST_F(ViewerTest, CopiesThePicture) {
  write("bin/xclip", "#!/bin/sh\nfor last; do :; done\ncp \"$last\" '" + path("copied.png") + "'\n");
  fs::permissions(path("bin/xclip"), fs::perms::owner_all);
  ::unsetenv("WAYLAND_DISPLAY");
  const ProgramsFrom programs(path("bin"));
  constexpr int tall = 1000;
  resize(width, tall);
  settle();
  click(100, 722);  // the section "save"
  settle();
  click(230, 957);
  settle();
  const auto copied = read_text_file(path("copied.png"));
  ASSERT_TRUE(copied);
  EXPECT_EQ(copied->substr(1, 3), "PNG");
  EXPECT_FALSE(fs::exists(fs::temp_directory_path() / fmt::format("svview-{}.png", ::getpid())));
}

TEST_F(ViewerTest, ThePanelMayBeAtTheRight) {
  constexpr int tall = 1000, panel = 336;
  resize(width, tall);
  const auto shown = [&] {
    frame({PointerMoved{-1, -1}});
    settle();
    return screen();
  };
  const Image left = shown();
  click(122, 671);  // the check box "panel at the right"
  const Image right = shown();
  double difference = 0;
  for (int y = 300; y < 700; ++y)  // the picture, without numbers and axes
    for (int x = 0; x < width - panel; ++x)
      difference = std::max(difference, static_cast<double>(glm::length(left.at(x + panel, y) - right.at(x, y))));
  EXPECT_LT(difference, 0.02);
  click(width - panel + 17, 521);  // "lighting"
  settle();
  EXPECT_TRUE(scene().lighting);
  const Camera before = scene().camera;
  frame({PointerMoved{100, 300}, ButtonChanged{0, true}});
  frame({PointerMoved{150, 300}});
  frame({ButtonChanged{0, false}});
  EXPECT_NE(scene().camera, before);
}

TEST_F(ViewerTest, TwoFingersMove) {
  settle();
  const Camera before = scene().camera;
  const auto distance = [](const Camera& camera) { return glm::length(camera.position - camera.focal_point); };
  frame({PointerMoved{500, 300}});
  frame({Scrolled{1, 0}});
  const Camera aside = scene().camera;
  EXPECT_NE(aside.focal_point, before.focal_point);
  EXPECT_NEAR(distance(aside), distance(before), 1e-9);
  frame({KeyChanged{key::right_shift, true}});
  frame({Scrolled{0, 1}});
  frame({KeyChanged{key::right_shift, false}});
  EXPECT_NE(scene().camera.focal_point, aside.focal_point);
  EXPECT_NEAR(distance(scene().camera), distance(before), 1e-9);
  frame({Scrolled{0, 1}});
  EXPECT_LT(distance(scene().camera), 0.9 * distance(before));
}

TEST_F(ViewerTest, ANarrowWindowIsForThePicture) {
  resize(300, 200);
  settle();
  EXPECT_EQ(scene().width, 300);
  const auto drags = [&] {
    const Camera before = scene().camera;
    frame({PointerMoved{120, 150}});
    frame({ButtonChanged{0, true}, PointerMoved{160, 150}, ButtonChanged{0, false}});
    settle();
    const bool moved = scene().camera != before;
    press('R');
    return moved;
  };
  EXPECT_TRUE(drags());
  press(key::tab);
  EXPECT_FALSE(drags());
  EXPECT_EQ(scene().width, 300);
  press(key::tab);
  EXPECT_TRUE(drags());
  click(45, 15);
  settle();
  EXPECT_FALSE(drags());
  // In a wide window the panel stands beside the picture, as before.
  resize(width, height);
  settle();
  EXPECT_LT(scene().width, width);
}

TEST_F(ViewerTest, ADropOpensVolumesAndScenes) {
  settle();
  Scene other = scene();
  other.camera.position += dvec3(1, 0, 0);
  drop(other);
  EXPECT_EQ(scene().camera.position, other.camera.position);
  fs::copy_file(path("v.svol"), path("w.svol"));
  frame({FilesDropped{{path("w.svol")}}});
  EXPECT_EQ(viewer->session()->path(), path("w.svol"));
  // A file that is no volume changes nothing.
  write("text.svol", "text");
  frame({FilesDropped{{path("text.svol")}}});
  EXPECT_EQ(viewer->session()->path(), path("w.svol"));
  settle();
}

// ParaView's colour maps are dropped, too, and stand among the presets.
TEST_F(ViewerTest, ADropAppliesColors) {
  settle();
  const TransferFunction before = scene().transfer_function;
  const auto write = [&](const std::string& colors) {
    const std::string maps = R"([{"Name": "mine", "ColorSpace": "RGB", "RGBPoints": [)" + colors + "]}]";
    frame({FilesDropped{{FolderTest::write("maps.json", maps)}}});
  };
  write("3, 1, 0, 0, 5, 0, 0, 1");
  EXPECT_EQ(scene().transfer_function.color_at(0), dvec3(1, 0, 0));
  EXPECT_EQ(scene().transfer_function.color_at(1), dvec3(0, 0, 1));
  EXPECT_EQ(scene().transfer_function.lo, before.lo);
  EXPECT_EQ(scene().transfer_function.densities, before.densities);
  const TransferFunction mine = scene().transfer_function;
  write("3, 1, 0, 0, 5, 0, 0, 7");
  EXPECT_EQ(scene().transfer_function, mine) << "a map that is refused";

  // Opens the list of presets, chooses the first, then the last.
  const auto choose = [&](double y) {
    click(100, 87);
    click(100, y);
    settle();
  };
  choose(112);
  EXPECT_NE(scene().transfer_function, mine);
  choose(112 + 6 * 19);
  EXPECT_EQ(scene().transfer_function, mine);
}

TEST_F(ViewerTest, ExplainsEmptyPictures) {
  settle();
  EXPECT_EQ(viewer->session()->explain(), "");
  Scene away = scene();
  away.camera.focal_point = away.camera.position + (away.camera.position - away.camera.focal_point);
  drop(away);
  settle();
  EXPECT_THAT(viewer->session()->explain(), HasSubstr("outside of the view"));
  Scene clear = viewer->session()->first_scene();
  for (auto& density : clear.transfer_function.densities) density.extinction = 0;
  drop(clear);
  settle();
  EXPECT_THAT(viewer->session()->explain(), HasSubstr("hides every value"));
  Scene clipped = viewer->session()->first_scene();
  clipped.clip_box = Box{dvec3(5), dvec3(6)};
  drop(clipped);
  settle();
  EXPECT_THAT(viewer->session()->explain(), HasSubstr("clip box excludes"));
}

TEST_F(ViewerTest, ADragOverTheHistogramChangesTheOpacity) {
  settle();
  const TransferFunction before = scene().transfer_function;
  // Adds a control point in the editor's area and drags it up.
  drag({{170, 120}, {170, 70}});
  const TransferFunction& after = scene().transfer_function;
  ASSERT_EQ(after.densities.size(), before.densities.size() + 1);
  EXPECT_GT(after.extinction(0.5 * (after.lo + after.hi)), before.extinction(0.5 * (before.lo + before.hi)));
  settle();
}

TEST_F(ViewerTest, AClickPinsTheLineOfSight) {
  std::string copied;
  open_with_clipboard(copied);
  press('H');  // numbers change from frame to frame
  settle();
  const Image before = screen();
  const PictureArea picture{336, width - 336, height, 1, 1};
  click(picture.left + picture.width / 2, picture.height / 2);
  settle();
  EXPECT_GT(compare_images(screen(), before)->rmse, 0.02) << "a window with a plot";

  // The button "copy" at the window's lower left corner.
  click(picture.left + 30, height - 20);
  settle();
  ASSERT_FALSE(copied.empty());
  double x = 0, y = 0, z = 0, value = 0, opacity = 0;
  ASSERT_EQ(std::sscanf(copied.c_str(), "%lf,%lf,%lf,%lf,%lf", &x, &y, &z, &value, &opacity), 5) << copied;
  EXPECT_NEAR(value, x, 0.1) << "the value of a0 is x";
  const dvec3 at = viewer->session()->view().to_view({x, y, z});
  EXPECT_NEAR(at.x / at.z * viewer->session()->view().focal, 0, 1) << "in the picture's middle";
  EXPECT_NEAR(at.y / at.z * viewer->session()->view().focal, 0, 1);
  EXPECT_NEAR(opacity, static_cast<double>(viewer->session()->image()->at(232, 300).a), 1e-5);

  press(key::escape);
  settle();
  frame({PointerMoved{-1, -1}});
  settle();
  EXPECT_EQ(compare_images(screen(), before)->max, 0);
}

TEST_F(ViewerTest, ACommandShowsTheSame) {
  std::string copied;
  open_with_clipboard(copied);
  press('P');
  settle();
  press_with_control('C');
  const std::string begin = "svview '" + path("v.svol") + "' --scene '";
  ASSERT_EQ(copied.substr(0, begin.size()), begin);
  ASSERT_TRUE(copied.ends_with("'"));
  const std::string text = copied.substr(begin.size(), copied.size() - begin.size() - 1);
  const Image before = viewer->session()->image().value();

  open_with_clipboard(copied, text);
  settle();
  EXPECT_EQ(scene(), load_used_scene(text)->scene);
  EXPECT_LT(compare_images(viewer->session()->image().value(), before)->max, 1e-6);
  EXPECT_EQ(scene().camera.projection, Camera::Projection::orthographic);
}

TEST_F(ViewerTest, SurvivesBeingMinimisedAndTiny) {
  frame({WindowResized{0, 0, 0, 0, 1}});
  frame({WindowResized{20, 10, 20, 10, 1}});
  frame({WindowResized{width, height, width, height, 2}});
  settle();
  EXPECT_GT(brightness(viewer->session()->image().value()), 0);
}

// A picture that the card has no room for: the message stays, and the next size that fits is drawn.
TEST_F(ViewerTest, APictureThatIsTooLargeIsReported) {
  open({.volume = path("v.svol"), .settings = {.gpu_memory = 40 << 20, .device = Device::gl}});
  settle();
  EXPECT_TRUE(viewer->drawn());
  press('C');  // draws the nodes of the last frame, too

  ASSERT_TRUE(target.resize(4 * width, 4 * height));
  frame({WindowResized{4 * width, 4 * height, 4 * width, 4 * height, 1}, PointerMoved{3 * width, 2 * height}});
  settle();
  ASSERT_FALSE(viewer->drawn());
  EXPECT_THAT(viewer->drawn().error().message, HasSubstr("GPU memory"));
  ASSERT_EQ(viewer->messages().toasts().size(), 1U);
  EXPECT_EQ(viewer->messages().toasts()[0].text, viewer->drawn().error().message);
  EXPECT_EQ(viewer->messages().toasts()[0].times, 1) << "not in each frame";
  EXPECT_EQ(viewer->session()->frame(), nullptr);
  for (const int code : {'R', 'H', 'B', 'L'}) press(code);
  settle();
  EXPECT_FALSE(viewer->drawn());

  resize(width, height);
  settle();
  EXPECT_TRUE(viewer->drawn());
  EXPECT_TRUE(viewer->session()->frame());
}

// A file that is moved stays open. Of one that is cut off, no other attribute can be read: the picture stays.
TEST_F(ViewerTest, SurvivesAFileThatGoesAway) {
  open({.volume = path("v.svol"), .settings = {.memory = 1 << 20}});
  settle();
  const auto switch_to = [&](const std::string& attribute) {
    Scene other = scene();
    other.attribute = attribute;
    drop(other);
    settle();
    press('C');
    frame({PointerMoved{600, 300}});
    settle();
  };
  fs::rename(path("v.svol"), path("moved.svol"));
  switch_to("a1");
  EXPECT_TRUE(viewer->drawn());
  fs::resize_file(path("moved.svol"), 0);
  switch_to("a0");
  EXPECT_TRUE(viewer->drawn());
  EXPECT_EQ(scene().attribute, "a1");
  ASSERT_EQ(viewer->session()->troubles().size(), 1U);
  EXPECT_THAT(viewer->session()->troubles().back(), HasSubstr("v.svol"));
}

TEST_F(ViewerTest, AHighDensityDisplayGetsItsPixels) {
  frame({WindowResized{width / 2, height / 2, width, height, 1}});
  settle();
  EXPECT_EQ(scene().height, height);
}

TEST_F(ViewerTest, SaysThatThereIsNoFile) {
  open(ViewerOptions());
  EXPECT_EQ(viewer->session(), nullptr);
  ViewerOptions missing{.volume = "no/such.svol"};
  viewer.reset();
  EXPECT_THAT(Viewer::create(missing).error().message, HasSubstr("no/such.svol"));
}

}  // namespace
}  // namespace splatvol::test
