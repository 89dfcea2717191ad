// Attributes that only some steps of a series have.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <map>

#include "base/file.h"
#include "builder/opening/open_source.h"
#include "builder/series/series_attributes.h"
#include "builder/series/series_build.h"
#include "builder/series/series_files.h"
#include "builder/series/series_inputs.h"
#include "format/series_index.h"
#include "format/volume.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

const auto silent = [](const char*, double) {};

struct SeriesAttributes : FolderTest {
  /// Writes a table of 27 points, with columns of values from `first` on.
  void write_table(const std::string& name, const std::vector<std::pair<std::string, double>>& columns) const {
    std::string text = "x,y,z";
    for (const auto& [column, first] : columns) text += "," + column;
    for (int i = 0; i < 27; ++i) {
      text += fmt::format("\n{},{},{}", i % 3, i / 3 % 3, i / 9);
      for (const auto& [column, first] : columns) text += fmt::format(",{}", first + i);
    }
    write(name, text + "\n");
  }

  [[nodiscard]] Result<std::vector<SeriesStep>> steps(const std::vector<std::string>& names,
                                                      const std::vector<std::string>& series = {},
                                                      const std::vector<std::string>& selection = {}) const {
    std::vector<std::string> paths;
    for (const std::string& name : names) paths.push_back(path(name));
    return steps_of_files(paths, {selection, {}}, {open_source, list_arrays}, series);
  }

  [[nodiscard]] Result<SeriesReport> build(const std::vector<std::string>& names) const {
    SPLATVOL_TRY_ASSIGN(listed, steps(names));
    return build_series(std::move(listed), path("s.svol"), {}, silent);
  }

  [[nodiscard]] Result<SeriesReport> append(const std::vector<std::string>& names,
                                            const std::vector<std::string>& selection = {}) const {
    SPLATVOL_TRY_ASSIGN(listed, steps(names, {"p", "q"}, selection));
    return append_to_series(std::move(listed), path("s.svol"), {}, silent);
  }

  /// The missing values of each attribute at a step of a file.
  [[nodiscard]] static std::map<std::string, std::uint64_t> missing(const format::Volume& volume) {
    std::map<std::string, std::uint64_t> counts;
    for (const format::Attribute& attribute : volume.info().attributes) counts[attribute.name] = attribute.missing;
    return counts;
  }

  [[nodiscard]] std::map<std::string, std::uint64_t> missing_at(std::size_t step) const {
    const auto volume = format::Volume::open(open_file(path("s.svol")).value()).value();
    EXPECT_TRUE(volume->verify([](double) {}));
    return missing(*volume->at_step(step).value());
  }
};

TEST_F(SeriesAttributes, AllStepsHaveThoseOfAny) {
  write_table("0.csv", {{"p", 1}});
  write_table("1.csv", {{"q", 100}, {"p", 2}});
  write_table("2.csv", {{"q", 200}});
  const auto report = value_of(build({"0.csv", "1.csv", "2.csv"}));
  EXPECT_THAT(report.build.missing, UnorderedElementsAre(Pair("q", 27), Pair("p", 27)));
  const auto volume = format::Volume::open(open_file(path("s.svol")).value()).value();
  ASSERT_EQ(volume->file_info().series->size(), 2u);
  EXPECT_EQ((*volume->file_info().series)[0].name, "p");
  EXPECT_EQ(volume->series()->ranges[0].max, 28);
  EXPECT_EQ(volume->series()->ranges[1].min, 100);
  EXPECT_THAT(missing_at(0), ElementsAre(Pair("p", 0), Pair("q", 27)));
  EXPECT_THAT(missing_at(1), ElementsAre(Pair("p", 0), Pair("q", 0)));
  EXPECT_THAT(missing_at(2), ElementsAre(Pair("p", 27), Pair("q", 0)));
}

TEST_F(SeriesAttributes, ASelectionNeedsOneStepThatHasIt) {
  write_table("0.csv", {{"p", 1}});
  write_table("1.csv", {{"p", 2}, {"q", 100}, {"r", 5}});
  const auto selected = value_of(steps({"0.csv", "1.csv"}, {}, {"q"}));
  ASSERT_TRUE(build_series(selected, path("s.svol"), {}, silent));
  EXPECT_THAT(missing_at(0), ElementsAre(Pair("q", 27)));
  EXPECT_THAT(missing_at(1), ElementsAre(Pair("q", 0)));
  EXPECT_THAT(message_of(build_series(steps({"0.csv", "1.csv"}, {}, {"u"}).value(), path("t.svol"), {}, silent)),
              HasSubstr("no attribute \"u\""));
}

