#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "base/file.h"
#include "builder/pipeline/census_lines.h"
#include "builder/series/series_build.h"
#include "builder/series/series_files.h"
#include "builder/series/series_inputs.h"
#include "builder/sources/arrays_source.h"
#include "format/steps.h"
#include "format/volume.h"
#include "tests/builder/support/meshes.h"
#include "tests/builder/support/series_check.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using testing::AllOf;
using testing::HasSubstr;

using Series = FolderTest;

// The field of a step: it moves and grows.
double field(std::size_t step, dvec3 p) {
  const auto t = static_cast<double>(step);
  return (1 + t) * std::sin(6 * p.x + t) + p.y * p.z + 10 * t;
}

std::vector<Piece> pieces_of(std::size_t step, std::uint32_t cells, std::size_t count) {
  const Mesh mesh = lattice(cells, [](dvec3 p) { return dvec3(p.x * p.x, p.y, 0.3 * p.z); });
  return test::cut(mesh_piece(mesh, [&](dvec3 p) { return field(step, p); }), count);
}

SeriesStep step_of(std::size_t step, std::vector<Piece> pieces, const PieceSourceTraits& traits = {}) {
  return test::step_of(fmt::format("step {}", step), 0.5 * static_cast<double>(step), std::move(pieces), traits);
}

std::vector<SeriesStep> steps(std::size_t begin, std::size_t end, std::uint32_t cells = 12) {
  std::vector<SeriesStep> list;
  for (std::size_t step = begin; step < end; ++step) list.push_back(step_of(step, pieces_of(step, cells, 3)));
  return list;
}

const auto silent = [](const char*, double) {};

const BuildOptions little{.memory = 1 << 20};  // fewer steps at a time

void build_or_fail(std::vector<SeriesStep> list, const std::string& path, const BuildOptions& options = {}) {
  ASSERT_EQ(message_of(build_series(std::move(list), path, options, silent)), "");
}

std::shared_ptr<const format::Volume> open(const std::string& path) {
  auto volume = value_of(format::Volume::open(open_file(path).value()));
  return volume;
}

Status verify(const std::string& path) {
  return open(path)->verify([](double) {});
}

// The bytes of a step, as they are in the file.
std::string bytes_of_step(const std::string& path, std::size_t step) {
  const format::StepEntry entry = open(path)->series()->steps[step];
  return read_text_file(path).value().substr(entry.offset, entry.bytes);
}

TEST_F(Series, AStepIsTheFileThatIsBuiltFromIt) {
  build_or_fail(steps(0, 4), path("series.svol"));
  ASSERT_TRUE(verify(path("series.svol")));
  const auto series = open(path("series.svol"));
  ASSERT_NE(series->series(), nullptr);
  ASSERT_EQ(series->series()->steps.size(), 4U);
  EXPECT_EQ(series->step(), 3U);
  for (std::size_t step = 0; step < 4; ++step) {
    PieceSource source(pieces_of(step, 12, 3));
    ASSERT_TRUE(build_volume(source, path("single.svol"), {}, silent));
    const auto single = open(path("single.svol"));
    const auto at_step = series->at_step(step).value();
    EXPECT_EQ(at_step->time(), 0.5 * static_cast<double>(step));
    EXPECT_EQ(at_step->info().resolution_counts, single->info().resolution_counts);
    EXPECT_EQ(at_step->info().attributes[0].min, single->info().attributes[0].min);
    EXPECT_EQ(at_step->info().attributes[0].offset, single->info().attributes[0].offset);
    EXPECT_EQ(at_step->read_histograms().value(), single->read_histograms().value());
    EXPECT_EQ(chunks_of(*at_step), chunks_of(*single));

    const auto root = at_step->read_index_root({0}).value(), expected = single->read_index_root({0}).value();
    EXPECT_EQ(root.nodes.summaries[0].min, expected.nodes.summaries[0].min);
    EXPECT_EQ(root.nodes.summaries[0].occupancy, expected.nodes.summaries[0].occupancy);
  }
}

TEST_F(Series, MemoryDoesNotChangeTheFile) {
  build_or_fail(steps(0, 5), path("together.svol"));
  build_or_fail(steps(0, 5), path("apart.svol"), little);
  EXPECT_EQ(read_text_file(path("together.svol")).value(), read_text_file(path("apart.svol")).value());
}

