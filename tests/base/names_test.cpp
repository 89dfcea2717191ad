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

// Files called all faces without a patch "outer" before these were split.
TEST(Names, OuterIsAllOfTheRest) {
  const std::vector<std::string> names = {"outer wall", "outer 2", "side x-", "side z+", "outer rest", "side a+"};
  using Found = std::vector<std::size_t>;
  EXPECT_EQ(find_patches("f", "outer", names).value(), (Found{1, 2, 3, 4}));
  EXPECT_EQ(find_patches("f", "out*r", names).value(), (Found{1, 2, 3, 4}));
  EXPECT_EQ(find_patches("f", "outer*", names).value(), (Found{0, 1, 2, 3, 4}));
  EXPECT_EQ(find_patches("f", "outer 2", names).value(), (Found{1}));
  EXPECT_EQ(find_patches("f", "side x*", names).value(), (Found{2}));
  const std::vector<std::string> with_one = {"outer", "outer 2", "side x-"};
  EXPECT_EQ(find_patches("f", "outer", with_one).value(), (Found{0}));
  for (const char* other : {"outer ", "outer 1b", "outer_1", "side", "side x", "side x*", "Side x-"})
    EXPECT_FALSE(is_patch_of_rest(other)) << other;
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
