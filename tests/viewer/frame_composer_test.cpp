// Frames where the processor draws the picture: what is copied, kept and left out.
#include <gtest/gtest.h>
#include <imgui.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>
#include <thread>

#include "scene/srgb.h"
#include "tests/viewer/viewer_fixture.h"
#include "viewer/frame_loop.h"
#include "viewer/window/frame_composer.h"
#include "viewer/window/laid_out.h"
#include "viewer/window/presenter.h"

namespace splatvol::test {
namespace {

constexpr int width = 160, height = 90, left = 40;

// Returns a picture whose bytes differ from pixel to pixel. `seed`: of another picture.
EncodedPicture picture_of(int picture_width, int picture_height, int seed = 0) {
  EncodedPicture picture{picture_width, picture_height, {}};
  for (int i = 0; i < picture_width * picture_height; ++i)
    for (const int byte : {7 * i + seed, i / picture_width + 3 * seed, 40 + i % 101, 255})
      picture.bytes.push_back(static_cast<std::uint8_t>(byte));
  return picture;
}

std::array<int, 3> bytes_at(const Image& image, int x, int y) {
  const vec4& pixel = image.at(x, y);
  const auto byte = [](float linear) {
    return static_cast<int>(std::lround(255 * srgb_of(static_cast<double>(linear))));
  };
  return {byte(pixel.r), byte(pixel.g), byte(pixel.b)};
}

// The most that a byte differs by.
int difference(const Image& a, const Image& b) {
  int most = 0;
  for (int y = 0; y < a.height; ++y)
    for (int x = 0; x < a.width; ++x)
      for (std::size_t c = 0; c < 3; ++c) most = std::max(most, std::abs(bytes_at(a, x, y)[c] - bytes_at(b, x, y)[c]));
  return most;
}

// Of a layer's bytes: a window's ground and its words are rounded once each, and the blending once more.
constexpr int rounding = 2;

struct FrameComposerTest : testing::Test {
  void SetUp() override {
    ASSERT_TRUE(shared_context());
    gui = *Gui::create(1);
    composer.emplace(*FrameComposer::create());
    ASSERT_TRUE(frame.resize(width, height));
  }

  // A window over the picture and over the dark columns, a line over the picture alone.
  void draw_interface() {
    ASSERT_TRUE(gui->begin({seconds, {}}, {width, height, width, height, 1}));
    ImGui::SetNextWindowPos({20, 30});
    ImGui::SetNextWindowSize({90, 40});
    ImGui::Begin("window", nullptr, ImGuiWindowFlags_NoDecoration);
    ImGui::TextUnformatted(text.c_str());
    ImGui::End();
    ImGui::GetBackgroundDrawList()->AddLine({line, 5}, {150, 85}, IM_COL32(255, 255, 0, 160), 3);
    gui->end();
  }

  // Returns whether a frame was drawn.
  bool compose(const EncodedPicture& picture, bool is_new, bool is_lost = false) {
    draw_interface();
    const FrameParts parts{&picture, is_new, left, width - left, width, height, is_lost, seconds};
    const auto drawn = composer->compose(parts, *gui, frame.framebuffer());
    EXPECT_TRUE(drawn) << drawn.error().message;
    return drawn.value_or(false);
  }
  Image shown() const {
    frame.use();
    return read_framebuffer(width, height).value();
  }

  // The same frame without a layer: picture, lines, and windows, one over the other.
  Image drawn_at_once(const EncodedPicture& picture) {
    ByteTarget target;
    EXPECT_TRUE(target.resize(width, height));
    std::vector<std::uint32_t> pixels(std::size_t{width} * height, 0xFF1A1A1CU);  // 0.1, 0.1, 0.11
    std::vector<std::uint32_t> laid_out;
    lay_out(picture, width - left, height, false, laid_out);
    for (int y = 0; y < height; ++y)
      std::copy_n(&laid_out[static_cast<std::size_t>(y * (width - left))], width - left,
                  &pixels[static_cast<std::size_t>(y * width + left)]);
    EXPECT_TRUE(target.write(pixels));
    target.use();
    EXPECT_TRUE(gui->draw());
    target.use();
    return read_framebuffer(width, height).value();
  }