TEST_F(Series, AppendingGivesTheSameSteps) {
  build_or_fail(steps(0, 5), path("at_once.svol"));
  build_or_fail(steps(0, 2), path("grown.svol"));
  ASSERT_TRUE(append_to_series(steps(2, 3), path("grown.svol"), {}, silent));
  ASSERT_TRUE(verify(path("grown.svol")));
  ASSERT_TRUE(append_to_series(steps(3, 5), path("grown.svol"), {}, silent));
  ASSERT_EQ(message_of(verify(path("grown.svol"))), "");
  const auto grown = open(path("grown.svol")), at_once = open(path("at_once.svol"));
  ASSERT_EQ(grown->series()->steps.size(), 5U);
  EXPECT_EQ(grown->series()->entries.size(), 7U);  // two dead parts
  EXPECT_EQ(grown->series()->ranges[0].min, at_once->series()->ranges[0].min);
  EXPECT_EQ(grown->series()->ranges[0].max, at_once->series()->ranges[0].max);
  for (std::size_t step = 0; step < 5; ++step)
    EXPECT_EQ(bytes_of_step(path("grown.svol"), step), bytes_of_step(path("at_once.svol"), step)) << step;
}

TEST_F(Series, AnInterruptedAppendLeavesTheFileReadable) {
  build_or_fail(steps(0, 2), path("series.svol"));
  const std::string before = read_text_file(path("series.svol")).value();
  ASSERT_TRUE(append_to_series(steps(2, 4), path("series.svol"), {}, silent));
  const std::string after = read_text_file(path("series.svol")).value();

  // The superblock changes last.
  for (const double share : {0.0, 0.3, 0.9, 1.0}) {
    const std::size_t written =
        before.size() + static_cast<std::size_t>(share * static_cast<double>(after.size() - before.size()));
    std::string cut = before + after.substr(before.size(), written - before.size());
    ASSERT_TRUE(write_text_file(path("cut.svol"), cut));
    const auto volume = open(path("cut.svol"));
    EXPECT_EQ(volume->series()->steps.size(), 2U);
    EXPECT_EQ(volume->series()->bytes_behind, cut.size() - before.size());
    const Status verified = volume->verify([](double) {});
    EXPECT_EQ(verified.has_value(), share == 0);
    if (!verified) {
      EXPECT_THAT(verified.error().message, HasSubstr("append was interrupted"));
    }

    ASSERT_TRUE(append_to_series(steps(2, 4), path("cut.svol"), {}, silent));
    EXPECT_EQ(read_text_file(path("cut.svol")).value(), after);
  }
}

TEST_F(Series, AFailedAppendLeavesTheFileAsItWas) {
  build_or_fail(steps(0, 3), path("series.svol"));
  const std::string before = read_text_file(path("series.svol")).value();
  const auto expect_refused = [&](std::vector<SeriesStep> list, const std::string& why) {
    EXPECT_THAT(message_of(append_to_series(std::move(list), path("series.svol"), {}, silent)), HasSubstr(why));
    EXPECT_EQ(read_text_file(path("series.svol")).value(), before);
  };
  expect_refused(steps(3, 5, 10), "--series-of-files");
  expect_refused(steps(1, 2), "not behind");
}

// Two blocks side by side. At step 0 their values agree at their common points, and later they jump there.
std::vector<Piece> blocks_at(std::size_t step) {
  std::vector<Piece> blocks;
  for (const double block : {0.0, 1.0}) {
    const Mesh mesh = lattice(8, [&](dvec3 p) { return p + dvec3(block, 0, 0); });
    blocks.push_back(mesh_piece(mesh, [&](dvec3 p) { return step == 0 ? 3 : p.y + 5 * block + field(step, p); }));
  }
  return blocks;
}

std::vector<SeriesStep> block_steps(std::size_t begin, std::size_t end, bool averages) {
  std::vector<SeriesStep> list;
  for (std::size_t step = begin; step < end; ++step)
    list.push_back(step_of(step, blocks_at(step), {.averages_by_piece = averages}));
  return list;
}

