#include "streamer/streamer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "tests/streamer/fixture.h"

namespace splatvol {
namespace {

using test::TestSource;
using test::TestVolume;
using testing::HasSubstr;

constexpr double infinity = std::numeric_limits<double>::infinity();

Result<std::unique_ptr<Streamer>> open(
    const TestVolume& volume, const std::string& attribute = "a1", std::uint64_t memory = 64u << 20,
    std::shared_ptr<TestSource::Control> control = std::make_shared<TestSource::Control>()) {
  return Streamer::open(test::source_of(volume, std::move(control)), {memory, attribute});
}

View front_view() {
  Camera camera;
  camera.position = {0.5, 0.5, 6};
  camera.focal_point = dvec3(0.5);
  return make_view(camera, 256, 256).value();
}

View view_from(const dvec3& eye) {
  Camera camera;
  camera.position = eye;
  camera.focal_point = dvec3(0.5);
  return make_view(camera, 256, 256).value();
}

DetailOptions percent(double tolerance) { return {.tolerance_percent = tolerance, .resolution = std::nullopt}; }

// Splats in world coordinates, in an order that does not depend on the streamer's.
using Row = std::array<double, 5>;
std::vector<Row> rows_of(const FrameSplats& frame) {
  std::vector<Row> rows;
  for (const SplatBatch& batch : frame.batches)
    for (const OctantSplat& splat : batch.splats) {
      const dvec3 p = batch.origin + dvec3(splat.position);
      rows.push_back({p.x, p.y, p.z, static_cast<double>(splat.value), static_cast<double>(splat.size)});
    }
  std::ranges::sort(rows, {}, [](const Row& row) { return std::tuple(row[0], row[1], row[2]); });
  return rows;
}

// Position, stored value, size.
std::vector<Row> expected_rows(const TestVolume& volume, std::size_t resolution, std::size_t attribute) {
  std::vector<Row> rows;
  for (std::size_t i = 0; i < volume.info.resolution_counts[resolution]; ++i) {
    const dvec3& p = volume.positions[i];
    const auto value = static_cast<double>(volume.stored[attribute][i]);
    rows.push_back({p.x, p.y, p.z, value, volume.splat_size(resolution, i)});
  }
  std::ranges::sort(rows, {}, [](const Row& row) { return std::tuple(row[0], row[1], row[2]); });
  return rows;
}

void expect_same_rows(const std::vector<Row>& actual, const std::vector<Row>& expected, double edge) {
  ASSERT_EQ(actual.size(), expected.size());
  for (std::size_t i = 0; i < actual.size(); ++i) {
    for (std::size_t axis = 0; axis < 3; ++axis)
      ASSERT_NEAR(actual[i][axis], expected[i][axis], 1e-7 * edge) << "splat " << i;
    ASSERT_EQ(std::isnan(actual[i][3]), std::isnan(expected[i][3]));
    if (!std::isnan(expected[i][3])) {
      ASSERT_NEAR(actual[i][3], expected[i][3], 1e-6 * std::abs(expected[i][3]));
    }
    ASSERT_NEAR(actual[i][4], expected[i][4], 1e-6 * expected[i][4]);
  }
}

TEST(Streamer, HandsOnWhatTheFileHoldsAtEachResolution) {
  const TestVolume volume = test::sample_volume(3000, 1);
  const auto streamer = open(volume, "a0").value();
  for (std::size_t r = 0; r < volume.info.resolutions(); ++r) {
    const auto frame = streamer->request(front_view(), test::opaque(), {1, r});
    ASSERT_TRUE(frame) << frame.error().message;
    expect_same_rows(rows_of(**frame), expected_rows(volume, r, 0), 1);
    EXPECT_EQ((*frame)->splats_by_resolution[r], volume.info.resolution_counts[r]);
  }
}

TEST(Streamer, KeepsDetailFarFromTheOrigin) {
  test::TestVolumeOptions options;
  options.cube = {{1e9, -2e9, 3e9}, 1};
  options.value_offset = 50;
  const TestVolume volume = test::sample_volume(1000, 2, options);
  const auto streamer = open(volume).value();
  View view = front_view();
  view.eye += options.cube.origin;
  const auto frame = streamer->request(view, test::opaque(), percent(0));
  ASSERT_TRUE(frame) << frame.error().message;
  // Doubles of 3e9 are 5e-7 apart.
  const auto actual = rows_of(**frame), expected = expected_rows(volume, volume.info.resolutions() - 1, 1);
  ASSERT_EQ(actual.size(), expected.size());
  std::map<double, int> places;
  for (const SplatBatch& batch : (*frame)->batches)
    for (const OctantSplat& splat : batch.splats) ++places[batch.origin.x + static_cast<double>(splat.position.x)];
  EXPECT_GT(places.size(), 950u);
  for (std::size_t i = 0; i < actual.size(); ++i) ASSERT_NEAR(actual[i][0], expected[i][0], 1e-6);
}

TEST(Streamer, BatchesAreTheFrame) {
  const TestVolume volume = test::sample_volume(3000, 3);
  const auto streamer = open(volume).value();
  const FrameSplats& frame = *streamer->request(view_from({2, 1, 0.3}), test::opaque(), percent(3)).value();
  std::uint64_t splats = 0, nodes = 0, by_resolution = 0;
  for (const SplatBatch& batch : frame.batches) {
    EXPECT_FALSE(batch.splats.empty());
    splats += batch.splats.size();
  }
  for (const std::uint64_t n : frame.nodes_by_resolution) nodes += n;
  for (const std::uint64_t n : frame.splats_by_resolution) by_resolution += n;
  EXPECT_EQ(frame.splats, splats);
  EXPECT_EQ(by_resolution, splats);
  EXPECT_EQ(frame.nodes, frame.batches.size());
  EXPECT_EQ(frame.nodes, nodes);
  EXPECT_EQ(frame.detail.tolerance_percent, 3);
}

TEST(Streamer, ASteadyViewCostsNothing) {
  const TestVolume volume = test::sample_volume(3000, 4);
  const auto control = std::make_shared<TestSource::Control>();
  const auto streamer = open(volume, "a1", 64u << 20, control).value();
  const FrameSplats* first = streamer->request(front_view(), test::opaque(), percent(1)).value();
  const std::uint64_t serial = first->serial, reads = control->reads;

  const FrameSplats* second = streamer->request(front_view(), test::opaque(), percent(1)).value();
  EXPECT_EQ(second, first);
  EXPECT_EQ(second->serial, serial);
  EXPECT_EQ(streamer->statistics().fetch_seconds, 0);
  TransferFunction recoloured = test::opaque();
  recoloured.colors = {{0, dvec3(0.2)}};
  EXPECT_EQ(streamer->request(front_view(), recoloured, percent(1)).value()->serial, serial);

  EXPECT_NE(streamer->request(front_view(), test::opaque(), percent(20)).value()->serial, serial);
  EXPECT_NE(streamer->request(front_view(), test::opaque(), percent(1)).value()->serial, serial);
  const std::uint64_t reads_for_other_sizes = control->reads;
  streamer->request(front_view(), test::opaque(), percent(20)).value();
  EXPECT_EQ(control->reads, reads_for_other_sizes) << "what was decoded is still there";
  EXPECT_GE(reads_for_other_sizes, reads);
}

TEST(Streamer, OpensWithOneRead) {
  const TestVolume volume = test::sample_volume(3000, 5);
  const auto control = std::make_shared<TestSource::Control>();
  const auto streamer = open(volume, "a1", 64u << 20, control).value();
  EXPECT_EQ(control->reads, 1u);
  const std::uint64_t opened = streamer->statistics().bytes_read;
  streamer->request(front_view(), test::opaque(), percent(infinity)).value();
  EXPECT_EQ(control->reads, 1u) << "the coarsest picture is in the preamble";
  EXPECT_EQ(streamer->statistics().bytes_read, opened);
}

TEST(Streamer, ReadsOnlyWhatTheCutTouches) {
  const TestVolume volume = test::sample_volume(20000, 6);
  std::uint64_t last = std::numeric_limits<std::uint64_t>::max();
  std::map<double, double> share;
  for (const double tolerance : {0.5, 2.0, 5.0, 20.0}) {
    const auto streamer = open(volume).value();
    streamer->request(front_view(), test::opaque(), percent(tolerance)).value();
    const std::uint64_t read = streamer->statistics().bytes_read;
    share[tolerance] = static_cast<double>(read) / static_cast<double>(streamer->volume().file_bytes());
    EXPECT_LE(read, last);
    last = read;
  }
  EXPECT_LT(share[20.0], 0.15);
  EXPECT_GT(share[0.5], 0.4);
}

TEST(Streamer, ReadsNoChunkThatTheTransferFunctionHides) {
  const TestVolume volume = test::sample_volume(20000, 7);
  const auto bytes_read = [&](const TransferFunction& function) {
    const auto streamer = open(volume).value();
    const FrameSplats& frame = *streamer->request(front_view(), function, percent(0)).value();
    std::uint64_t visible = 0;
    for (const Row& row : rows_of(frame)) visible += function.extinction(row[3]) > 0;
    std::uint64_t expected = 0;
    for (const float value : volume.stored[1]) expected += function.extinction(static_cast<double>(value)) > 0;
    EXPECT_EQ(visible, expected);
    return streamer->statistics().bytes_read;
  };
  const std::uint64_t all = bytes_read(test::opaque());
  EXPECT_LT(bytes_read(test::window(90, 95)), all / 3);
  EXPECT_LT(bytes_read(test::window(1000, 2000)), all / 10);
}

TEST(Streamer, MissingValuesStayMissing) {
  const TestVolume volume = test::sample_volume(1000, 8);
  const auto streamer = open(volume, "a0").value();
  const auto rows = rows_of(*streamer->request(front_view(), test::opaque(), percent(0)).value());
  const auto present = std::ranges::count_if(rows, [](const Row& row) { return !std::isnan(row[3]); });
  EXPECT_EQ(static_cast<std::uint64_t>(present) + volume.info.attributes[0].missing, 1000u);
  EXPECT_GT(volume.info.attributes[0].missing, 0u);
}

TEST(Streamer, AnAttributeWithoutValuesDrawsNothing) {
  const std::vector<double> missing(500, std::numeric_limits<double>::quiet_NaN());
  const TestVolume volume = test::make_test_volume(test::random_points(500, 9), {missing});
  const auto streamer = open(volume, "a0").value();
  const auto frame = streamer->request(front_view(), test::opaque(), percent(1));
  ASSERT_TRUE(frame) << frame.error().message;
  EXPECT_EQ((*frame)->splats, 0u);
}

TEST(Streamer, AnUnknownAttributeListsTheOthers) {
  const auto streamer = open(test::sample_volume(100, 10), "pressure");
  ASSERT_FALSE(streamer);
  EXPECT_THAT(streamer.error().message,
              testing::AllOf(HasSubstr("test.svol"), HasSubstr("'pressure'"), HasSubstr("a0, a1")));
}

TEST(Streamer, RefusesATolerance) {
  const auto streamer = open(test::sample_volume(100, 11)).value();
  EXPECT_EQ(streamer->request(front_view(), test::opaque(), percent(-1)).error().code, ErrorCode::invalid_argument);
  EXPECT_EQ(streamer->request(front_view(), test::opaque(), percent(NAN)).error().code, ErrorCode::invalid_argument);
}

// The least memory with which a view is drawn at all, from the message of a refusal.
std::uint64_t least_memory(const TestVolume& volume) {
  std::uint64_t memory = 1;
  for (int step = 0; step < 5; ++step) {
    const auto streamer = open(volume, "a1", memory);
    const auto refused =
        streamer ? (*streamer)->request(front_view(), test::opaque(), percent(0)) : tl::unexpected(streamer.error());
    if (refused) return memory;
    EXPECT_EQ(refused.error().code, ErrorCode::out_of_budget);
    const std::string& message = refused.error().message;
    const std::uint64_t next = std::stoull(message.substr(message.find_last_of(' ') + 1));
    EXPECT_GT(next, memory) << message;
    memory = next;
  }
  ADD_FAILURE() << "the messages never name enough memory";
  return memory;
}

TEST(Streamer, LosesDetailAndNeverCoverageForItsBudget) {
  const TestVolume volume = test::sample_volume(20000, 12);
  const std::uint64_t least = least_memory(volume);
  std::uint64_t last = 0;
  for (const std::uint64_t memory : {least, least + 10000, least + 50000, least + 200000, least + 2000000}) {
    const auto streamer = open(volume, "a1", memory).value();
    const auto frame = streamer->request(front_view(), test::opaque(), percent(0));
    ASSERT_TRUE(frame) << memory << ": " << frame.error().message;
    EXPECT_LE(streamer->statistics().bytes_resident_peak, memory);
    EXPECT_GE((*frame)->splats, std::max(last, volume.info.resolution_counts[0]));
    EXPECT_EQ((*frame)->detail.tolerance_percent > 0, (*frame)->splats < 20000);
    last = (*frame)->splats;
  }
  EXPECT_EQ(last, 20000u);
}

TEST(Streamer, LosesDetailForWhatTheRendererCanHold) {
  const TestVolume volume = test::sample_volume(20000, 12);
  const auto streamer = open(volume, "a1", 64 << 20).value();
  DetailOptions detail = percent(0);
  detail.max_splats = 5000;
  const auto frame = streamer->request(front_view(), test::opaque(), detail);
  ASSERT_TRUE(frame) << frame.error().message;
  EXPECT_LE((*frame)->splats, 5000u);
  EXPECT_GE((*frame)->splats, 1000u);
  detail.max_splats = 1;
  EXPECT_EQ(streamer->request(front_view(), test::opaque(), detail).error().code, ErrorCode::out_of_budget);
}

TEST(Streamer, LowersAFixedResolutionForItsBudget) {
  const TestVolume volume = test::sample_volume(20000, 13);
  const auto streamer = open(volume, "a1", least_memory(volume) + 50000).value();
  const std::size_t finest = volume.info.resolutions() - 1;
  const auto frame = streamer->request(front_view(), test::opaque(), {.tolerance_percent = 1, .resolution = finest});
  ASSERT_TRUE(frame) << frame.error().message;
  ASSERT_TRUE((*frame)->detail.resolution);
  EXPECT_LT(*(*frame)->detail.resolution, finest);
  EXPECT_EQ((*frame)->splats, volume.info.resolution_counts[*(*frame)->detail.resolution]);
}

TEST(Streamer, StaysWithinItsBudgetOnAnyPath) {
  const TestVolume volume = test::sample_volume(20000, 14);
  const std::uint64_t least = least_memory(volume);
  for (const std::uint64_t memory : {least + 30000, least + 300000}) {
    const auto streamer = open(volume, "a1", memory).value();
    std::mt19937 random(14);
    for (int step = 0; step < 60; ++step) {
      const auto frame = streamer->request(test::random_view(random), test::opaque(), percent(std::exp2(step % 7 - 3)));
      ASSERT_TRUE(frame) << "step " << step << ": " << frame.error().message;
      ASSERT_LE(streamer->statistics().bytes_resident, memory);
    }
    EXPECT_LE(streamer->statistics().bytes_resident_peak, memory);
    EXPECT_GT(streamer->statistics().bytes_resident_peak, memory / 2);
  }
}

TEST(Streamer, TheSameViewIsTheSameWhateverWentBefore) {
  const TestVolume volume = test::sample_volume(20000, 15);
  const std::uint64_t memory = least_memory(volume) + 100000;
  const auto fresh = open(volume, "a1", memory).value();
  const auto used = open(volume, "a1", memory).value();
  std::mt19937 random(15);
  for (int step = 0; step < 10; ++step)
    ASSERT_TRUE(used->request(test::random_view(random), test::opaque(), percent(1)));
  const auto a = rows_of(*fresh->request(front_view(), test::opaque(), percent(0)).value());
  const auto b = rows_of(*used->request(front_view(), test::opaque(), percent(0)).value());
  EXPECT_EQ(a, b);
}

TEST(Streamer, AFailingSourceIsAnErrorAndNoMore) {
  const TestVolume volume = test::sample_volume(3000, 16);
  const auto control = std::make_shared<TestSource::Control>();
  const auto streamer = open(volume, "a1", 64u << 20, control).value();
  control->failing = true;
  const auto refused = streamer->request(front_view(), test::opaque(), percent(0));
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::io);
  EXPECT_THAT(refused.error().message, HasSubstr("test.svol"));
  control->failing = false;
  EXPECT_EQ(streamer->request(front_view(), test::opaque(), percent(0)).value()->splats, 3000u);
}

TEST(Streamer, ADamagedChunkIsNamed) {
  const TestVolume volume = test::sample_volume(3000, 17);
  const format::Bytes sound = test::test_volume_bytes(volume);
  const auto opened = format::Volume::open(memory_source(sound, "sound.svol")).value();
  const format::RowLayout& rows = opened->rows();
  const std::uint64_t row = rows.row_count() - 3;
  const auto page = opened->read_directory_page(opened->directory_page_of_row(row)).value();
  for (const int column : rows.columns_of_row(row)) {
    const format::ChunkPlace& place = opened->find_chunk(page, row, column);
    const format::Column& kind = volume.info.columns[static_cast<std::size_t>(column)];
    format::Bytes damaged = sound;
    damaged[place.offset + place.entry.packed_bytes / 2] ^= std::byte{1};
    const auto streamer = Streamer::open(memory_source(damaged, "damaged.svol"), {64u << 20, "a1"}).value();
    const auto frame = streamer->request(front_view(), test::opaque(), percent(0));
    if (kind.attribute == 0) {
      EXPECT_TRUE(frame) << "the other attribute is not looked at";
      continue;
    }
    ASSERT_FALSE(frame);
    EXPECT_EQ(frame.error().code, ErrorCode::invalid_data);
    EXPECT_THAT(frame.error().message, testing::AllOf(HasSubstr("damaged.svol"),
                                                      HasSubstr(fmt::format("of row {}", row)), HasSubstr("checksum")));
  }
}

TEST(Streamer, NoFlippedByteOfTheIndexGoesUnseen) {
  const TestVolume volume = test::sample_volume(1500, 18);
  const format::Bytes sound = test::test_volume_bytes(volume);
  const auto expected = rows_of(*open(volume).value()->request(front_view(), test::opaque(), percent(1)).value());
  std::mt19937 random(18);
  for (int trial = 0; trial < 300; ++trial) {
    format::Bytes damaged = sound;
    damaged[random() % sound.size()] ^= static_cast<std::byte>(1 + random() % 255);
    const auto streamer = Streamer::open(memory_source(damaged, "damaged.svol"), {64u << 20, "a1"});
    if (!streamer) continue;
    const auto frame = (*streamer)->request(front_view(), test::opaque(), percent(1));
    if (frame) {
      ASSERT_EQ(rows_of(**frame), expected) << "trial " << trial;
    }
  }
}

}  // namespace
}  // namespace splatvol
