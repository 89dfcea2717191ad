#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <thread>

#include "streamer/splats/streamer.h"
#include "tests/builder/support/built_input.h"
#include "tests/streamer/fixture.h"
#include "tests/support/fault_source.h"
#include "tests/support/long.h"
#include "tests/support/memory_source.h"
#include "tests/support/random.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using testing::HasSubstr;

constexpr std::uint64_t plenty = 64u << 20;
constexpr double long_enough = 60;  // seconds; only a failing test waits as long

constexpr int most_calls = 1000;  // for a picture; only a failing test makes so many

// Largest factor between a mass and its code: half a quantisation step of the log codes in the file and in the record,
// and single precision.
const double log_code_error = std::exp2(2.0 / 256) * (1 + 1e-6);

// A view of all of the volume.
View far_view() { return view_from({0.5, 0.5, 6}); }

std::vector<std::byte> bytes_of(const FrameSplats& frame) { return test::bytes_of(frame.list); }
double mass_of(const FrameSplats& frame) { return test::mass_of(frame.list); }

// One volume for all tests. a1 has no missing values.
const TestVolume& volume() {
  static const TestVolume made = sample_volume(20000, 31);
  return made;
}

const format::Bytes& volume_bytes() {
  static const format::Bytes bytes = test_volume_bytes(volume());
  return bytes;
}

// Builds a file of a mesh in the box [-2, 2] x [-2, 2] x [-1, 1], with the attribute "value".
format::Bytes build_mesh(const std::string& input, std::uint32_t points_per_chunk) {
  const TempFolder folder;
  BuildOptions options{.points_per_chunk = {.points = {points_per_chunk}}, .index_leaf_points = 255};
  build_input(input, folder.path("m.svol"), options);
  const auto file = open_file(folder.path("m.svol")).value();
  format::Bytes bytes(file->size());
  require(file->read(0, bytes));
  return bytes;
}

// A file with many chunks, for small budgets.
const format::Bytes& large_volume_bytes() {
  static const format::Bytes bytes = build_mesh("gen:mesh:cells=2e6,pieces=1", 64);
  return bytes;
}

// A budget for about a seventh of the records of the finest resolution.
std::uint64_t small_budget() {
  const auto file = format::Volume::open(memory_source(large_volume_bytes(), "large.svol")).value();
  return file->info().point_count() * record_bytes(KernelKind::moments) * 3 / 20;
}

// A file with chunks of the usual size.
const format::Bytes& usual_volume_bytes() {
  static const format::Bytes bytes = build_mesh("gen:mesh:cells=8e5,pieces=1", 1024);
  return bytes;
}

struct Paging : testing::TestWithParam<KernelKind> {
  std::shared_ptr<Faults> faults;  // of the last source

  std::unique_ptr<ByteSource> source_of(const format::Bytes& bytes) {
    faults = std::make_shared<Faults>(memory_source(bytes, "test.svol"));
    return std::make_unique<FaultSource>(faults);
  }
  std::unique_ptr<Streamer> open(std::uint64_t memory = plenty, const format::Bytes& bytes = volume_bytes(),
                                 const std::string& attribute = "a1") {
    return Streamer::open(source_of(bytes), {memory, attribute, GetParam()}).value();
  }
  static const FrameSplats& advance(Streamer& streamer, const View& view, double tolerance, double seconds = 0) {
    return *streamer.advance(view, opaque(), percent(tolerance), seconds).value();
  }
  // Returns the frame when it is settled.
  static const FrameSplats& settle(Streamer& streamer, const View& view, double tolerance) {
    for (int calls = 1;; ++calls) {
      const FrameSplats& frame = advance(streamer, view, tolerance, long_enough);
      if (frame.progress.settled) return frame;
      if (calls < most_calls) continue;
      ADD_FAILURE() << "missing: " << frame.progress.missing_rows << " parts of rows and "
                    << frame.progress.missing_pages << " pages";
      return frame;
    }
  }
};
INSTANTIATE_TEST_SUITE_P(Kernels, Paging, testing::ValuesIn(kernels()), kernel_name);