// Whether points are copies of a vertex depends on no step.
TEST_F(Series, PointsMergeAtAllStepsOrAtNone) {
  for (const bool averages : {false, true}) {
    build_or_fail(block_steps(0, 4, averages), path("together.svol"));
    build_or_fail(block_steps(0, 4, averages), path("apart.svol"), little);
    EXPECT_EQ(read_text_file(path("together.svol")).value(), read_text_file(path("apart.svol")).value());

    build_or_fail(block_steps(0, 1, averages), path("grown.svol"));
    const auto appended = value_of(append_to_series(block_steps(1, 4, averages), path("grown.svol"), {}, silent));
    EXPECT_EQ(appended.build.points.unlike, averages ? 0U : 9U * 9);
    ASSERT_EQ(message_of(verify(path("grown.svol"))), "");
    for (std::size_t step = 0; step < 4; ++step)
      EXPECT_EQ(bytes_of_step(path("grown.svol"), step), bytes_of_step(path("together.svol"), step)) << step;
    EXPECT_EQ(open(path("grown.svol"))->info().point_count(), 2U * 9 * 9 * 9 - (averages ? 0U : 9U * 9));
  }
}

// The points of one piece stay apart: there, the field may jump.
TEST_F(Series, ACrackStaysOpen) {
  const auto cracked = [](std::size_t step) {
    std::vector<Piece> blocks = blocks_at(step);
    Piece& whole = blocks[0];
    const auto shift = static_cast<std::uint32_t>(whole.points.size());
    whole.points.insert(whole.points.end(), blocks[1].points.begin(), blocks[1].points.end());
    whole.values[0].insert(whole.values[0].end(), blocks[1].values[0].begin(), blocks[1].values[0].end());
    for (auto corners : blocks[1].tetrahedra) {
      for (std::uint32_t& corner : corners) corner += shift;
      whole.tetrahedra.push_back(corners);
    }
    return step_of(step, {whole});
  };
  build_or_fail({cracked(0)}, path("series.svol"));
  ASSERT_TRUE(append_to_series({cracked(1), cracked(2)}, path("series.svol"), {}, silent));
  EXPECT_EQ(open(path("series.svol"))->info().point_count(), 2U * 9 * 9 * 9);
}

TEST_F(Series, AMeshThatChangesIsRefused) {
  for (const bool same_count : {false, true}) {
    std::vector<SeriesStep> list = steps(0, 2);
    std::vector<Piece> moved = pieces_of(2, same_count ? 12 : 11, 3);
    moved[1].points[5].x += 1e-9;
    list.push_back(step_of(2, std::move(moved)));
    const std::string report = message_of(build_series(std::move(list), path("series.svol"), {}, silent));
    EXPECT_THAT(report, HasSubstr("step 2: its mesh is not that of step 0"));
    EXPECT_THAT(report, HasSubstr("--series-of-files"));
    EXPECT_FALSE(std::filesystem::exists(path("series.svol")));
  }
}

TEST_F(Series, TimesMustRise) {
  std::vector<SeriesStep> list = steps(0, 2);
  list[1].time = 0.0;
  EXPECT_THAT(message_of(build_series(std::move(list), path("series.svol"), {}, silent)),
              HasSubstr("step 1: the time 0 is not behind 0"));
  build_or_fail(steps(0, 2), path("series.svol"));
  list = steps(2, 3);
  list[0].time = 0.25;
  EXPECT_THAT(message_of(append_to_series(std::move(list), path("series.svol"), {}, silent)),
              HasSubstr("step 2: the time 0.25 is not behind 0.5"));
}

// Writers put arrays into any order. The first step tells that of the series, also where memory takes a step at a time.
TEST_F(Series, StepsMayHaveTheirAttributesInAnyOrder) {
  const auto of_two = [&](std::size_t step, bool swapped) {
    std::vector<Piece> pieces = pieces_of(step, 8, 2);
    for (Piece& piece : pieces) {
      piece.values.emplace_back(piece.points.size(), static_cast<double>(step));
      if (swapped) std::swap(piece.values[0], piece.values[1]);
    }
    const std::vector<std::string> names = {"f", "n"}, other = {"n", "f"};
    return step_of(step, std::move(pieces), {.attributes = swapped ? other : names});
  };
  for (const BuildOptions& options : {BuildOptions{}, little}) {
    build_or_fail({of_two(0, false), of_two(1, false), of_two(2, false)}, path("same.svol"), options);
    build_or_fail({of_two(0, false), of_two(1, true)}, path("other.svol"), options);
    ASSERT_EQ(message_of(append_to_series({of_two(2, true)}, path("other.svol"), options, silent)), "");
    for (std::size_t step = 0; step < 3; ++step)
      EXPECT_EQ(bytes_of_step(path("other.svol"), step), bytes_of_step(path("same.svol"), step)) << step;
  }
  build_or_fail({of_two(0, true), of_two(1, false)}, path("other.svol"));
  EXPECT_EQ(open(path("other.svol"))->info().attributes[0].name, "n");
}

