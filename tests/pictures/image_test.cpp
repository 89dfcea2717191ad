#include "pictures/image.h"

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfInputFile.h>
#include <ImfOutputFile.h>
#include <ImfStringAttribute.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

#include "scene/srgb.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

Image ramp(int width, int height) {
  Image image{width, height, {}};
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) image.pixels.emplace_back(x + 0.1F, y / 7.0F, 1e-30F * x, 1 - 1.0F / (1 + x + y));
  return image;
}

using ImageFile = FolderTest;

TEST_F(ImageFile, ExrKeepsEveryBit) {
  const Image image = ramp(37, 21);
  ASSERT_TRUE(write_image(path("a.exr"), image, dvec3(1), {}));
  const auto read = value_of(read_exr(path("a.exr")));
  EXPECT_EQ(read.width, 37);
  EXPECT_EQ(read.height, 21);
  EXPECT_EQ(read.pixels, image.pixels);
  EXPECT_EQ(names().size(), 1U);
}

TEST_F(ImageFile, ExrIsZipFloatWithProvenance) {
  ASSERT_TRUE(write_image(path("a.exr"), ramp(5, 4), dvec3(0), {{"scene", "bluntfin \xc3\xa9"}, {"mesh", ""}}));
  Imf::InputFile file(path("a.exr").c_str());
  EXPECT_EQ(file.header().compression(), Imf::ZIP_COMPRESSION);
  EXPECT_EQ(file.header().channels().findChannel("A")->type, Imf::FLOAT);
  EXPECT_EQ(file.header().typedAttribute<Imf::StringAttribute>("scene").value(), "bluntfin \xc3\xa9");
  EXPECT_EQ(file.header().typedAttribute<Imf::StringAttribute>("mesh").value(), "");
}

TEST_F(ImageFile, ReadsHalfFloatsWithoutAlphaAndAShiftedWindow) {
  const Imath::Box2i window({-3, 5}, {0, 6});
  Imf::Header header(Imath::Box2i({0, 0}, {9, 9}), window);
  std::vector<half> values;
  for (int i = 0; i < 24; ++i) values.emplace_back(static_cast<float>(i));
  Imf::FrameBuffer buffer;
  for (int channel = 0; channel < 3; ++channel) {
    const char* name = &"R\0G\0B"[2 * channel];
    header.channels().insert(name, Imf::Channel(Imf::HALF));
    char* base = reinterpret_cast<char*>(values.data() + channel) - 5 * 4 * 6 + 3 * 6;
    buffer.insert(name, Imf::Slice(Imf::HALF, base, 6, 24));
  }
  {
    Imf::OutputFile file(path("half.exr").c_str(), header);
    file.setFrameBuffer(buffer);
    file.writePixels(2);
  }
  const auto image = value_of(read_exr(path("half.exr")));
  ASSERT_EQ(image.width, 4);
  ASSERT_EQ(image.height, 2);
  EXPECT_EQ(image.at(0, 0), vec4(0, 1, 2, 1));
  EXPECT_EQ(image.at(3, 1), vec4(21, 22, 23, 1));
}

TEST_F(ImageFile, ReadingRefusesEveryTruncation) {
  ASSERT_TRUE(write_image(path("a.exr"), ramp(9, 40), dvec3(0), {{"scene", "x"}}));
  const std::string bytes = read("a.exr");
  ASSERT_FALSE(bytes.empty());
  for (std::size_t length = 0; length < bytes.size(); ++length) {
    write("cut.exr", bytes.substr(0, length));
    const auto image = read_exr(path("cut.exr"));
    ASSERT_FALSE(image) << length << " of " << bytes.size();
    ASSERT_THAT(image.error().message, StartsWith(path("cut.exr") + ": "));
  }
}

TEST_F(ImageFile, ReadingNamesWhatIsNoPicture) {
  EXPECT_THAT(read_exr(path("none.exr")).error().message, StartsWith(path("none.exr") + ": "));
  write("text.exr", "no picture at all, but long enough to hold a magic number");
  const auto text = read_exr(path("text.exr"));
  ASSERT_FALSE(text);
  EXPECT_THAT(text.error().message, StartsWith(path("text.exr") + ": "));
  EXPECT_EQ(text.error().message.find('\n'), std::string::npos);
}

TEST_F(ImageFile, ReadingNamesTheMissingChannel) {
  Imf::Header header(2, 2);
  std::vector<float> values(4);
  Imf::FrameBuffer buffer;
  for (const char* name : {"R", "B"}) {
    header.channels().insert(name, Imf::Channel(Imf::FLOAT));
    buffer.insert(name, Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(values.data()), 4, 8));
  }
  {
    Imf::OutputFile file(path("rb.exr").c_str(), header);
    file.setFrameBuffer(buffer);
    file.writePixels(2);
  }
  EXPECT_THAT(read_exr(path("rb.exr")).error().message, HasSubstr("no channel G"));
}

