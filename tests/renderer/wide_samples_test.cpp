// Pictures of wide samples: joined by cubics, and made from a picture with a sample in each pixel.
#include "renderer/cpu/wide_samples.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>

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

}  // namespace
}  // namespace splatvol::test
