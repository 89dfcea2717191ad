#include "base/hypotenuse.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace splatvol {
namespace {

constexpr double largest = std::numeric_limits<double>::max(), least = std::numeric_limits<double>::denorm_min();
constexpr double infinity = std::numeric_limits<double>::infinity();

TEST(Hypotenuse, IsWithinAUnitInTheLastPlace) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> number(0.5, 1);
  std::uniform_int_distribution<int> exponent(-500, 500), apart(-60, 60);
  for (int i = 0; i < 1'000'000; ++i) {
    const int e = exponent(random);
    const double x = std::ldexp(number(random), e), y = std::ldexp(number(random), e + apart(random));
    const long double expected = std::sqrt(static_cast<long double>(x) * x + static_cast<long double>(y) * y);
    const double unit = std::nextafter(static_cast<double>(expected), infinity) - static_cast<double>(expected);
    ASSERT_LE(std::abs(hypotenuse(x, y) - expected), unit) << x << ' ' << y;
    ASSERT_EQ(hypotenuse(-y, x), hypotenuse(x, y)) << x << ' ' << y;
  }
}

TEST(Hypotenuse, TakesNumbersOfAnySize) {
  for (const double scale : {1.0, 0x1p1020, 0x1p-600, 0x1p-1070})
    EXPECT_EQ(hypotenuse(3 * scale, 4 * scale), 5 * scale);
  EXPECT_EQ(hypotenuse(0, -0.0), 0);
  EXPECT_EQ(hypotenuse(-2, 0), 2);
  EXPECT_EQ(hypotenuse(least, 0), least);
  EXPECT_EQ(hypotenuse(largest, least), largest);
  EXPECT_EQ(hypotenuse(largest, largest), infinity);
}

TEST(Hypotenuse, OfNoNumberIsNone) {
  const double none = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(std::isnan(hypotenuse(none, 1)));
  EXPECT_TRUE(std::isnan(hypotenuse(0, none)));
  EXPECT_EQ(hypotenuse(none, -infinity), infinity);
  EXPECT_EQ(hypotenuse(infinity, 1), infinity);
}

// Files hold magnitudes of vectors: their bits may not depend on the system. Where a plain root rounds otherwise.
TEST(Hypotenuse, HasTheSameBitsEverywhere) {
  EXPECT_EQ(hypotenuse(17, 27), 0x1.fe7f6f939a554p+4);
  EXPECT_EQ(hypotenuse(28, 47), 0x1.b5aaa259099acp+5);
  EXPECT_EQ(hypotenuse(0.1, 0.4), 0x1.a634bd77fe1a5p-2);
  EXPECT_EQ(hypotenuse(0x1.e189374bc6a8p+0, 0x1.24dd2f1a9fbe7p+0), 0x1.19ccf20fdebcbp+1);
}

}  // namespace
}  // namespace splatvol
