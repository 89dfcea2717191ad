#include "base/names.h"

#include <gtest/gtest.h>

#include <array>

namespace splatvol {
namespace {

TEST(Names, AMissingAttributeIsNamedWithThoseThatAreThere) {
  const Status failed = fail_no_attribute("a.vtu", "x", std::array<std::string, 2>{"p", "q"});
  ASSERT_FALSE(failed);
  EXPECT_EQ(failed.error().code, ErrorCode::invalid_argument);
  EXPECT_EQ(failed.error().message, "a.vtu: no attribute \"x\"; there are: p, q");
}

TEST(Names, FindsTheLowestNameThatAppearsTwice) {
  EXPECT_EQ(find_duplicate({"b", "c", "a", "c", "b", "d"}), "b");
  EXPECT_EQ(find_duplicate({"b", "B", ""}), std::nullopt);
  EXPECT_EQ(find_duplicate({}), std::nullopt);
}

TEST(Names, MatchPatterns) {
  EXPECT_TRUE(matches("wing", "wing"));
  EXPECT_FALSE(matches("wing", "win"));
  EXPECT_FALSE(matches("win", "wing"));
  EXPECT_TRUE(matches("motorBike_seat", "motorBike*"));
  EXPECT_TRUE(matches("motorBike", "motorBike*"));
  EXPECT_FALSE(matches("a motorBike", "motorBike*"));
  EXPECT_TRUE(matches("region/seat_left", "*seat*"));
  EXPECT_TRUE(matches("abcabd", "*ab*d"));
  EXPECT_FALSE(matches("abcabd", "*ab*e"));
  EXPECT_TRUE(matches("", "*"));
  EXPECT_TRUE(matches("", ""));
  EXPECT_FALSE(matches("", "?"));
  EXPECT_FALSE(matches("x", ""));
}

TEST(Names, PatchesAreFoundByPatterns) {
  const std::vector<std::string> names = {"inlet", "wing_left", "wing_right", "a*b"};
  EXPECT_EQ(find_patches("f", "wing*", names).value(), (std::vector<std::size_t>{1, 2}));
  EXPECT_EQ(find_patches("f", "a*b", names).value(), (std::vector<std::size_t>{3}));
  EXPECT_EQ(find_patches("f", "Wing*", names).error().message,
            "f: no patch \"Wing*\" in its boundary; there are: inlet, wing_left, wing_right, a*b");
}

}  // namespace
}  // namespace splatvol
