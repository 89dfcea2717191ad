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

}  // namespace
}  // namespace splatvol
