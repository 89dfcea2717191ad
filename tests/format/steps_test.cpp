// A series of files is what its index says.
#include "format/steps.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

#include "format/series_index.h"
#include "tests/support/memory_source.h"
#include "tests/support/results.h"
#include "tests/support/test_volume.h"
#include "tests/support/volume_bytes.h"

namespace splatvol::test {
namespace {

using namespace format;
using testing::AllOf;
using testing::HasSubstr;

constexpr double none = std::numeric_limits<double>::quiet_NaN();

Bytes step(double low, double high, const std::string& unit) {
  std::vector<double> values(50, low);
  values.back() = high;
  TestVolume volume = make_test_volume(random_points(50, 3), {values, std::vector<double>(50, none)});
  volume.info.attributes[0].unit = unit;
  return test_volume_bytes(volume);
}

// Files by their names, without a disk.
struct IndexedSteps : testing::Test {
  IndexedSteps() {
    files_["a.svol"] = step(1, 2, "Pa");
    files_["b.svol"] = step(-1, 1.5, "Pa");
    index_.steps = {{0, "a.svol"}, {1.5, "b.svol"}};
    index_.attributes = {{"a0", "Pa", {-1, 2}}, {"a1", "", {none, none}}};
  }

  [[nodiscard]] Result<Steps> open() const {
    index_bytes_ = bytes_of(to_json(index_));
    return Steps::open("i.svols", [this](const std::string& path) -> Result<std::unique_ptr<ByteSource>> {
      if (path == "i.svols") return memory_source(index_bytes_, path);
      const auto found = files_.find(path);
      if (found == files_.end()) return fail(ErrorCode::io, "{}: cannot open", path);
      return memory_source(found->second, path);
    });
  }

  [[nodiscard]] std::string error() const {
    const auto steps = open();
    if (!steps) return steps.error().message;
    return message_of(steps->verify([](double) {}, 2));
  }

  std::map<std::string, Bytes> files_;
  SeriesIndex index_;
  mutable Bytes index_bytes_;
};

TEST_F(IndexedSteps, AreAccepted) {
  EXPECT_EQ(error(), "");
  std::vector<double> shares;
  ASSERT_TRUE(open()->verify([&](double share) { shares.push_back(share); }));
  EXPECT_TRUE(std::ranges::is_sorted(shares));
  EXPECT_EQ(shares.back(), 1);
}

TEST_F(IndexedSteps, UnitsAreThoseOfTheFiles) {
  index_.attributes[0].unit = "kPa";
  EXPECT_THAT(error(), AllOf(HasSubstr("a.svol: the unit of 'a0' is \"Pa\""), HasSubstr("i.svols says \"kPa\"")));
  index_.attributes[0].unit = "Pa";
  files_["b.svol"] = step(-1, 1.5, "");
  EXPECT_THAT(error(), HasSubstr("b.svol: the unit of 'a0' is \"\""));
}

TEST_F(IndexedSteps, RangesAreThoseOverAllFiles) {
  for (const StepRange range : {StepRange{-1, 1.5}, {1, 2}, {-1, 3}, {-2, 2}, {none, none}}) {
    index_.attributes[0].range = range;
    EXPECT_THAT(error(), HasSubstr("i.svols: the range of 'a0' is not that of the steps, -1 to 2"));
  }
  index_.attributes[0].range = {-1, 2};
  index_.attributes[1].range = {0, 1};
  EXPECT_THAT(error(), HasSubstr("i.svols: the range of 'a1' is not that of the steps"));
}

TEST_F(IndexedSteps, AttributesAndFilesAreThere) {
  index_.attributes.push_back({"p", "", {0, 1}});
  EXPECT_THAT(error(), HasSubstr("a.svol: lacks the attribute 'p'"));
  index_.attributes.pop_back();
  index_.steps.push_back({2, "c.svol"});
  EXPECT_THAT(error(), HasSubstr("c.svol: cannot open"));
}

TEST_F(IndexedSteps, EachByteOfTheFilesIsChecked) {
  files_["b.svol"][files_["b.svol"].size() / 2] ^= std::byte{1};
  EXPECT_THAT(error(), HasSubstr("b.svol"));
}

// The system would open "a.svol".
TEST_F(IndexedSteps, ANameDoesNotEndInItsMiddle) {
  index_.steps[1].file = std::string("a.svol\0b.svol", 13);
  EXPECT_THAT(error(), AllOf(HasSubstr("steps[1].file: "), HasSubstr("not the name of a file")));
}

}  // namespace
}  // namespace splatvol::test