TEST_P(Paging, EndsInTheSynchronousFrame) {
  std::mt19937 random(32);
  const auto paging = open();
  const auto synchronous = open();
  for (int i = 0; i < 30; ++i) {
    const View view = i % 3 == 0 ? view_of_all(random) : random_view(random);
    const TransferFunction function = i % 5 == 0 ? window(10, 40) : opaque();
    Detail detail = percent(std::exp2(i % 7 - 2));
    if (i % 4 == 1) detail.resolution = i % 6;
    if (i % 4 == 3) detail.goal = ErrorGoal{0, std::uint64_t{64} << i % 8};
    const FrameSplats* frame = nullptr;
    int calls = 0;
    for (bool settled = false; !settled; settled = frame->progress.settled) {
      frame = paging->advance(view, function, detail, long_enough).value();
      ASSERT_LT(++calls, most_calls) << "missing: " << frame->progress.missing_rows << " parts of rows and "
                                     << frame->progress.missing_pages << " pages";
    }
    EXPECT_TRUE(frame->progress.complete);
    EXPECT_EQ(frame->progress.missing_bytes, 0u);
    EXPECT_EQ(frame->detail.tolerance_percent, detail.tolerance_percent);
    const FrameSplats& expected = *synchronous->request(view, function, detail).value();
    EXPECT_EQ(frame->splats, expected.splats);
    ASSERT_EQ(bytes_of(*frame), bytes_of(expected)) << "view " << i;
  }
}

TEST_P(Paging, ASteadyViewCostsNothing) {
  const auto streamer = open();
  const FrameSplats& first = settle(*streamer, far_view(), 1);
  const std::uint64_t serial = first.serial;
  const std::size_t reads = faults->reads();
  EXPECT_EQ(advance(*streamer, far_view(), 1).serial, serial);
  EXPECT_EQ(streamer->request(far_view(), opaque(), percent(1)).value()->serial, serial);
  EXPECT_EQ(faults->reads(), reads);
}

TEST_P(Paging, ShowsTheCoarsestWhileReadsHang) {
  const auto streamer = open();
  faults->hold();
  const FrameSplats& frame = advance(*streamer, far_view(), 0.5);
  EXPECT_FALSE(frame.progress.complete);
  EXPECT_FALSE(frame.progress.settled);
  EXPECT_GE(frame.splats, volume().info.resolution_counts[0]);
  EXPECT_LT(frame.splats, 20000u);
  faults->release();
  EXPECT_EQ(settle(*streamer, far_view(), 0).splats, 20000u);
}

// However little is resident, each part of the volume is drawn once: the masses add up.
TEST(PagingMass, IsThatOfTheVolumeInEveryFrame) {
  const double total = test::mass_of(volume());
  const auto streamer =
      Streamer::open(memory_source(volume_bytes(), "test.svol"), {plenty, "a1", KernelKind::moments}).value();
  std::set<std::uint64_t> numbers;
  std::mt19937 random(33);
  for (int view = 0; view < 12; ++view) {
    const View seen = view_of_all(random);
    const double tolerance = view < 6 ? 6 - view : 0.3 * view;
    int calls = 0;
    for (bool complete = false; !complete;) {
      ASSERT_LT(++calls, 1000 * most_calls);
      const FrameSplats& frame =
          *streamer->advance(seen, opaque(), percent(tolerance), calls % 2 == 0 ? 0 : 1e-4).value();
      ASSERT_LE(mass_of(frame), total * log_code_error);
      ASSERT_GE(mass_of(frame), total / log_code_error);
      numbers.insert(frame.splats);
      complete = frame.progress.complete;
    }
  }
  EXPECT_GT(numbers.size(), 6u) << "the views have as many cuts, and there are those on the way to them";
}

TEST_P(Paging, AWalkStaysWithinItsBudget) {
  const int steps = is_long() ? 1000 : 300;
  const std::uint64_t memory = small_budget();
  const auto streamer = open(memory, large_volume_bytes(), "value");
  std::mt19937 random(34);
  std::uniform_real_distribution<double> uniform(-1, 1);
  dvec3 eye(0.5, 0.5, 3), at(0.5);
  int complete = 0;
  double finest = 100;
  for (int step = 0; step < steps; ++step) {
    eye += 0.05 * (random_vector(uniform, random) - dvec3(0, 0, 0.1));
    eye.z = std::max(eye.z, 1.5);  // outside of the mesh: splats near the eye are within no tolerance
    at += 0.05 * random_vector(uniform, random);
    const auto frame =
        streamer->advance(view_from(eye, at), opaque(), percent(step % 50 == 0 ? 0.1 : 2), step % 10 == 0 ? 0.01 : 0);
    ASSERT_TRUE(frame) << "step " << step << ": " << frame.error().message;
    ASSERT_LE(streamer->statistics().bytes_resident, memory);
    complete += (*frame)->progress.complete ? 1 : 0;
    finest = std::min(finest, (*frame)->detail.tolerance_percent);
    ASSERT_GT((*frame)->splats, 0u);
  }
  EXPECT_LE(streamer->statistics().bytes_resident_peak, memory);
  EXPECT_GT(streamer->statistics().bytes_resident_peak, memory / 2);
  EXPECT_GT(complete, 10);
  EXPECT_LT(complete, steps);
  EXPECT_LT(finest, 50);
}

