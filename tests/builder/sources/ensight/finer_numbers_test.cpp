#include "builder/sources/ensight/finer_numbers.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

namespace splatvol {
namespace {

TEST(FinerNumbers, HaveMoreDigitsThanSinglePrecisionKeeps) {
  for (const char* text : {"4500000.2", "(500000 4500000.25 0)", "0.333333333333", "x 1.23456789e+06", "-4.50000025e+6",
                           " 1.00000e+00-4.50000025e+06"})
    EXPECT_TRUE(has_finer_number(text)) << text;
}

TEST(FinerNumbers, AreNeitherThoseOfSinglePrecisionNorIndices) {
  for (const char* text : {"", "-", ".", "e", "4500000.5", "4.56789e+06", "9.99999e+08", "0.1", "123456789",
                           "1234567890123", "version 2.0;", "-1.00000e+00-2.00000e+00", "1e-400", "1e400", "nan inf"})
    EXPECT_FALSE(has_finer_number(text)) << text;
  // Each number of single precision, as programs write it.
  for (float number = 1e-3F; number < 1e9F; number *= 1.37F)
    for (const int digits : {6, 9})
      EXPECT_FALSE(has_finer_number(fmt::format("{:.{}e}", number, digits - 1))) << number;
}

}  // namespace
}  // namespace splatvol
