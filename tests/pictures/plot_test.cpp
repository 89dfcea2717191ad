// Plots of curves, as pictures.
#include "pictures/plot.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <set>

namespace splatvol {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

TEST(Plot, KeepsTheRowsThatAreSeen) {
  const std::vector<double> places = {0, 1, 2, 3, 4, 5, 6, 7}, values = {0, 9, 1, NAN, 2, -5, 3, 4};
  EXPECT_THAT(rows_of_plot(places, values, 100), ElementsAre(0, 1, 2, 3, 4, 5, 6, 7)) << "each has a column";
  EXPECT_THAT(rows_of_plot(places, values, 1), ElementsAre(0, 1, 3, 5, 6, 7)) << "ends, most, none and least";
  EXPECT_THAT(rows_of_plot(std::vector<double>{2, 2}, std::vector<double>{1, 3}, 50), ElementsAre(0, 1)) << "a jump";
  std::vector<double> many, waves;
  for (int i = 0; i < 100000; ++i) many.push_back(i), waves.push_back(std::sin(i));
  EXPECT_LE(rows_of_plot(many, waves, 300).size(), 5 * 301);
}

TEST(Plot, RangesLeaveOutWhatIsMissing) {
  EXPECT_TRUE(range_of(std::vector<double>{NAN, NAN}).is_empty());
  const PlotRange range = range_of(std::vector<double>{NAN, 3, -2});
  EXPECT_EQ(range.low, -2);
  EXPECT_EQ(range.high, 3);
  CurvePlot plot{.places = {0, 1}, .curves = {{"a", {0, 1}}, {"b", {5, 9}}, {"c", {NAN, NAN}}}};
  EXPECT_EQ(axis_of_curve(plot, 0).high, 9);
  EXPECT_EQ(axis_of_curve(plot, 2).low, 0);
  plot.has_common_axis = false;
  EXPECT_EQ(axis_of_curve(plot, 0).high, 1);
  EXPECT_EQ(axis_of_curve(plot, 1).low, 5);
}

// Returns the columns that have pixels of about the curve's colour.
std::set<int> columns_of(const Image& image, std::size_t number) {
  std::set<int> columns;
  for (int y = 70; y < image.height; ++y)  // below the words
    for (int x = 0; x < image.width; ++x)
      if (glm::length(dvec3(image.at(x, y)) - color_of_curve(number)) < 0.25) columns.insert(x);
  return columns;
}

TEST(Plot, DrawsCurvesWithGaps) {
  const CurvePlot plot{.places = {0, 4, 4, 6, 6, 10},
                       .curves = {{"whole", {1, 5, 5, 5, 5, 2}},
                                  {"parts", {0, 2, NAN, NAN, 3, 3}},
                                  {"none", {NAN, NAN, NAN, NAN, NAN, NAN}}},
                       .place_name = "distance"};
  for (const bool common : {true, false}) {
    CurvePlot drawn = plot;
    drawn.has_common_axis = common;
    const auto image = draw_plot(drawn, 640, 400);
    ASSERT_TRUE(image);
    EXPECT_EQ(image->width, 640);
    const std::set<int> whole = columns_of(*image, 0), parts = columns_of(*image, 1);
    ASSERT_GT(whole.size(), 400);
    const int left = *whole.begin(), right = *whole.rbegin();
    EXPECT_TRUE(whole.contains((left + right) / 2));
    EXPECT_FALSE(parts.contains((left + right) / 2)) << "a gap from 4 to 6";
    EXPECT_TRUE(parts.contains(left + (right - left) / 5));
    EXPECT_TRUE(columns_of(*image, 2).empty());
  }
  EXPECT_TRUE(draw_plot({.places = {1}, .curves = {{"a", {7}}}}, 640, 400)) << "a point";
  const auto small = draw_plot(plot, 20, 20);
  ASSERT_FALSE(small);
  EXPECT_THAT(small.error().message, HasSubstr("less than half"));
}

}  // namespace
}  // namespace splatvol