TEST_P(Paging, EndsInTheSynchronousFrameForItsDetailHoweverLittleMemory) {
  const std::uint64_t memory = small_budget();
  const auto streamer = open(memory, large_volume_bytes(), "value");
  const auto synchronous = open(plenty, large_volume_bytes(), "value");
  std::mt19937 random(35);
  for (int i = 0; i < 20; ++i) {
    const View view = random_view(random);
    const FrameSplats& frame = settle(*streamer, view, 0.1);
    EXPECT_TRUE(frame.progress.complete);
    const FrameSplats& expected = *synchronous->request(view, opaque(), frame.detail).value();
    ASSERT_EQ(bytes_of(frame), bytes_of(expected)) << "view " << i;
    ASSERT_LE(streamer->statistics().bytes_resident_peak, memory);
  }
}

// One rule of the budget: waiting for the file or not, a view gets the same detail for the same bytes.
TEST_P(Paging, GivesTheDetailOfARequestForTheSameBudget) {
  std::mt19937 random(37);
  std::set<std::uint64_t> numbers;
  for (const std::uint64_t memory : {small_budget(), 2 * small_budget()}) {
    const auto paging = open(memory, large_volume_bytes(), "value");
    const auto synchronous = open(memory, large_volume_bytes(), "value");
    for (int i = 0; i < 16; ++i) {
      const View view = random_view(random);
      Detail detail = percent(0.1);
      if (i % 4 == 1) detail.resolution = 100;
      if (i % 4 == 3) detail.goal = ErrorGoal{0, 1000000};
      const FrameSplats* frame = nullptr;
      for (int calls = 0; calls < most_calls && !(frame && frame->progress.settled); ++calls)
        frame = paging->advance(view, opaque(), detail, long_enough).value();
      const FrameSplats& expected = *synchronous->request(view, opaque(), detail).value();
      EXPECT_TRUE(frame->progress.complete);
      EXPECT_EQ(frame->detail, expected.detail) << "view " << i << ", " << memory << " bytes";
      EXPECT_EQ(bytes_of(*frame), bytes_of(expected)) << "view " << i;
      numbers.insert(frame->splats);
    }
  }
  EXPECT_GT(numbers.size(), 10u);
}

TEST_P(Paging, TooLittleMemorySaysHowMuchWouldDo) {
  std::uint64_t memory = 1000;
  for (int step = 0;; ++step) {
    ASSERT_LT(step, 5) << "the messages never name enough memory";
    const auto streamer = Streamer::open(source_of(volume_bytes()), {memory, "a1", GetParam()});
    const auto frame =
        streamer ? (*streamer)->advance(far_view(), opaque(), percent(1), 0.0) : tl::unexpected(streamer.error());
    if (frame) break;
    EXPECT_EQ(frame.error().code, ErrorCode::out_of_budget);
    const std::string& message = frame.error().message;
    const std::uint64_t next = std::stoull(message.substr(message.find_last_of(' ') + 1));
    EXPECT_GT(next, memory) << message;
    memory = next;
  }
  EXPECT_LT(memory, volume_bytes().size() / 4);
  const auto streamer = open(memory);
  EXPECT_TRUE(settle(*streamer, far_view(), 1).progress.complete);
}

TEST_P(Paging, ReadsLittleMoreThanItNeeds) {
  for (const dvec3& eye : {dvec3(0, 0, 6), dvec3(1, 1, 1.5), dvec3(0, 0.5, 0), dvec3(-3, 0, 1)})
    for (const double tolerance : {0.0, 1.0, 3.0}) {
      const View view = view_from(eye, dvec3(0.5, 0.5, 0));
      const auto streamer = open(plenty, usual_volume_bytes(), "value");
      const FrameSplats& frame = settle(*streamer, view, tolerance);
      const auto read = static_cast<double>(streamer->statistics().bytes_read);
      EXPECT_GT(frame.splats, 1000u);
      // For small pictures, most of the bytes read are the preamble, with the coarsest chunks of all columns.
      const double preamble = static_cast<double>(streamer->volume().preamble_bytes());
      EXPECT_LE(read - preamble, 1.5 * static_cast<double>(frame.progress.needed_bytes));
    }
}

