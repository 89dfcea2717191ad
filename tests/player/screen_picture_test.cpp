// Pictures as a screen takes them.
#include "player/screen_picture.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

#include "pictures/outline.h"
#include "renderer/cpu/srgb_bytes.h"

namespace splatvol {
namespace {

constexpr int width = 40, height = 30;
const Box box{dvec3(0), dvec3(1)};

// Looks at the box.
Scene scene_of(const dvec3& background, bool outline = false) {
  Scene scene;
  scene.background = background;
  scene.outline = outline;
  scene.camera.position = {0.4, 0.7, 3};
  scene.camera.focal_point = dvec3(0.5);
  return scene;
}
View view_of(const Scene& scene) { return make_view(scene.camera, width, height).value(); }

// Half covers the background.
Image half(int w, int h) {
  return {w, h, std::vector<vec4>(static_cast<std::size_t>(w) * static_cast<std::size_t>(h), vec4(0.1, 0.2, 0.3, 0.5))};
}
const Image picture = half(width, height);

std::vector<std::uint8_t> bytes_of(const Image& image, const Scene& scene) {
  std::vector<std::uint8_t> bytes;
  encode_srgb(image, scene.background, bytes);
  return bytes;
}

TEST(ScreenPicture, HasTheOutlineInPicturesOfTheViewsSize) {
  const Scene without = scene_of(dvec3(1)), with = scene_of(dvec3(1), true);
  const View view = view_of(with);
  EncodedPicture encoded;
  encode_picture(picture, view, without, box, encoded);
  EXPECT_EQ(encoded.width, width);
  EXPECT_EQ(encoded.height, height);
  EXPECT_EQ(encoded.bytes, bytes_of(picture, without));

  Image outlined = picture;
  draw_outline(outlined, view, box, ink_on(with.background));
  encode_picture(picture, view, with, box, encoded);
  EXPECT_EQ(encoded.bytes, bytes_of(outlined, with));
  EXPECT_NE(encoded.bytes, bytes_of(picture, with));

  const Image small = half(width / 2, height / 2);
  encode_picture(small, view, with, box, encoded);
  EXPECT_EQ(encoded.bytes, bytes_of(small, with));
}

TEST(ScreenPicture, IsOfOneBackgroundAndOutline) {
  const Scene scene = scene_of(dvec3(1));
  ScreenPicture screen;
  EXPECT_EQ(screen.encoded().width, 0);
  EXPECT_FALSE(screen.is_of(scene));
  EXPECT_FALSE(screen.take_news());
  screen.encode(picture, view_of(scene), scene, box);
  EXPECT_TRUE(screen.is_of(scene));
  EXPECT_FALSE(screen.is_of(scene_of(dvec3(0))));
  EXPECT_FALSE(screen.is_of(scene_of(dvec3(1), true)));
  EXPECT_TRUE(screen.take_news());
  EXPECT_FALSE(screen.take_news());
}

TEST(ScreenPicture, TakesTheNextOneIfItIsThere) {
  const Scene light = scene_of(dvec3(1)), dark = scene_of(dvec3(0));
  const View view = view_of(light);
  ScreenPicture screen;
  screen.encode(picture, view, light, box);
  EXPECT_TRUE(screen.take_news());

  screen.encode_next(picture, view, dark, box);
  EXPECT_EQ(screen.encoded().bytes, bytes_of(picture, light));
  EXPECT_FALSE(screen.take_news());
  screen.take_next(dark);
  EXPECT_EQ(screen.encoded().bytes, bytes_of(picture, dark));
  EXPECT_TRUE(screen.is_of(dark));
  EXPECT_TRUE(screen.take_news());

  screen.encode_next(picture, view, light, box);
  screen.drop_next();
  screen.take_next(light);
  EXPECT_EQ(screen.encoded().bytes, bytes_of(picture, dark)) << "the bytes before stay";
  EXPECT_FALSE(screen.is_of(light));
  EXPECT_FALSE(screen.is_of(dark)) << "but the picture is another one";
  EXPECT_FALSE(screen.take_news());
}

}  // namespace
}  // namespace splatvol
