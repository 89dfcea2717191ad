// Vectors leave as one array.
#include "extractor/output_arrays.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

namespace splatvol {
namespace {

using ::testing::ElementsAre;

// The arrays of selected attributes of a file.
std::vector<OutputArray> arrays_of(const std::vector<std::string>& names, const std::vector<std::string>& selected) {
  format::VolumeInfo info;
  for (const std::string& name : names) {
    info.attributes.emplace_back();
    info.attributes.back().name = name;
    info.attributes.back().unit = "unit of " + name;
  }
  format::SplatSelection selection;
  for (const std::string& name : selected)
    selection.add(static_cast<std::size_t>(std::ranges::find(names, name) - names.begin()), name);
  return output_arrays(info, selection);
}

TEST(OutputArrays, AVectorIsOneArray) {
  const std::vector<std::string> names = {"T", "U", "U[0]", "U[1]", "U[2]", "p"};
  const auto arrays = arrays_of(names, names);
  EXPECT_THAT(names_of(arrays), ElementsAre("T", "U", "p"));
  EXPECT_THAT(arrays[1].members, ElementsAre(2, 3, 4));
  EXPECT_EQ(arrays[1].unit, "unit of U[0]");
  EXPECT_THAT(arrays_of(names, {"p", "U[2]", "U[0]", "U[1]"})[1].members, ElementsAre(2, 3, 1)) << "in their order";
}

TEST(OutputArrays, PartsOfVectorsAndTensorsStayAsTheyAre) {
  const std::vector<std::string> names = {"U", "U[0]", "U[1]", "U[2]"};
  EXPECT_THAT(names_of(arrays_of(names, {"U", "U[0]", "U[2]"})), ElementsAre("U", "U[0]", "U[2]"));
  EXPECT_THAT(names_of(arrays_of(names, {"U"})), ElementsAre("U"));
  const std::vector<std::string> tensor = {"S", "S[0]", "S[1]", "S[2]", "S[3]"};
  EXPECT_THAT(names_of(arrays_of(tensor, tensor)), ElementsAre("S", "S[0]", "S[1]", "S[2]", "S[3]"));
  EXPECT_THAT(names_of(arrays_of(tensor, {"S[0]", "S[1]", "S[2]"})), ElementsAre("S[0]", "S[1]", "S[2]"));
}

TEST(OutputArrays, NumbersOfAPointStandSideBySide) {
  const std::vector<std::vector<double>> values = {{1, 2}, {3, 4}, {5, 6}, {7, 8}};
  std::vector<double> joined;
  EXPECT_THAT(numbers_of({"v", "", {1, 3, 0}}, values, joined), ElementsAre(3, 7, 1, 4, 8, 2));
  EXPECT_EQ(numbers_of({"s", "", {2}}, values, joined).data(), values[2].data()) << "not copied";
}

}  // namespace
}  // namespace splatvol