TEST_P(Paging, WhatIsNoLongerWantedIsNotRead) {
  const auto streamer = open();
  settle(*streamer, far_view(), 10);
  const std::size_t before = faults->reads();
  faults->hold();
  // Many chunks to read. Each thread begins one load run.
  advance(*streamer, far_view(), 0);
  faults->wait_for_held(read_threads);
  EXPECT_TRUE(advance(*streamer, far_view(), 10).progress.complete) << "nothing of this is missing";
  faults->release();
  EXPECT_TRUE(settle(*streamer, far_view(), 10).progress.complete);
  EXPECT_LE(faults->reads(), before + 2 * read_threads) << "and what had been begun on the way to the first picture";
  EXPECT_TRUE(settle(*streamer, far_view(), 0).progress.complete);
  EXPECT_GT(faults->reads(), before + 20);
}

// A camera that goes on as before finds its parts resident. A camera that looks from afar in between does not.
TEST_P(Paging, ReadsAheadOfTheCamera) {
  const auto view_at = [](int step) {
    const double x = -2 + 0.08 * step;
    return view_from({x, 0.1, 1.5}, {x, 0, 0});
  };
  const auto found_at_once = [&](bool goes_on) {
    const auto streamer = open(plenty, usual_volume_bytes(), "value");
    int found = 0;
    for (int step = 0; step < 50; ++step) {
      if (advance(*streamer, view_at(step), 1).progress.complete) ++found;
      EXPECT_TRUE(settle(*streamer, view_at(step), 1).progress.complete);
      if (!goes_on) settle(*streamer, view_from({0, 0, 12}, dvec3(0)), 10);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));  // to read ahead
    }
    EXPECT_LE(streamer->statistics().bytes_resident_peak, plenty);
    return found;
  };
  EXPECT_GT(found_at_once(true), found_at_once(false));
}

TEST_P(Paging, ClosesWhileReadsHang) {
  auto streamer = open();
  faults->hold();
  advance(*streamer, far_view(), 0);
  faults->wait_for_held(4);
  std::thread closing([&] { streamer.reset(); });
  faults->release();
  closing.join();
  EXPECT_EQ(faults->held(), 0U);
}

TEST_P(Paging, ClosingInterruptsReadsThatHang) {
  auto streamer = open();
  faults->hold();
  advance(*streamer, far_view(), 0);
  faults->wait_for_held(4);
  streamer.reset();  // or this would never end
  EXPECT_EQ(faults->held(), 0U);
}

// From the least budget on, which messages name. In the least ones, some pages of the index have no room.
TEST_P(Paging, SettlesWithinAnyBudgetThatDraws) {
  std::mt19937 random(39);
  std::uint64_t memory = 1000;
  int drawn = 0;
  while (drawn < 24) {
    auto streamer = Streamer::open(source_of(large_volume_bytes()), {memory, "value", GetParam()});
    const View view = random_view(random);
    const FrameSplats* frame = nullptr;
    Status status = streamer ? Status{} : tl::unexpected(streamer.error());
    for (int calls = 0; status && !(frame && frame->progress.settled); ++calls) {
      ASSERT_LT(calls, most_calls) << memory << " bytes, " << frame->progress.missing_rows << " rows and "
                                   << frame->progress.missing_pages << " pages are missing";
      if (const auto next = (*streamer)->advance(view, opaque(), percent(0.5), 0.5))
        frame = *next;
      else
        status = tl::unexpected(next.error());
    }
    if (status) {
      ASSERT_LE((*streamer)->statistics().bytes_resident_peak, memory);
      ++drawn;
    } else {
      EXPECT_EQ(status.error().code, ErrorCode::out_of_budget);
    }
    memory += memory / 40;
  }
}

// Returns the chunks that a frame of all points needs, except those that are read with the preamble.
std::vector<format::ChunkLocation> chunks_to_read(const format::Volume& file, KernelKind kernel) {
  std::vector<format::ChunkLocation> locations;
  const format::RowLayout& rows = file.rows();
  for (std::uint64_t row = rows.first_row(rows.resolution_of_row(rows.row_count() - 1)); row < rows.row_count();
       ++row) {
    const auto page = file.read_directory_page(file.directory_page_of_row(row)).value();
    for (const int column : rows.columns_of_row(row)) {
      const format::ColumnKind kind = file.info().columns[static_cast<std::size_t>(column)].kind;
      const bool wanted =
          kernel == KernelKind::octant ? kind == format::ColumnKind::octant : kind == format::ColumnKind::moments;
      const format::ChunkLocation& location = file.find_chunk(page, row, column);
      if (wanted && location.offset > volume_bytes().size() / 8) locations.push_back(location);
    }
  }
  return locations;
}