  double seconds = 1;
  std::string text = "words";
  float line = 60;
  std::unique_ptr<Gui> gui;
  std::optional<FrameComposer> composer;
  ByteTarget frame;
};

TEST_F(FrameComposerTest, ShowsPictureLinesAndWindows) {
  const EncodedPicture picture = picture_of(width - left, height);
  draw_interface();  // a window appears a frame after it was begun
  ASSERT_TRUE(compose(picture, true, true));
  const Image composed = shown();
  EXPECT_LE(difference(composed, drawn_at_once(picture)), rounding);
  const std::size_t corner = std::size_t{4} * (5 * (width - left) + 7);
  EXPECT_EQ(bytes_at(composed, left + 7, 5),
            (std::array<int, 3>{picture.bytes[corner], picture.bytes[corner + 1], picture.bytes[corner + 2]}))
      << "the highest row comes first";
  EXPECT_NE(bytes_at(composed, 60, 50), bytes_at(shown(), 150, 50));
}

TEST_F(FrameComposerTest, DrawsNothingWithoutAChange) {
  const EncodedPicture picture = picture_of(width - left, height);
  draw_interface();
  EXPECT_TRUE(compose(picture, true));
  EXPECT_FALSE(compose(picture, false));
  EXPECT_TRUE(compose(picture, false, true)) << "the framebuffer is lost";
  EXPECT_FALSE(compose(picture, false));
}

// Each change alone: the windows, what lies over the picture, and the picture.
TEST_F(FrameComposerTest, DrawsWhatHasChanged) {
  const EncodedPicture picture = picture_of(width - left, height), other = picture_of(width - left, height, 5);
  draw_interface();
  ASSERT_TRUE(compose(picture, true));
  text = "other words";
  EXPECT_TRUE(compose(picture, false));
  EXPECT_LE(difference(shown(), drawn_at_once(picture)), rounding);
  line = 90;
  EXPECT_TRUE(compose(picture, false));
  EXPECT_LE(difference(shown(), drawn_at_once(picture)), rounding);
  line = 70;
  EXPECT_TRUE(compose(other, true)) << "the lines of the camera that the picture has";
  EXPECT_LE(difference(shown(), drawn_at_once(other)), rounding);
  EXPECT_FALSE(compose(other, false));
}

// Beside new pictures, the windows may be a 30th of a second old; the lines over the picture may not.
TEST_F(FrameComposerTest, WindowsWaitBesideMovingPictures) {
  const EncodedPicture picture = picture_of(width - left, height);
  draw_interface();
  ASSERT_TRUE(compose(picture, true));
  const Image before = shown();
  seconds = 0.01;
  text = "other words";
  ASSERT_TRUE(compose(picture, true));
  EXPECT_EQ(difference(shown(), before), 0);
  EXPECT_GT(composer->waiting_seconds().value(), 0.02);
  line = 90;
  ASSERT_TRUE(compose(picture, true));
  const Image moved = shown();
  EXPECT_GT(difference(moved, before), 0);
  seconds = 0.02;
  ASSERT_TRUE(compose(picture, true));
  EXPECT_GT(difference(shown(), moved), 0);
  EXPECT_FALSE(composer->waiting_seconds());
  EXPECT_LE(difference(shown(), drawn_at_once(picture)), rounding);
  // A frame between two pictures draws nothing for them, but one that comes later does.
  seconds = 0.02;
  text = "words";
  EXPECT_FALSE(compose(picture, false));
  EXPECT_LT(composer->waiting_seconds().value(), 0.02);
  ASSERT_TRUE(compose(picture, false));
  EXPECT_LE(difference(shown(), drawn_at_once(picture)), rounding);
}

TEST_F(FrameComposerTest, TakesPicturesOfAnySize) {
  for (const auto& [picture_width, picture_height] : {std::pair(60, 45), {1, 1}, {300, 200}, {0, 0}}) {
    const EncodedPicture picture = picture_of(picture_width, picture_height);
    draw_interface();
    ASSERT_TRUE(compose(picture, true));
    if (picture_width > 0)
      EXPECT_LE(difference(shown(), drawn_at_once(picture)), rounding) << picture_width;
    else
      EXPECT_EQ(bytes_at(shown(), 155, 85), (std::array<int, 3>{0, 0, 0}));
  }
}

// A picture of a linear slope stays one: the filter's places are the pixels' centres.
TEST(LaidOut, StretchesLinearly) {
  EncodedPicture slope{16, 8, {}};
  for (int y = 0; y < slope.height; ++y)
    for (int x = 0; x < slope.width; ++x)
      for (const int byte : {10 * x, 20 * y, 3, 255}) slope.bytes.push_back(static_cast<std::uint8_t>(byte));
  constexpr int wide = 64, high = 40;
  for (const bool top_first : {true, false}) {
    std::vector<std::uint32_t> pixels;
    lay_out(slope, wide, high, top_first, pixels);
    for (int y = 0; y < high; ++y)
      for (int x = 0; x < wide; ++x) {
        const std::uint32_t pixel = pixels[static_cast<std::size_t>((top_first ? y : high - 1 - y) * wide + x)];
        const double at_x = std::clamp((x + 0.5) / 4 - 0.5, 0.0, 15.0),
                     at_y = std::clamp((y + 0.5) / 5 - 0.5, 0.0, 7.0);
        ASSERT_NEAR(pixel >> 16 & 0xFF, 10 * at_x, 1) << x << " " << y;
        ASSERT_NEAR(pixel >> 8 & 0xFF, 20 * at_y, 1) << x << " " << y;
        ASSERT_EQ(pixel & 0xFF, 3U);
        ASSERT_EQ(pixel >> 24, 255U);
      }
  }
}

TEST(PixelRect, RectanglesBecomeDisjoint) {
  const std::vector<PixelRect> rects = {
      {0, 0, 10, 10}, {20, 0, 30, 10}, {50, 50, 50, 60}, {8, 8, 22, 9}, {40, 0, 45, 5}};
  EXPECT_EQ(disjoint(rects), (std::vector<PixelRect>{{0, 0, 30, 10}, {40, 0, 45, 5}}));
  EXPECT_TRUE(disjoint({}).empty());
}

// The whole viewer on the processor.
struct FramesTest : ViewerFixture {
  void SetUp() override {
    ViewerFixture::SetUp();
    write_two_attributes(path("v.svol"));
    resize(1000, 600);
    open({.volume = path("v.svol"), .settings = {.device = Device::cpu, .works_aside = false}});
    settle();
  }
};

TEST_F(FramesTest, NothingNewNothingDrawn) {
  frame({});
  EXPECT_FALSE(viewer->has_drawn());
  const Image before = screen();
  viewer->redraw();
  frame({});
  EXPECT_TRUE(viewer->has_drawn());
  EXPECT_EQ(compare_images(before, screen())->max, 0);
  frame({PointerMoved{700, 300}});
  settle();
  frame({});
  EXPECT_FALSE(viewer->has_drawn());
  frame({WindowResized{1000, 600, 1000, 600, 1}});
  EXPECT_TRUE(viewer->has_drawn()) << "the desktop asks for the window's contents";
}

// What a key hides is gone, though no picture comes.
TEST_F(FramesTest, TheInterfaceIsDrawnWhereItChanges) {
  const Image before = screen();
  press('H');  // the numbers
  settle();
  const Image without = screen();
  EXPECT_GT(compare_images(before, without)->max, 0);
  press('H');
  settle();
  EXPECT_EQ(compare_images(before, screen())->max, 0);
}

// The box round the data lies on the new picture, not on the one before.
TEST_F(FramesTest, OverlaysFollowThePicture) {
  press('H');
  press('2');
  settle();
  const Image before = screen();
  press('1');
  settle();
  const Image turned = screen();
  EXPECT_GT(compare_images(before, turned)->max, 0);
  viewer->redraw();
  frame({});
  EXPECT_EQ(compare_images(turned, screen())->max, 0) << "a frame that is drawn anew shows the same";
}

// The loop shows what is drawn and nothing else. Events come with the next frame.
TEST_F(FramesTest, TheLoopShowsFramesThatAreDrawn) {
  int frames = 0, shown = 0, waits = 0;
  std::vector<Event> events;
  const auto take = [&](double wait_seconds) {
    std::this_thread::sleep_for(std::chrono::duration<double>(std::min(wait_seconds, 0.001)));
    ++waits;
    return FrameInput{frame_seconds, std::exchange(events, {})};
  };
  const auto begin = [&](const FrameInput&) {
    ++frames;
    target.use();
    return Status{};
  };
  FrameLoop loop(*viewer, {take, begin, [&] { ++shown; }});
  ASSERT_FALSE(loop.step().value());
  EXPECT_EQ(frames, 0) << "it rests";
  EXPECT_EQ(waits, 1);
  events = {KeyChanged{'1', true}, KeyChanged{'1', false}};
  const dvec3 position = scene().camera.position;
  for (int i = 0; i < 100000 && (i == 0 || !viewer->is_settled()); ++i) ASSERT_TRUE(loop.step());
  EXPECT_NE(scene().camera.position, position);
  EXPECT_TRUE(viewer->is_settled());
  EXPECT_GE(shown, 1);
  EXPECT_LE(shown, frames);
  const int frames_before = frames;
  ASSERT_FALSE(loop.step().value());
  EXPECT_EQ(frames, frames_before);
}

}  // namespace
}  // namespace splatvol::test
