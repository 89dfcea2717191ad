// Pictures of wide samples: joined by cubics, and made from a picture with a sample in each pixel.
#include "renderer/cpu/wide_samples.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <initializer_list>

#include "renderer/cpu/samples.h"
#include "renderer/sampled_view.h"
#include "tests/renderer/drawn_cells.h"

namespace splatvol::test {
namespace {

// Linear in the pixel, from the picture's middle.
vec4 linear(double x, double y) {
  const double light = 0.4 + 2e-3 * x - 1e-3 * y;
  return {light, 0.5 * light, 0.1, 0.9};
}

Image linear_picture(int width, int height, double spacing = 1) {
  Image picture{width, height, {}};
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      picture.pixels.push_back(linear((x + 0.5 - 0.5 * width) * spacing, (y + 0.5 - 0.5 * height) * spacing));
  return picture;
}

double most_beyond(const Image& a, const Image& b, int border) {
  double most = 0;
  for (int y = border; y < a.height - border; ++y)
    for (int x = border; x < a.width - border; ++x)
      for (int c = 0; c < 4; ++c) most = std::max(most, std::abs(double{a.at(x, y)[c]} - double{b.at(x, y)[c]}));
  return most;
}

// Where no sample lies beyond, the cubic ends level: it is off by up to 1/8 of the rise from one sample to the next, on
// both axes.
double most_at_ends(int spacing) { return 0.125 * spacing * 3e-3 + 1e-6; }

TEST(WideSamples, JoinALinearPicture) {
  for (const int size : {1, 2, 3, 7, 15, 16, 17, 31, 64})
    for (int spacing = 2; spacing <= 16; ++spacing) {
      SCOPED_TRACE(testing::Message() << size << " pixels, samples " << spacing << " apart");
      const int height = std::max(1, size / 2);
      const Image samples = linear_picture(sample_count(size, spacing), sample_count(height, spacing), spacing);
      const Image exact = linear_picture(size, height);
      Image rows, picture{size, height, exact.pixels};
      tiles::interpolate(samples, spacing, rows, picture);
      EXPECT_LE(most_beyond(picture, exact, 0), most_at_ends(spacing));
      EXPECT_LE(most_beyond(picture, exact, spacing), 1e-6);
    }
}

TEST(WideSamples, OfALinearPictureAreThatPicture) {
  for (const int size : {1, 2, 3, 7, 15, 16, 17, 31, 64})
    for (int spacing = 1; spacing <= 16; ++spacing) {
      SCOPED_TRACE(testing::Message() << size << " pixels, samples " << spacing << " apart");
      const Image exact = linear_picture(size, std::max(1, size / 2)), picture = with_wide_samples(exact, spacing);
      ASSERT_EQ(picture.width, exact.width);
      ASSERT_EQ(picture.height, exact.height);
      // A single sample on an axis goes on level.
      const double level = size <= spacing || size / 2 <= spacing ? 3e-3 * spacing : 0;
      EXPECT_LE(most_beyond(picture, exact, 0), most_at_ends(spacing) + level);
      EXPECT_LE(most_beyond(picture, exact, spacing), 1e-6);
    }
}

Drawn bent_box_of(int width, int height) {
  Drawn drawn{bent_box(8), colored_scene(4)};
  drawn.scene.width = width, drawn.scene.height = height;
  return drawn;
}

// An odd number of pixels and an even spacing: samples lie at pixels' centres. Beyond the ends they are guessed.
TEST(WideSamples, AreThoseThatAreDrawnAtCentresOfPixels) {
  const Drawn drawn = bent_box_of(133, 121);
  const MeshSource source(drawn.view(), 1000);
  CellDrawing drawing = drawn.drawing();
  const Image exact = draw(source, drawing);
  for (const int spacing : {2, 4, 6, 8, 16}) {
    SCOPED_TRACE(testing::Message() << spacing);
    drawing.sample_spacing = spacing;
    const Image drawn_so = draw(source, drawing), made = with_wide_samples(exact, spacing);
    EXPECT_LE(most_beyond(made, drawn_so, spacing + spacing / 2), 1e-4);
    const double error = difference(drawn_so, exact).rmse;
    EXPECT_GT(error, 0);
    EXPECT_NEAR(difference(made, exact).rmse / error, 1, 0.05);
  }
}

TEST(WideSamples, HaveTheErrorOfThoseThatAreDrawnBetweenCentres) {
  const Drawn drawn = bent_box_of(256, 230);
  const MeshSource source(drawn.view(), 1000);
  CellDrawing drawing = drawn.drawing();
  const Image exact = draw(source, drawing);
  for (const int spacing : {2, 4, 8}) {
    SCOPED_TRACE(testing::Message() << spacing);
    drawing.sample_spacing = spacing;
    const double error = difference(draw(source, drawing), exact).rmse;
    EXPECT_GT(error, 0);
    EXPECT_NEAR(difference(with_wide_samples(exact, spacing), exact).rmse / error, 1, 0.1);
  }
}

bool is_same(const vec4& a, const vec4& b) { return std::memcmp(&a, &b, sizeof(vec4)) == 0; }

/// How many pixels of a refined picture are exact. The others are those of the picture without.
std::size_t count_refined(const Image& refined, const Image& plain, const Image& exact) {
  std::size_t count = 0;
  for (std::size_t i = 0; i < refined.pixels.size(); ++i) {
    if (is_same(refined.pixels[i], plain.pixels[i])) continue;
    EXPECT_TRUE(is_same(refined.pixels[i], exact.pixels[i])) << "pixel " << i;
    ++count;
  }
  return count;
}

TEST(WideSamples, AreExactInBlocksThatDiffer) {
  Drawn drawn = bent_box_of(256, 230), lit = drawn, cut = drawn;
  lit.scene.lighting = Lighting{0.2, 0.7};
  cut.scene.clip_planes = {{{0.5, 0.5, 0.5}, {1, -0.6, 0.3}, true}};
  for (const Drawn* each : std::initializer_list<const Drawn*>{&drawn, &lit, &cut})
    for (const int spacing : {4, 8}) {
      SCOPED_TRACE(testing::Message() << spacing);
      const MeshSource source(each->view(), 300);
      CellDrawing drawing = each->drawing();
      const Image exact = draw(source, drawing);
      drawing.sample_spacing = spacing;
      const Image plain = draw(source, drawing);
      drawing.refined_difference = 0.05F;
      const Image refined = draw(source, drawing);
      const std::size_t count = count_refined(refined, plain, exact);
      EXPECT_GT(count, 0);
      EXPECT_LT(count, exact.pixels.size() / 2);
      EXPECT_LT(difference(refined, exact).rmse, 0.5 * difference(plain, exact).rmse);
      drawing.memory = std::uint64_t{1} << 12;  // many sweeps
      EXPECT_EQ(count_refined(draw(source, drawing), refined, refined), 0);
    }
}

TEST(WideSamples, AreRefinedAsThoseThatAreDrawn) {
  const Drawn drawn = bent_box_of(133, 121);
  const MeshSource source(drawn.view(), 1000);
  CellDrawing drawing = drawn.drawing();
  const Image exact = draw(source, drawing);
  for (const int spacing : {4, 8}) {
    drawing.sample_spacing = spacing;
    drawing.refined_difference = 0.05F;
    const Image drawn_so = draw(source, drawing), made = with_wide_samples(exact, spacing, 0.05F);
    EXPECT_LE(most_beyond(made, drawn_so, spacing + spacing / 2), 1e-4);
  }
}

TEST(WideSamples, MayBeFartherApartThanThePictureIsWide) {
  for (const int width : {1, 2, 5, 17, 40})
    for (int spacing = 1; spacing <= 16; ++spacing) {
      SCOPED_TRACE(testing::Message() << width << " pixels, samples " << spacing << " apart");
      const Drawn drawn = bent_box_of(width, std::max(1, width / 2));
      const MeshSource source(drawn.view(), 300);
      CellDrawing drawing = drawn.drawing();
      const Image exact = draw(source, drawing);
      drawing.sample_spacing = spacing;
      const Image plain = draw(source, drawing);
      for (const vec4& pixel : plain.pixels) {
        EXPECT_GE(std::min({pixel.r, pixel.g, pixel.b}), 0);
        EXPECT_LE(std::max({pixel.r, pixel.g, pixel.b}), pixel.a + 1e-6F);
        EXPECT_LE(pixel.a, 1 + 1e-6F);
      }
      drawing.refined_difference = 1e-9F;
      count_refined(draw(source, drawing), plain, exact);
    }
}

}  // namespace
}  // namespace splatvol::test