TEST_F(Series, AttributesThatDifferAreNamed) {
  const auto with = [&](std::size_t step, const std::string& name) {
    return step_of(step, pieces_of(step, 4, 1), {.attributes = {name}});
  };
  EXPECT_THAT(message_of(build_series({with(0, "p"), with(1, "q")}, path("series.svol"), {}, silent)),
              HasSubstr("step 1: its attributes are not those of step 0: it lacks p, and has q besides"));
  build_or_fail({with(0, "p")}, path("series.svol"));
  EXPECT_THAT(message_of(append_to_series({with(1, "q")}, path("series.svol"), {}, silent)),
              AllOf(HasSubstr("step 1"), HasSubstr("it lacks p, and has q besides")));
}

TEST_F(Series, StepsWithoutTimesAreNumbered) {
  std::vector<SeriesStep> list = steps(0, 3);
  for (SeriesStep& step : list) step.time.reset();
  build_or_fail(std::move(list), path("series.svol"));
  list = steps(3, 4);
  list[0].time.reset();
  ASSERT_TRUE(append_to_series(std::move(list), path("series.svol"), {}, silent));
  const auto volume = open(path("series.svol"));
  for (std::size_t step = 0; step < 4; ++step) EXPECT_EQ(volume->series()->steps[step].time, static_cast<double>(step));

  list = steps(4, 6);
  list[1].time.reset();
  EXPECT_FALSE(append_to_series(std::move(list), path("series.svol"), {}, silent));
}

TEST_F(Series, ScatteredPointsHaveStepsToo) {
  std::vector<SeriesStep> list;
  for (std::size_t step = 0; step < 3; ++step) {
    Piece piece = scattered(random_points(3000));
    for (double& value : piece.values[0]) value += static_cast<double>(step);
    list.push_back(step_of(step, {piece}));
  }
  build_or_fail(std::move(list), path("series.svol"));
  EXPECT_EQ(message_of(verify(path("series.svol"))), "");
}

TEST_F(Series, ReportsAttributesOnceWhateverTheMemory) {
  for (const std::uint64_t memory : {1 << 20, 1 << 30}) {
    std::vector<SeriesStep> list;
    for (std::size_t step = 0; step < 5; ++step) {
      Piece piece = scattered(random_points(3000));
      for (double& value : piece.values[0]) value += static_cast<double>(step);
      piece.values[0][7] = 1e-300;
      piece.values[0][8] = std::nan("");
      list.push_back(step_of(step, {piece}));
    }
    const auto report = value_of(build_series(std::move(list), path("series.svol"), {.memory = memory}, silent));
    ASSERT_EQ(report.build.missing.size(), 1U);
    EXPECT_EQ(report.build.missing[0].second, 5U) << "one in each step";
    EXPECT_THAT(report.build.lost.attributes, testing::SizeIs(1));
    const std::vector<std::string> lines = warning_lines(report.build);
    ASSERT_EQ(lines.size(), 1U);
    EXPECT_THAT(lines[0], testing::StartsWith(report.build.missing[0].first + ": values nearer to 0"));
  }
}

// Points with the array U.
class PointsWithU {
 public:
  explicit PointsWithU(int components, std::string unit = "") {
    for (const dvec3& p : random_points(60)) points_.insert(points_.end(), {p.x, p.y, p.z});
    for (std::size_t i = 0; i < 60 * static_cast<std::size_t>(components); ++i)
      values_.push_back(std::sin(static_cast<double>(i)));
    mesh_.points = points_;
    mesh_.point_values = {{"U", std::span<const double>(values_), components, std::move(unit)}};
  }
  PointsWithU(const PointsWithU&) = delete;
  PointsWithU& operator=(const PointsWithU&) = delete;

