#include "base/nesting.h"

#include <gtest/gtest.h>

#include <string>

namespace splatvol {
namespace {

TEST(Nesting, CountsListsAndObjectsOutsideOfTexts) {
  EXPECT_FALSE(is_nested_deeper("", 0));
  EXPECT_FALSE(is_nested_deeper("1", 0));
  EXPECT_TRUE(is_nested_deeper("[]", 0));
  EXPECT_FALSE(is_nested_deeper(R"([{"a": [1]}, [[2]]])", 3));
  EXPECT_TRUE(is_nested_deeper(R"([{"a": [1]}, [[2]]])", 2));
  EXPECT_FALSE(is_nested_deeper(R"({"[[[": "\"[[[", "a\\": "[[["})", 1));
  EXPECT_TRUE(is_nested_deeper(R"({"a\\": [[[1]]]})", 3));
}

TEST(Nesting, TakesTextsOfAnyLength) {
  std::string text;
  for (int i = 0; i < 100'000; ++i) text += "[],";
  EXPECT_FALSE(is_nested_deeper(text, 1));
  EXPECT_TRUE(is_nested_deeper(text + std::string(100'000, '{'), 99'999));
}

}  // namespace
}  // namespace splatvol