TEST_P(Paging, ADiskThatIsGoneIsNotAskedForEver) {
  const auto streamer = open(plenty, large_volume_bytes(), "value");
  settle(*streamer, far_view(), 30);
  const auto file = format::Volume::open(memory_source(large_volume_bytes(), "large.svol")).value();
  for (const format::ChunkLocation& location : chunks_to_read(*file, GetParam()))
    faults->fail_range(location.offset, location.offset + location.entry.packed_bytes);
  std::size_t errors = 0;
  int calls = 0;
  for (bool settled = false; !settled && calls < most_calls; ++calls) {
    const FrameSplats& frame = advance(*streamer, far_view(), 0, long_enough);
    errors += frame.progress.errors.size();
    settled = frame.progress.settled;
    EXPECT_FALSE(frame.progress.complete);
  }
  EXPECT_LT(calls, most_calls);
  EXPECT_GE(errors, 1000u);
  const std::size_t reads = faults->reads();
  EXPECT_TRUE(advance(*streamer, view_from({0, 0.1, 5}), 0).progress.settled);
  EXPECT_EQ(faults->reads(), reads);
}

TEST_P(Paging, ADamagedChunkIsDrawnCoarserAndToldOnce) {
  const auto file = format::Volume::open(memory_source(volume_bytes(), "sound.svol")).value();
  const std::vector<format::ChunkLocation> locations = chunks_to_read(*file, GetParam());
  ASSERT_GT(locations.size(), 100u);
  format::Bytes damaged = volume_bytes();
  const std::vector<format::ChunkLocation> bad = {locations[10], locations[locations.size() / 2], locations.back()};
  for (const format::ChunkLocation& location : bad)
    damaged[location.offset + location.entry.packed_bytes / 2] ^= std::byte{1};

  const auto streamer = open(plenty, damaged);
  std::vector<Error> errors;
  for (bool settled = false; !settled;) {
    const FrameSplats& frame = advance(*streamer, far_view(), 0, long_enough);
    errors.insert(errors.end(), frame.progress.errors.begin(), frame.progress.errors.end());
    settled = frame.progress.settled;
    if (settled) {
      EXPECT_FALSE(frame.progress.complete);
      EXPECT_EQ(frame.progress.missing_rows, 3u);
      EXPECT_LT(frame.splats, 20000u);
      EXPECT_GT(frame.splats, 10000u) << "all but what lies round three chunks";
      if (GetParam() == KernelKind::moments) {
        EXPECT_NEAR(mass_of(frame) / test::mass_of(volume()), 1, log_code_error - 1);
      }
    }
  }
  ASSERT_EQ(errors.size(), 3u);
  for (const Error& error : errors) {
    EXPECT_EQ(error.code, ErrorCode::invalid_data);
    EXPECT_THAT(error.message, testing::AllOf(HasSubstr("test.svol: chunk '"), HasSubstr("checksum")));
  }
  for (int i = 0; i < 5; ++i)
    EXPECT_TRUE(advance(*streamer, view_from({0.5, 0.5, 6.01 + i}), 0).progress.errors.empty());
  for (const format::ChunkLocation& location : bad)
    EXPECT_EQ(faults->reads_of(location.offset, location.offset + location.entry.packed_bytes), 1);
}

TEST_P(Paging, AnUnreadablePartIsDrawnCoarser) {
  const auto streamer = open();
  const std::uint64_t size = volume_bytes().size();
  advance(*streamer, far_view(), 100);
  faults->fail_range(size / 2, size);
  std::size_t errors = 0;
  for (bool settled = false; !settled;) {
    const FrameSplats& frame = advance(*streamer, far_view(), 0, long_enough);
    for (const Error& error : frame.progress.errors) {
      EXPECT_EQ(error.code, ErrorCode::io);
      EXPECT_THAT(error.message, testing::AllOf(HasSubstr("test.svol: "), HasSubstr("as the test wants")));
    }
    errors += frame.progress.errors.size();
    settled = frame.progress.settled;
    if (GetParam() == KernelKind::moments) {
      EXPECT_NEAR(mass_of(frame) / test::mass_of(volume()), 1, log_code_error - 1);
    }
    EXPECT_GE(frame.splats, volume().info.resolution_counts[0]);
  }
  EXPECT_GT(errors, 0u);
  const std::size_t reads = faults->reads();
  EXPECT_EQ(advance(*streamer, far_view(), 0).progress.errors.size(), 0u);
  EXPECT_EQ(faults->reads(), reads);
}

}  // namespace
}  // namespace splatvol::test