TEST_F(SeriesAttributes, AppendedStepsMayLackFieldsButBringNoNewOnes) {
  write_table("0.csv", {{"p", 1}, {"q", 10}});
  write_table("1.csv", {{"p", 2}});
  write_table("2.csv", {{"p", 3}, {"q", 30}, {"r", 5}});
  ASSERT_TRUE(build({"0.csv"}));
  const std::string before = read_text_file(path("s.svol")).value();
  EXPECT_THAT(message_of(append({"2.csv"})), AllOf(HasSubstr("2.csv: the series does not have the attribute \"r\""),
                                                   HasSubstr("--attribute p --attribute q")));
  EXPECT_EQ(read_text_file(path("s.svol")).value(), before);
  ASSERT_EQ(message_of(append({"1.csv"})), "");
  ASSERT_EQ(message_of(append({"2.csv"}, {"p", "q"})), "");
  EXPECT_THAT(missing_at(1), ElementsAre(Pair("p", 0), Pair("q", 27)));
  EXPECT_THAT(missing_at(2), ElementsAre(Pair("p", 0), Pair("q", 0)));
}

TEST_F(SeriesAttributes, ASeriesOfFilesIsAlike) {
  write_table("0.csv", {{"p", 1}});
  write_table("1.csv", {{"q", 100}, {"p", 2}});
  ASSERT_TRUE(build_series_of_files(steps({"0.csv", "1.csv"}).value(), path("f.svols"), false, {}, silent));
  const auto index = format::series_index_from_json(read_text_file(path("f.svols")).value()).value();
  ASSERT_EQ(index.attributes.size(), 2u);
  EXPECT_EQ(index.attributes[1].name, "q");
  EXPECT_EQ(index.attributes[1].range.min, 100);
  EXPECT_THAT(missing(*format::Volume::open(open_file(path("f-0000.svol")).value()).value()),
              ElementsAre(Pair("p", 0), Pair("q", 27)));
  EXPECT_FALSE(steps({"1.csv"}, {"p"}));
}

// Steps whose arrays are known by functions.
StepInput step_with(const std::string& name, std::vector<ArrayShape> arrays, std::vector<SourceOptions>& opened) {
  return {name,
          std::nullopt,
          {},
          [&opened](const SourceOptions& options) -> Result<std::unique_ptr<Source>> {
            opened.push_back(options);
            return fail(ErrorCode::io, "not opened");
          },
          [arrays](const SourceOptions&) -> Result<std::optional<std::vector<ArrayShape>>> { return arrays; }};
}

TEST_F(SeriesAttributes, OtherNumbersOfComponentsAreRefused) {
  std::vector<SourceOptions> opened;
  const StepInput vector = step_with("a", {{"U", 3, false}}, opened),
                  number = step_with("b", {{"U", 1, false}}, opened);
  EXPECT_THAT(message_of(make_steps({vector, number}, {})),
              HasSubstr("b: the array \"U\" is a number, and a vector of 3 components in a"));
  EXPECT_THAT(message_of(make_steps({vector}, {"U"})),
              HasSubstr("a: \"U\" is a vector of 3 components, and a number in the series"));
  EXPECT_THAT(message_of(make_steps({number}, {"U", "U[0]", "U[1]", "U[2]"})),
              HasSubstr("b: \"U\" is a number, and the series has a vector of it, with \"U[0]\""));
  const StepInput tensor = step_with("c", {{"U", 9, false}}, opened);
  EXPECT_THAT(message_of(make_steps({tensor}, {"U", "U[0]", "U[1]", "U[2]"})),
              HasSubstr("c: \"U\" is a vector of 9 components, and a vector of 3 components in the series"));
}

TEST_F(SeriesAttributes, StepsOfTheSameArraysAreOpenedAsTheyWere) {
  std::vector<SourceOptions> opened;
  const StepInput first = step_with("a", {{"U", 3, false}, {"p", 1, true}}, opened),
                  second = step_with("b", {{"p", 1, false}, {"U", 3, false}}, opened);
  const auto steps = value_of(make_steps({first, second}, {}));
  EXPECT_TRUE(opened.empty());
  for (const SeriesStep& step : steps) EXPECT_FALSE(step.open());
  for (const SourceOptions& options : opened) EXPECT_TRUE(options.selection.empty() && !options.may_lack);
}

}  // namespace
}  // namespace splatvol::test