/// Reads the pixels of an 8-bit RGB file with libpng's simplified interface.
std::vector<png_byte> read_png(const std::string& path, unsigned& width, unsigned& height) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  EXPECT_TRUE(png_image_begin_read_from_file(&image, path.c_str())) << image.message;
  image.format = PNG_FORMAT_RGB;
  width = image.width;
  height = image.height;
  std::vector<png_byte> bytes(PNG_IMAGE_SIZE(image));
  EXPECT_TRUE(png_image_finish_read(&image, nullptr, bytes.data(), 0, nullptr)) << image.message;
  return bytes;
}

TEST_F(ImageFile, PngIsOverTheBackgroundThenSrgb) {
  constexpr float missing = std::numeric_limits<float>::quiet_NaN();
  const Image image{3,
                    2,
                    {vec4(0), vec4(0.215861F, 0, 0, 1), vec4(0.25F, 0, 0, 0.5F),  //
                     vec4(5, -1, missing, 1), vec4(0.0025F, 0, 1, 1), vec4(1, 1, 1, 1)}};
  ASSERT_TRUE(write_image(path("a.png"), image, {1, 0.5, 0}, {}));
  unsigned width = 0;
  unsigned height = 0;
  const auto bytes = read_png(path("a.png"), width, height);
  EXPECT_EQ(width, 3U);
  EXPECT_EQ(height, 2U);
  // sRGB: 0.5 -> 188, 0.75 -> 225, 0.215861 -> 128, 0.25 -> 137, 0.0025 -> 8.2.
  const std::vector<png_byte> expected = {255, 188, 0, 128, 0, 0, 225, 137, 0, 255, 0, 0, 8, 0, 255, 255, 255, 255};
  EXPECT_EQ(bytes, expected);
}

// At the numbers where one byte becomes the next, and next to them.
TEST_F(ImageFile, PngRoundsLikeTheCurve) {
  Image image{257, 3, {}};
  for (const float beyond : {-1.0F, 0.0F, 2.0F})
    for (int i = 0; i < 257; ++i) {
      const auto border = static_cast<float>(linear_of((i - 0.5) / 255));
      image.pixels.emplace_back(vec3(std::nextafter(border, beyond)), 1);
    }
  ASSERT_TRUE(write_image(path("a.png"), image, dvec3(0), {}));
  unsigned width = 0;
  unsigned height = 0;
  const auto bytes = read_png(path("a.png"), width, height);
  ASSERT_EQ(bytes.size(), 3 * image.pixels.size());
  for (std::size_t i = 0; i < image.pixels.size(); ++i)
    EXPECT_EQ(bytes[3 * i], std::lround(255 * srgb_of(double{image.pixels[i].r}))) << i;
}

TEST_F(ImageFile, PngHoldsProvenance) {
  ASSERT_TRUE(write_image(path("a.png"), ramp(2, 2), dvec3(0), {{"scene", "post"}}));
  const std::string bytes = read("a.png");
  EXPECT_THAT(bytes, HasSubstr(std::string("scene\0\0\0\0\0post", 14)));
  EXPECT_THAT(bytes, HasSubstr("sRGB"));
}

TEST_F(ImageFile, FailedWritesLeaveNothing) {
  EXPECT_FALSE(write_image(path("a.jpg"), ramp(2, 2), dvec3(0), {}));
  EXPECT_FALSE(write_image(path("a.exr"), Image{2, 2, {}}, dvec3(0), {}));
  EXPECT_FALSE(write_image(path("a.png"), Image{}, dvec3(0), {}));
  EXPECT_EQ(names().size(), 0U);
  EXPECT_THAT(message_of(write_image(path("none/a.exr"), ramp(2, 2), dvec3(0), {})),
              StartsWith(path("none/a.exr") + ": "));
}

TEST(ImagePath, KnowsItsExtensions) {
  EXPECT_TRUE(is_image_path("a/b.exr"));
  EXPECT_TRUE(is_image_path("B.PNG"));
  for (const char* path : {"", "exr", "a.exr/b", "a.jpg", ".exr", "a.exr.gz"})
    EXPECT_FALSE(is_image_path(path)) << path;
}