  [[nodiscard]] SeriesStep step(double time, const std::vector<std::string>& selection = {}) const {
    const std::string name = fmt::format("step at {}", time);
    return {name, time, [this, name, selection] { return open_arrays(name, mesh_, {.selection = selection}); }};
  }

  [[nodiscard]] const MeshArrays& mesh() const { return mesh_; }

 private:
  std::vector<double> points_, values_;
  MeshArrays mesh_;
};

std::string error_of(const Result<SeriesReport>& report) { return report ? "" : report.error().message; }

// The magnitude of a vector has the name of the vector, and of a number.
TEST_F(Series, AVectorIsNoNumber) {
  const PointsWithU number(1), vector(3), plane(2);
  const std::vector<std::string> u = {"U"};
  const auto both = [&](const PointsWithU& first, const PointsWithU& second) {
    const std::vector<SeriesStep> list = {first.step(0, u), second.step(1, u)};
    const std::string in_one = error_of(build_series(list, path("s.svol"), {}, silent));
    const std::string in_files = error_of(build_series_of_files(list, path("s.svols"), false, {}, silent));
    EXPECT_EQ(in_one.empty(), in_files.empty());
    EXPECT_EQ(std::filesystem::exists(path("s.svols")), in_files.empty());
    for (const char* file : {"s.svol", "s.svols", "s-0000.svol", "s-0001.svol"}) std::filesystem::remove(path(file));
    return in_one + in_files;
  };
  EXPECT_EQ(both(number, number), "");
  EXPECT_EQ(both(vector, vector), "");
  EXPECT_THAT(both(number, vector), HasSubstr("step at 1: \"U\" is a vector of 3 components, and a number in"));
  EXPECT_THAT(both(vector, number), HasSubstr("step at 1: \"U\" is a number, and a vector of 3 components in"));
  EXPECT_THAT(both(vector, plane), HasSubstr("step at 1: \"U\" is a vector of 2 components, and a vector of 3"));
}

// The first step may lack the attribute.
TEST_F(Series, AUnitIsThatOfTheFirstStepThatTellsOne) {
  const PointsWithU unknown(1), pascals(1, "Pa"), kilopascals(1, "kPa");
  ASSERT_EQ(error_of(build_series({unknown.step(0), pascals.step(1), kilopascals.step(2)}, path("s.svol"), {}, silent)),
            "");
  EXPECT_EQ(open(path("s.svol"))->info().series->at(0).unit, "Pa");
}

// The index has one unit of each attribute.
TEST_F(Series, AStepOfFilesHasTheUnitsOfTheStepsBefore) {
  const PointsWithU pascals(1, "Pa"), unknown(1), kilopascals(1, "kPa");
  ASSERT_EQ(error_of(build_series_of_files({pascals.step(0), unknown.step(1)}, path("s.svols"), false, {}, silent)),
            "");
  EXPECT_EQ(open(path("s-0001.svol"))->info().attributes[0].unit, "Pa");
  const auto append = [&](const PointsWithU& points, const BuildOptions& options) {
    return error_of(build_series_of_files({points.step(2)}, path("s.svols"), true, options, silent));
  };
  EXPECT_THAT(append(kilopascals, {}), HasSubstr("the unit of \"U\" is \"kPa\", and \"Pa\" in the steps before"));
  EXPECT_EQ(append(kilopascals, {.units = {{"U", "Pa"}}}), "");
  const auto steps = format::Steps::open(path("s.svols"), open_file).value();
  EXPECT_EQ(steps.times().size(), 3U);
  EXPECT_EQ(message_of(steps.verify([](double) {})), "");
}

TEST(SeriesInputs, TimesAreAllOrARange) {
  EXPECT_TRUE(parse_times("all"));
  EXPECT_EQ(parse_times("0.5:2").value().first, 0.5);
  EXPECT_EQ(parse_times("0.5:").value().first, 0.5);
  EXPECT_EQ(parse_times(":2").value().last, 2);
  for (const char* text : {"", "1", "2:1", "a:b", "nan:1", "1:2:3", "1: 2"}) EXPECT_FALSE(parse_times(text)) << text;
}

}  // namespace
}  // namespace splatvol::test