TEST(CompareImages, MeasuresRgbOnly) {
  const Image a{2, 1, {vec4(1, 0, 0, 1), vec4(0, 0, 0, 0)}};
  const Image b{2, 1, {vec4(0.5, 0, 0, 0), vec4(0, 0.25, 0, 9)}};
  const auto difference = compare_images(a, b);
  ASSERT_TRUE(difference);
  EXPECT_NEAR(difference->rmse, std::sqrt((0.25 + 0.0625) / 6), 1e-15);
  EXPECT_NEAR(difference->psnr, 10 * std::log10(6 / 0.3125), 1e-12);
  EXPECT_EQ(difference->max, 0.5);
  EXPECT_NEAR(difference->mean_a, 1.0 / 6, 1e-15);
  EXPECT_NEAR(difference->mean_b, 0.75 / 6, 1e-15);
}

TEST(CompareImages, EqualPicturesAreInfinitelyAlike) {
  const auto difference = compare_images(ramp(4, 4), ramp(4, 4));
  ASSERT_TRUE(difference);
  EXPECT_EQ(difference->rmse, 0);
  EXPECT_EQ(difference->psnr, std::numeric_limits<double>::infinity());
}

TEST(CompareImages, ANanIsNeverHidden) {
  Image broken = ramp(3, 3);
  broken.at(1, 1).g = std::numeric_limits<float>::quiet_NaN();
  const auto difference = compare_images(broken, ramp(3, 3));
  ASSERT_TRUE(difference);
  EXPECT_TRUE(std::isnan(difference->rmse));
  EXPECT_TRUE(std::isnan(difference->max));
}

/// A picture whose pixels have an alpha of 1 and one number in all channels.
template <class Function>
Image opaque(int width, int height, const Function& number) {
  Image image{width, height, {}};
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) image.pixels.emplace_back(vec3(static_cast<float>(number(x, y))), 1.0F);
  return image;
}

double ripple_of(const std::function<double(int, int)>& difference) {
  const Image flat = opaque(256, 192, [](int, int) { return 0.5; });
  return compare_as_seen(flat, opaque(256, 192, [&](int x, int y) { return 0.5 + difference(x, y); })).value().ripple;
}

TEST(CompareAsSeen, RippleIsWhatIsNarrow) {
  const auto wave = [](double period) {
    return [period](int x, int) { return 0.1 * std::sin(2 * std::numbers::pi * (x + 0.3) / period); };
  };
  const double whole = 0.1 / std::numbers::sqrt2;
  EXPECT_NEAR(ripple_of(wave(16)), 0.5 * whole, 0.02 * whole);
  EXPECT_NEAR(ripple_of(wave(4)), whole, 0.02 * whole);
  EXPECT_LT(ripple_of(wave(128)), 0.05 * whole);
  EXPECT_LT(ripple_of([](int, int) { return 0.1; }), 1e-6);
}

/// A disc of alpha 1 on nothing.
Image disc(double radius, float brightness) {
  Image image{64, 64, {}};
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 64; ++x) {
      const bool inside = std::hypot(x - 31.5, y - 31.5) < radius;
      image.pixels.emplace_back(inside ? vec4(vec3(brightness), 1) : vec4(0));
    }
  return image;
}

TEST(CompareAsSeen, AnOutlineThatIsMovedIsNoRipple) {
  const SeenDifference moved = compare_as_seen(disc(20, 1), disc(21, 1)).value();
  EXPECT_LT(moved.ripple, 1e-9);
  EXPECT_GT(moved.outline, 0.2);
  const SeenDifference same = compare_as_seen(disc(20, 1), disc(20, 1)).value();
  EXPECT_EQ(same.outline, 0);
  EXPECT_EQ(same.ripple, 0);
}

TEST(CompareAsSeen, SmallPicturesHaveBoth) {
  const Image point{1, 1, {vec4(1)}}, other{1, 1, {vec4(0.5, 0.5, 0.5, 1)}};
  EXPECT_EQ(compare_as_seen(point, other)->ripple, 0) << "a pixel is its own mean";
  EXPECT_EQ(compare_as_seen(point, other)->outline, 0) << "there is none";
  const Image edge{2, 1, {vec4(1), vec4(0)}}, empty{2, 1, {vec4(0), vec4(0)}};
  EXPECT_NEAR(compare_as_seen(edge, empty)->outline, std::sqrt(0.5), 1e-9);
  EXPECT_EQ(compare_as_seen(edge, empty)->ripple, 0) << "all is outline";
  EXPECT_FALSE(compare_as_seen(edge, point));
}

TEST(CompareImages, RefusesDifferentSizes) {
  EXPECT_EQ(message_of(compare_images(ramp(2, 3), ramp(3, 2))), "sizes differ: 2 x 3 and 3 x 2");
}

}  // namespace
}  // namespace splatvol::test
