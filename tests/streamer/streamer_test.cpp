#include "streamer/splats/streamer.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "tests/streamer/fixture.h"
#include "tests/support/memory_source.h"
#include "tests/support/results.h"

namespace splatvol::test {
namespace {

using format::ColumnKind;
using namespace ::testing;

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr std::uint64_t plenty = 64u << 20;

// Largest factor between a mass or a deviation and its code: half a quantisation step of the log code, and single
// precision.
const double log_code_error = std::exp2(1.0 / 256) * (1 + 1e-6);
const double value_code_error = std::exp2(1.0 / 16) * (1 + 1e-6);  // of deviations of values

Result<std::unique_ptr<Streamer>> open(
    const TestVolume& volume, const StreamerOptions& options,
    std::shared_ptr<TestSource::Control> control = std::make_shared<TestSource::Control>()) {
  return Streamer::open(source_of(volume, std::move(control)), options);
}

View front_view() { return view_from({0.5, 0.5, 6}); }

Detail fixed(std::size_t resolution) { return {.tolerance_percent = 1, .resolution = resolution}; }

// A splat of either kind in world coordinates.
struct Placed {
  dvec3 position;
  double value;
  OctantSplat octant;
  MomentsSplat material;

  [[nodiscard]] bool operator==(const Placed& other) const {
    return position == other.position && value == other.value && material.mass == other.material.mass &&
           material.deviations == other.material.deviations && material.orientation == other.material.orientation &&
           octant.size == other.octant.size && octant.gradient == other.octant.gradient;
  }
};

// Sorts splats, so that their order does not depend on the streamer.
std::vector<Placed> placed_splats(const FrameSplats& frame) {
  std::vector<Placed> placed;
  for (const DrawRange& range : frame.list.ranges)
    for (std::uint32_t i = range.begin; i < range.begin + range.count; ++i) {
      Placed splat{};
      if (std::holds_alternative<std::vector<OctantShape>>(range.row.shapes->records())) {
        splat.octant = unpack_octant(range.row, i);
        splat.position = dvec3(splat.octant.position);
        splat.value = static_cast<double>(splat.octant.value);
      } else {
        splat.material = unpack(range.row, i);
        splat.position = splat.material.center;
        splat.value = splat.material.value;
      }
      splat.position += range.row.shapes->blocks()[range.block].origin;
      placed.push_back(splat);
    }
  std::ranges::sort(placed, {}, [](const Placed& s) { return std::tuple(s.position.x, s.position.y, s.position.z); });
  return placed;
}

// Returns the splat nearest to each of `wanted`, within `reach`. Each splat must be the nearest to one of them.
std::vector<Placed> match(const std::vector<Placed>& splats, const std::vector<dvec3>& wanted, double reach) {
  std::vector<Placed> matched;
  std::set<std::size_t> used;
  for (const dvec3& p : wanted) {
    auto candidate = std::ranges::lower_bound(splats, p.x - reach, {}, [](const Placed& s) { return s.position.x; });
    auto nearest = splats.end();
    for (; candidate != splats.end() && candidate->position.x <= p.x + reach; ++candidate)
      if (nearest == splats.end() || glm::distance(candidate->position, p) < glm::distance(nearest->position, p))
        nearest = candidate;
    if (nearest == splats.end() || glm::distance(nearest->position, p) > 2 * reach) {
      ADD_FAILURE() << "nothing near " << p.x << ", " << p.y << ", " << p.z;
      return {};
    }
    used.insert(static_cast<std::size_t>(nearest - splats.begin()));
    matched.push_back(*nearest);
  }
  EXPECT_EQ(used.size(), splats.size());
  return matched;
}

int byte_of(std::uint32_t packed, int index) { return static_cast<std::int8_t>(packed >> 8 * index); }

void expect_octants(const FrameSplats& frame, const TestVolume& volume, std::size_t resolution, bool gradients) {
  const std::uint64_t count = volume.info.resolution_counts[resolution];
  ASSERT_EQ(frame.splats, count);
  // A step of the records' positions is at most 2^-21 of the unit cube.
  const auto splats = match(placed_splats(frame), {volume.positions.begin(), volume.positions.begin() + count}, 5e-7);
  for (std::size_t i = 0; i < splats.size(); ++i) {
    const OctantSplat& splat = splats[i].octant;
    const float value = volume.stored[0][i];
    ASSERT_TRUE(splat.value == value || (std::isnan(splat.value) && std::isnan(value)));
    const double size = volume.splat_size(resolution, i);
    ASSERT_NEAR(static_cast<double>(splat.size), size, 1e-6 * size);
    const vec3 direction = volume.gradients[0][i];
    const float length = glm::length(direction);
    for (int axis = 0; axis < 3; ++axis) {
      // A component is rounded once, to a multiple of 1/127.
      const float expected = length > 0 && gradients ? direction[axis] / length : 0;
      ASSERT_NEAR(byte_of(splat.gradient, axis), 127 * expected, 1);
      if (expected == 0) {
        ASSERT_EQ(byte_of(splat.gradient, axis), 0);
      }
    }
    ASSERT_EQ(byte_of(splat.gradient, 3), 0);
  }
}

TEST(Streamer, HandsOnOctantsAtEachResolution) {
  const TestVolume volume = sample_volume(3000, 1);
  for (const bool gradients : {false, true}) {
    const auto streamer = open(volume, {plenty, "a0", KernelKind::octant, gradients}).value();
    for (std::size_t r = 0; r < volume.info.resolutions(); ++r) {
      const auto frame = value_of(streamer->request(front_view(), opaque(), fixed(r)));
      expect_octants(*frame, volume, r, gradients);
      EXPECT_EQ(frame->splats_by_resolution[r], volume.info.resolution_counts[r]);
    }
  }
}

// The second moments of a splat: of the position, and of position and value. They do not depend on the signs of the
// axes.
struct Described {
  dmat3 covariance{0};
  dvec3 with_value{0};
};

Described described(const dmat3& axes, const dvec3& deviations, double value_deviation, const dvec3& correlations) {
  Described result;
  for (int k = 0; k < 3; ++k) {
    result.covariance += deviations[k] * deviations[k] * glm::outerProduct(axes[k], axes[k]);
    result.with_value += correlations[k] * deviations[k] * value_deviation * axes[k];
  }
  return result;
}

void expect_moments(const MomentsSplat& splat, const SplatShape& shape, const SplatValue& value) {
  // Numbers are rounded to codes in the file and again in the record. The code of the coverage is off by less than a
  // quantisation step, twice.
  const double code_error = log_code_error * log_code_error;
  ASSERT_LE(splat.mass, shape.mass * std::min(1.0, value.coverage + 2.0 / 255) * code_error);
  ASSERT_GE(splat.mass, shape.mass * (value.coverage - 2.0 / 255) / code_error);
  ASSERT_EQ(splat.mass > 0, shape.mass * value.coverage > 0);
  for (int k = 0; k < 3; ++k) {
    ASSERT_LE(splat.deviations[k], shape.deviations[k] * code_error);
    ASSERT_GE(splat.deviations[k], shape.deviations[k] / code_error);
  }
  if (value.coverage == 0) return;
  ASSERT_LE(splat.value_deviation, value.deviation * value_code_error * log_code_error);
  ASSERT_GE(splat.value_deviation, value.deviation / value_code_error / log_code_error);

  const dmat3 axes = glm::mat3_cast(splat.orientation);
  const Described actual = described(axes, splat.deviations, splat.value_deviation, splat.correlations);
  const Described expected =
      described(glm::mat3_cast(shape.orientation), shape.deviations, value.deviation, value.correlation);

  // The orientation is off by less than 1/16 of the shortest axis over the longest, or by rounding to 20 bits, twice:
  // 3 components are off by 2^-21.5, weighted with at most 2, and the angle by twice this. Lengths are off by the
  // rounding of log codes.
  const double longest = shape.deviations[0];
  const double turn = std::max(shape.deviations[2] / 16, 1e-5 * longest) + 1e-5 * longest;
  const double scale = 2 * (code_error - 1) + 1e-5;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      ASSERT_NEAR(actual.covariance[i][j], expected.covariance[i][j], 2 * turn * longest + scale * longest * longest);
  const double codes = (1.0 / 30 + 1.0 / 254) * (shape.deviations.x + shape.deviations.y + shape.deviations.z);
  ASSERT_LE(glm::distance(actual.with_value, expected.with_value),
            value.deviation * 1.05 *
                (codes + (scale + value_code_error - 1) * std::sqrt(3.0) * longest + std::sqrt(3.0) * turn));
}

// Returns how far the means of a resolution may be off (spec 8): half of an eighth of their deviation, which is off by
// 2^(1/16); or the rounding of single precision.
std::vector<double> mean_errors(const TestVolume& volume, std::size_t attribute, std::size_t resolution) {
  const double range = volume.info.attributes[attribute].max - volume.info.attributes[attribute].min;
  std::vector<double> errors;
  for (const SplatValue& value : volume.signals[attribute][resolution])
    errors.push_back(0.07 * value.deviation + 1.2e-6 * range);
  return errors;
}

TEST(Streamer, HandsOnMomentsAtEachResolution) {
  const TestVolume volume = sample_volume(3000, 1);
  for (const std::size_t a : {0u, 1u}) {
    const auto streamer = open(volume, {plenty, fmt::format("a{}", a), KernelKind::moments}).value();
    for (std::size_t r = 0; r < volume.info.resolutions(); ++r) {
      const auto frame = value_of(streamer->request(front_view(), opaque(), fixed(r)));
      ASSERT_EQ(frame->splats, volume.info.resolution_counts[r]);
      EXPECT_EQ(frame->splats_by_resolution[r], volume.info.resolution_counts[r]);

      // At most 1/64 of the smallest deviation of a chunk, which is at most the largest deviation of all.
      double reach = 1e-7;
      for (const SplatShape& shape : volume.shapes[r]) reach = std::max(reach, shape.deviations[2] / 64);
      const auto splats = match(placed_splats(*frame), volume.centroids[r], reach);
      ASSERT_EQ(splats.size(), volume.centroids[r].size());
      const auto errors = mean_errors(volume, a, r);
      for (std::size_t i = 0; i < splats.size(); ++i) {
        const SplatValue& value = volume.signals[a][r][i];
        ASSERT_NO_FATAL_FAILURE(expect_moments(splats[i].material, volume.shapes[r][i], value))
            << "resolution " << r << ", splat " << i;
        if (value.coverage == 0) continue;
        ASSERT_NEAR(splats[i].value, value.mean, errors[i]);
      }
    }
  }
}

TEST(Streamer, EveryCutHasTheSameMass) {
  const TestVolume volume = sample_volume(3000, 20);
  const double total = mass_of(volume);
  const auto streamer = open(volume, {plenty, "a1", KernelKind::moments}).value();
  std::set<std::uint64_t> numbers;
  const auto expect_total = [&](const Detail& detail) {
    const FrameSplats& frame = *streamer->request(front_view(), opaque(), detail).value();
    numbers.insert(frame.splats);
    const double mass = mass_of(frame.list);
    // Each mass is within the error of its codes, in the file and in the record, and so is the sum.
    EXPECT_LE(mass, total * log_code_error * log_code_error);
    EXPECT_GE(mass, total / log_code_error / log_code_error);
  };
  for (std::size_t r = 0; r < volume.info.resolutions(); ++r) expect_total(fixed(r));
  for (double tolerance = 0.1; tolerance < 50; tolerance *= 1.5) expect_total(percent(tolerance));
  EXPECT_GT(numbers.size(), volume.info.resolutions() + 3);
}

// Returns the chunks of the file: column, begin and end, row.
struct FileChunk {
  const format::Column* column;
  std::uint64_t begin, end, row;
};

std::vector<FileChunk> chunks_of(const format::Volume& volume) {
  std::vector<FileChunk> chunks;
  for (std::uint64_t row = 0; row < volume.rows().row_count(); ++row) {
    const auto page = volume.read_directory_page(volume.directory_page_of_row(row)).value();
    for (const int column : volume.rows().columns_of_row(row)) {
      const format::ChunkLocation& location = volume.find_chunk(page, row, column);
      chunks.push_back({&volume.info().columns[static_cast<std::size_t>(column)], location.offset,
                        location.offset + location.entry.packed_bytes, row});
    }
  }
  return chunks;
}

TEST(Streamer, MomentsReadNothingElse) {
  const TestVolume volume = sample_volume(20000, 21, {.points_per_chunk = 1024});
  for (std::size_t r = 1; r < volume.info.resolutions(); ++r) {
    const auto control = std::make_shared<TestSource::Control>();
    const auto streamer = open(volume, {plenty, "a0", KernelKind::moments}, control).value();
    const std::uint64_t in_memory = control->ranges.front().second;
    streamer->request(front_view(), opaque(), fixed(r)).value();
    const auto ranges = control->ranges;
    const auto overlaps = [&](const FileChunk& chunk) {
      return std::ranges::any_of(ranges.begin() + 1, ranges.end(), [&](const auto& range) {
        return range.first < chunk.end && chunk.begin < range.second;
      });
    };
    std::map<ColumnKind, int> large_and_left_alone;
    for (const FileChunk& chunk : chunks_of(streamer->volume())) {
      const ColumnKind kind = chunk.column->kind;
      const bool wanted = streamer->volume().rows().resolution_of_row(chunk.row) == r &&
                          (kind == ColumnKind::centroid || kind == ColumnKind::moments ||
                           (kind == ColumnKind::value_moments && chunk.column->attribute == 0));
      if (chunk.end <= in_memory) continue;
      if (wanted) {
        EXPECT_TRUE(overlaps(chunk)) << "it is all visible";
        continue;
      }
      // Smaller chunks may be in a gap, which is read because this is cheaper than a second read.
      if (chunk.end - chunk.begin <= 1024) continue;
      EXPECT_FALSE(overlaps(chunk)) << format::column_kind_name(kind) << " of row " << chunk.row;
      ++large_and_left_alone[kind];
    }
    if (r + 1 < volume.info.resolutions()) continue;
    for (const ColumnKind kind : {ColumnKind::position, ColumnKind::value, ColumnKind::value_moments,
                                  ColumnKind::centroid, ColumnKind::moments, ColumnKind::gradient})
      EXPECT_GT(large_and_left_alone[kind], 0) << format::column_kind_name(kind);
  }
}

TEST(Streamer, MomentsAreShownWhereTheirMaterialIsVisible) {
  const TestVolume volume = sample_volume(5000, 22);
  const TransferFunction function = window(50, 52);  // of 100 z
  const auto streamer = open(volume, {plenty, "a1", KernelKind::moments}).value();
  for (std::size_t r = 0; r < volume.info.resolutions(); ++r) {
    const FrameSplats& frame = *streamer->request(front_view(), function, fixed(r)).value();
    std::vector<double> means;
    for (const Placed& splat : placed_splats(frame)) means.push_back(splat.value);
    std::ranges::sort(means);
    const auto errors = mean_errors(volume, 1, r);
    int visible = 0, visible_by_material = 0;
    for (std::size_t i = 0; i < volume.shapes[r].size(); ++i) {
      const format::ValueSummary& material = volume.materials[1][r][i];
      if (!(material.min <= material.max)) continue;
      if (!extinction_within(function, static_cast<double>(material.min), static_cast<double>(material.max))) continue;
      ++visible;
      const SplatValue& value = volume.signals[1][r][i];
      visible_by_material += function.extinction(value.mean) == 0;
      const auto found = std::ranges::lower_bound(means, value.mean - errors[i]);
      ASSERT_TRUE(found != means.end() && *found <= value.mean + errors[i]) << "resolution " << r << ", splat " << i;
    }
    EXPECT_GT(visible, 0);
    EXPECT_GT(visible_by_material, 0) << "of others the mean tells";
    if (r + 1 == volume.info.resolutions()) {
      EXPECT_LT(frame.splats, 2500u);
    }
  }
}

TEST(Streamer, AFileWithoutMomentsSaysWhatToDo) {
  const TestVolume volume = sample_volume(100, 23, {.moments = false, .gradients = false});
  const auto moments = open(volume, {plenty, "a1", KernelKind::moments});
  ASSERT_FALSE(moments);
  EXPECT_EQ(moments.error().code, ErrorCode::unsupported);
  EXPECT_THAT(moments.error().message,
              AllOf(HasSubstr("test.svol"), HasSubstr("--kernel octant"), HasSubstr("svbuild")));

  EXPECT_TRUE(open(volume, {plenty, "a1", KernelKind::octant}));
  EXPECT_THAT(open(volume, {plenty, "a1", KernelKind::octant, true}),
              FailsWith(ErrorCode::unsupported,
                        AllOf(HasSubstr("test.svol"), HasSubstr("gradients of 'a1'"), HasSubstr("svbuild"))));
}

// --- Tests for every kind of splat.
struct StreamerOf : testing::TestWithParam<KernelKind> {
  static Result<std::unique_ptr<Streamer>> open(
      const TestVolume& volume, const std::string& attribute = "a1", std::uint64_t memory = plenty,
      std::shared_ptr<TestSource::Control> control = std::make_shared<TestSource::Control>()) {
    return test::open(volume, {memory, attribute, GetParam()}, std::move(control));
  }

  // Returns the least memory that a view needs, from the message of a refusal.
  static std::uint64_t least_memory(const TestVolume& volume) {
    std::uint64_t memory = 1;
    for (int step = 0; step < 5; ++step) {
      const auto streamer = open(volume, "a1", memory);
      const auto refused =
          streamer ? (*streamer)->request(front_view(), opaque(), percent(0)) : tl::unexpected(streamer.error());
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
};
INSTANTIATE_TEST_SUITE_P(Kernels, StreamerOf, testing::ValuesIn(kernels()), kernel_name);

TEST_P(StreamerOf, KeepsDetailFarFromTheOrigin) {
  TestVolumeOptions options{.cube = {{1e9, -2e9, 3e9}, 1}, .value_offset = 50};
  const TestVolume volume = sample_volume(1000, 2, options);
  const auto streamer = open(volume).value();
  View view = front_view();
  view.eye += options.cube.origin;
  const auto frame = value_of(streamer->request(view, opaque(), percent(0)));
  // Doubles near 3e9 are 5e-7 apart. In single precision, the position of a splat in its node is far finer.
  std::vector<double> expected;
  for (std::size_t i = 0; i < 1000; ++i)
    expected.push_back((GetParam() == KernelKind::octant ? volume.positions[i] : volume.centroids.back()[i]).x);
  std::ranges::sort(expected);
  const auto actual = placed_splats(*frame);
  ASSERT_EQ(actual.size(), expected.size());
  std::set<double> positions;
  for (std::size_t i = 0; i < actual.size(); ++i) {
    positions.insert(actual[i].position.x);
    ASSERT_NEAR(actual[i].position.x, expected[i], 2e-6);
  }
  EXPECT_GT(positions.size(), 950u);
}

TEST_P(StreamerOf, RangesAreTheFrame) {
  const TestVolume volume = sample_volume(3000, 3);
  const auto streamer = open(volume).value();
  const FrameSplats& frame = *streamer->request(view_from({2, 1, 0.3}), opaque(), percent(3)).value();
  std::uint64_t splats = 0, nodes = 0, by_resolution = 0;
  const bool moments = GetParam() == KernelKind::moments;
  for (const DrawRange& range : frame.list.ranges) {
    EXPECT_GT(range.count, 0u);
    EXPECT_EQ(range.row.shapes->size(), range.row.values->size());
    EXPECT_LE(range.begin + range.count, range.row.shapes->blocks()[range.block].end);
    EXPECT_EQ(std::holds_alternative<std::vector<MomentsShape>>(range.row.shapes->records()), moments);
    splats += range.count;
  }
  EXPECT_EQ(frame.list.splats, splats);
  for (const std::uint64_t n : frame.nodes_by_resolution) nodes += n;
  for (const std::uint64_t n : frame.splats_by_resolution) by_resolution += n;
  EXPECT_EQ(frame.splats, splats);
  EXPECT_EQ(by_resolution, splats);
  EXPECT_EQ(frame.nodes, streamer->drawn_nodes().size());
  EXPECT_EQ(frame.nodes, nodes);
  EXPECT_EQ(frame.detail.tolerance_percent, 3);
}

TEST_P(StreamerOf, ASteadyViewCostsNothing) {
  const TestVolume volume = sample_volume(3000, 4);
  const auto control = std::make_shared<TestSource::Control>();
  const auto streamer = open(volume, "a1", plenty, control).value();
  const FrameSplats* first = streamer->request(front_view(), opaque(), percent(1)).value();
  const std::uint64_t serial = first->serial, reads = control->reads;

  const FrameSplats* second = streamer->request(front_view(), opaque(), percent(1)).value();
  EXPECT_EQ(second, first);
  EXPECT_EQ(second->serial, serial);
  EXPECT_EQ(streamer->statistics().fetch_seconds, 0);
  TransferFunction recoloured = opaque();
  recoloured.colors = {{0, dvec3(0.2)}};
  EXPECT_EQ(streamer->request(front_view(), recoloured, percent(1)).value()->serial, serial);

  EXPECT_NE(streamer->request(front_view(), opaque(), percent(20)).value()->serial, serial);
  EXPECT_NE(streamer->request(front_view(), opaque(), percent(1)).value()->serial, serial);
  const std::uint64_t reads_for_other_sizes = control->reads;
  streamer->request(front_view(), opaque(), percent(20)).value();
  EXPECT_EQ(control->reads, reads_for_other_sizes) << "what was decoded is still there";
  EXPECT_GE(reads_for_other_sizes, reads);
}

// A change of the cut costs the list alone: the rows are those that were there, not copies.
TEST_P(StreamerOf, RowsStayWhenTheCutChanges) {
  const TestVolume volume = sample_volume(20000, 24);
  const auto streamer = open(volume).value();
  const auto rows_of = [](const FrameSplats& frame) {
    std::map<const ShapeRow*, std::uint64_t> ids;
    for (const DrawRange& range : frame.list.ranges) ids[range.row.shapes.get()] = range.row.shapes->id();
    return ids;
  };
  // The eye is near, so that the view shows parts of the volume.
  const auto first = rows_of(*streamer->request(view_from({0.5, 0.5, 1.1}), opaque(), percent(2)).value());
  streamer->request(front_view(), opaque(), percent(50)).value();
  const auto again = rows_of(*streamer->request(view_from({0.5, 0.5, 1.1}), opaque(), percent(2)).value());
  EXPECT_EQ(first, again);
  const auto turned = rows_of(*streamer->request(view_from({0.5, 0.55, 1.1}), opaque(), percent(2)).value());
  std::size_t shared = 0;
  for (const auto& [row, id] : turned) shared += first.contains(row) ? 1 : 0;
  EXPECT_GT(shared, turned.size() / 2);
}

TEST_P(StreamerOf, OpensWithOneRead) {
  const TestVolume volume = sample_volume(3000, 5);
  const auto control = std::make_shared<TestSource::Control>();
  const auto streamer = open(volume, "a1", plenty, control).value();
  EXPECT_EQ(control->reads, 1u);
  const std::uint64_t opened = streamer->statistics().bytes_read;
  streamer->request(front_view(), opaque(), percent(infinity)).value();
  EXPECT_EQ(control->reads, 1u) << "the coarsest picture is in the preamble";
  EXPECT_EQ(streamer->statistics().bytes_read, opened);
}

TEST_P(StreamerOf, ReadsOnlyWhatTheCutTouches) {
  const TestVolume volume = sample_volume(20000, 6);
  std::uint64_t last = std::numeric_limits<std::uint64_t>::max();
  std::map<double, double> share;
  for (const double tolerance : {0.5, 2.0, 5.0, 20.0}) {
    const auto streamer = open(volume).value();
    streamer->request(front_view(), opaque(), percent(tolerance)).value();
    const std::uint64_t read = streamer->statistics().bytes_read;
    share[tolerance] = static_cast<double>(read) / static_cast<double>(streamer->volume().file_bytes());
    EXPECT_LE(read, last);
    last = read;
  }
  EXPECT_LT(share[20.0], 0.15);
  EXPECT_GT(share[0.5], 0.15) << "of a file with columns for both kernels and two attributes";
}

TEST_P(StreamerOf, ReadsNoChunkThatTheTransferFunctionHides) {
  const TestVolume volume = sample_volume(20000, 7);
  const auto bytes_read = [&](const TransferFunction& function) {
    const auto streamer = open(volume).value();
    const FrameSplats& frame = *streamer->request(front_view(), function, percent(0)).value();
    std::uint64_t visible = 0;
    for (const Placed& splat : placed_splats(frame)) visible += function.extinction(splat.value) > 0;
    std::uint64_t expected = 0;
    for (const float value : volume.stored[1]) expected += function.extinction(static_cast<double>(value)) > 0;
    if (GetParam() == KernelKind::octant) {
      EXPECT_EQ(visible, expected);
    }
    return streamer->statistics().bytes_read;
  };
  const std::uint64_t all = bytes_read(opaque());
  EXPECT_LT(bytes_read(window(90, 95)), all / 3);
  EXPECT_LT(bytes_read(window(1000, 2000)), all / 10);
}

TEST_P(StreamerOf, AnAttributeWithoutValuesDrawsNothing) {
  const std::vector<double> missing(500, std::numeric_limits<double>::quiet_NaN());
  const TestVolume volume = make_test_volume(random_points(500, 9), {missing});
  const auto streamer = open(volume, "a0").value();
  const auto frame = value_of(streamer->request(front_view(), opaque(), percent(1)));
  EXPECT_EQ(frame->splats, 0u);
}

TEST_P(StreamerOf, AnUnknownAttributeListsTheOthers) {
  EXPECT_THAT(message_of(open(sample_volume(100, 10), "pressure")),
              AllOf(HasSubstr("test.svol"), HasSubstr("\"pressure\""), HasSubstr("a0, a1")));
}

// --- An opacity by another attribute.
std::vector<double> opacities_of(const FrameSplats& frame, const DrawingUnits& units) {
  std::vector<double> values;
  for (const DrawRange& range : frame.list.ranges)
    for (std::uint32_t i = range.begin; i < range.begin + range.count; ++i) {
      const OpacityValue& value = range.row.values->opacity().records[i];
      values.push_back(value.coverage == 0 ? std::numeric_limits<double>::quiet_NaN()
                                           : units.opacity_offset + units.opacity_scale * double{value.mean});
    }
  return values;
}

StreamerOptions by_both(KernelKind kernel, std::uint64_t memory = plenty) {
  return {.memory_bytes = memory, .attribute = "a1", .kernel = kernel, .opacity_attribute = "a0"};
}

TEST_P(StreamerOf, HandsOnTheValuesThatGiveTheOpacity) {
  const TestVolume volume = sample_volume(4000, 31, {.value_offset = 20});
  const auto streamer = test::open(volume, by_both(GetParam())).value();
  const auto other = open(volume, "a0").value();
  for (const std::size_t resolution : {std::size_t{1}, volume.info.resolutions() - 1}) {
    const TransferFunction all = opaque();
    const FrameSplats& frame = *streamer->request(front_view(), {all, &all}, fixed(resolution)).value();
    // The same cut, through the other attribute. Its splats without values are not left out: all of its rows have some.
    const FrameSplats& of_other = *other->request(front_view(), all, fixed(resolution)).value();
    const std::vector<double> values = opacities_of(frame, streamer->units());
    const std::vector<Placed> expected = [&] {
      std::vector<Placed> placed;
      for (const DrawRange& range : of_other.list.ranges)
        for (std::uint32_t i = range.begin; i < range.begin + range.count; ++i) {
          Placed splat{};
          if (GetParam() == KernelKind::octant) {
            splat.value = static_cast<double>(unpack_octant(range.row, i).value);
          } else {
            splat.material = unpack(range.row, i);
            splat.value = splat.material.mass > 0 ? splat.material.value : std::numeric_limits<double>::quiet_NaN();
          }
          placed.push_back(splat);
        }
      return placed;
    }();
    ASSERT_EQ(values.size(), expected.size());
    std::size_t missing = 0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (std::isnan(expected[i].value)) {
        ++missing;
        ASSERT_TRUE(std::isnan(values[i]));
      } else {
        ASSERT_EQ(values[i], other->units().value(expected[i].value)) << i;
      }
    }
    EXPECT_LT(missing, values.size() / 4);
  }
}

// Whatever is left out has no visible factor, and much is left out.
TEST_P(StreamerOf, LeavesOutWhatTheOpacityHides) {
  const TestVolume volume = sample_volume(20000, 32);
  const TransferFunction all = opaque(), factors = window(2.4, 2.8);
  const auto frame_of = [&](Streamer& streamer, const TransferFunction* opacity) {
    return streamer.request(front_view(), {all, opacity}, percent(0)).value();
  };
  const auto whole = test::open(volume, by_both(GetParam())).value();
  const auto streamer = test::open(volume, by_both(GetParam())).value();
  const auto visible_of = [&](const FrameSplats& frame) {
    return std::ranges::count_if(opacities_of(frame, streamer->units()),
                                 [&](double value) { return factors.extinction(value) > 0; });
  };
  const FrameSplats& with = *frame_of(*streamer, &factors);
  const FrameSplats& without = *frame_of(*whole, &all);
  EXPECT_EQ(visible_of(with), visible_of(without));
  EXPECT_GT(visible_of(with), 100);
  EXPECT_LT(with.splats, without.splats / 3);
  EXPECT_LT(streamer->statistics().bytes_read, whole->statistics().bytes_read / 2);

  // Another function, and back.
  EXPECT_EQ(frame_of(*streamer, nullptr)->splats, without.splats);
  EXPECT_LT(frame_of(*streamer, &factors)->splats, without.splats / 3);

  // Reading piece by piece ends in the same frame.
  const auto paging = test::open(volume, by_both(GetParam())).value();
  const FrameSplats* frame = nullptr;
  for (int turns = 0; !frame || !frame->progress.complete; ++turns) {
    ASSERT_LT(turns, 10000);
    frame = paging->advance(front_view(), {all, &factors}, percent(0), 1).value();
  }
  EXPECT_EQ(bytes_of(frame->list), bytes_of(frame_of(*streamer, &factors)->list));
}

TEST_P(StreamerOf, AnOpacityStaysWithinTheBudget) {
  const TestVolume volume = sample_volume(20000, 33);
  const TransferFunction all = opaque(), factors = window(0.5, 2.5);
  for (const std::uint64_t memory : {least_memory(volume) * 2, least_memory(volume) + 1000000}) {
    const auto streamer = test::open(volume, by_both(GetParam(), memory)).value();
    std::mt19937 random(33);
    for (int step = 0; step < 20; ++step) {
      View view = random_view(random);
      if (step % 3 == 0) view.clip.box = Box{dvec3(0.2), dvec3(0.7)};
      const auto frame = value_of(streamer->request(view, {all, &factors}, percent(std::exp2(step % 7 - 3))));
      for (const DrawRange& range : frame->list.ranges)
        ASSERT_EQ(range.row.values->opacity().records.size(), range.row.values->size());
    }
    EXPECT_LE(streamer->statistics().bytes_resident_peak, memory);
  }
}

TEST_P(StreamerOf, AnUnknownOpacityListsTheOthers) {
  StreamerOptions options = by_both(GetParam());
  options.opacity_attribute = "pressure";
  EXPECT_THAT(message_of(test::open(sample_volume(100, 10), options)),
              AllOf(HasSubstr("\"pressure\""), HasSubstr("a0, a1")));
}

TEST_P(StreamerOf, RefusesATolerance) {
  const auto streamer = open(sample_volume(100, 11)).value();
  EXPECT_EQ(streamer->request(front_view(), opaque(), percent(-1)).error().code, ErrorCode::invalid_argument);
  EXPECT_EQ(streamer->request(front_view(), opaque(), percent(NAN)).error().code, ErrorCode::invalid_argument);
}

TEST_P(StreamerOf, LosesDetailAndNeverCoverageForItsBudget) {
  const TestVolume volume = sample_volume(20000, 12);
  const std::uint64_t least = least_memory(volume);
  std::uint64_t last = 0;
  for (const std::uint64_t memory : {least, least + 10000, least + 50000, least + 200000, least + 6000000}) {
    const auto streamer = open(volume, "a1", memory).value();
    const auto frame = streamer->request(front_view(), opaque(), percent(0));
    ASSERT_TRUE(frame) << memory << ": " << frame.error().message;
    EXPECT_LE(streamer->statistics().bytes_resident_peak, memory);
    EXPECT_GE((*frame)->splats, std::max(last, volume.info.resolution_counts[0]));
    EXPECT_EQ((*frame)->detail.tolerance_percent > 0, (*frame)->splats < 20000);
    last = (*frame)->splats;
  }
  EXPECT_EQ(last, 20000u);
}

TEST_P(StreamerOf, LosesDetailForWhatTheDeviceCanHold) {
  const TestVolume volume = sample_volume(20000, 12);
  const auto streamer = open(volume, "a1", plenty).value();
  Detail detail = percent(0);
  detail.device_splats = 5000;
  const auto frame = value_of(streamer->request(front_view(), opaque(), detail));
  EXPECT_LE(frame->splats, 5000u);
  EXPECT_GE(frame->splats, 1000u);
  detail.device_splats = 1;
  EXPECT_EQ(streamer->request(front_view(), opaque(), detail).error().code, ErrorCode::out_of_budget);
}

TEST_P(StreamerOf, LowersAFixedResolutionForItsBudget) {
  const TestVolume volume = sample_volume(20000, 13);
  const auto streamer = open(volume, "a1", least_memory(volume) + 50000).value();
  const std::size_t finest = volume.info.resolutions() - 1;
  const auto frame = value_of(streamer->request(front_view(), opaque(), fixed(finest)));
  ASSERT_TRUE(frame->detail.resolution);
  EXPECT_LT(*frame->detail.resolution, finest);
  EXPECT_EQ(frame->splats, volume.info.resolution_counts[*frame->detail.resolution]);
}

TEST_P(StreamerOf, StaysWithinItsBudgetOnAnyPath) {
  const TestVolume volume = sample_volume(20000, 14);
  const std::uint64_t least = least_memory(volume);
  for (const std::uint64_t memory : {least + 30000, least + 300000}) {
    const auto streamer = open(volume, "a1", memory).value();
    std::mt19937 random(14);
    for (int step = 0; step < 60; ++step) {
      const auto frame = streamer->request(random_view(random), opaque(), percent(std::exp2(step % 7 - 3)));
      ASSERT_TRUE(frame) << "step " << step << ": " << frame.error().message;
      ASSERT_LE(streamer->statistics().bytes_resident, memory);
    }
    EXPECT_LE(streamer->statistics().bytes_resident_peak, memory);
    EXPECT_GT(streamer->statistics().bytes_resident_peak, memory / 2);
  }
}

TEST_P(StreamerOf, TheSameViewIsTheSameWhateverWentBefore) {
  const TestVolume volume = sample_volume(20000, 15);
  const std::uint64_t memory = least_memory(volume) + 100000;
  const auto fresh = open(volume, "a1", memory).value();
  const auto used = open(volume, "a1", memory).value();
  std::mt19937 random(15);
  for (int step = 0; step < 10; ++step) ASSERT_TRUE(used->request(random_view(random), opaque(), percent(1)));
  const auto a = placed_splats(*fresh->request(front_view(), opaque(), percent(0)).value());
  const auto b = placed_splats(*used->request(front_view(), opaque(), percent(0)).value());
  EXPECT_EQ(a, b);
}

TEST_P(StreamerOf, AFailingSourceIsAnErrorAndNoMore) {
  const TestVolume volume = sample_volume(3000, 16);
  const auto control = std::make_shared<TestSource::Control>();
  const auto streamer = open(volume, "a1", plenty, control).value();
  control->failing = true;
  EXPECT_THAT(streamer->request(front_view(), opaque(), percent(0)), FailsWith(ErrorCode::io, HasSubstr("test.svol")));
  control->failing = false;
  EXPECT_EQ(streamer->request(front_view(), opaque(), percent(0)).value()->splats, 3000u);
}

TEST_P(StreamerOf, ADamagedChunkIsNamed) {
  const TestVolume volume = sample_volume(3000, 17);
  const format::Bytes sound = test_volume_bytes(volume);
  const auto opened = format::Volume::open(memory_source(sound, "sound.svol")).value();
  const format::RowLayout& rows = opened->rows();
  const std::uint64_t row = rows.row_count() - 3;
  const auto page = opened->read_directory_page(opened->directory_page_of_row(row)).value();
  for (const int column : rows.columns_of_row(row)) {
    const format::ChunkLocation& location = opened->find_chunk(page, row, column);
    const format::Column& kind = volume.info.columns[static_cast<std::size_t>(column)];
    format::Bytes damaged = sound;
    damaged[location.offset + location.entry.packed_bytes / 2] ^= std::byte{1};
    const auto streamer = Streamer::open(memory_source(damaged, "damaged.svol"), {plenty, "a1", GetParam()}).value();
    const auto frame = streamer->request(front_view(), opaque(), percent(0));
    const bool of_moments =
        kind.kind == ColumnKind::centroid || kind.kind == ColumnKind::moments || kind.kind == ColumnKind::value_moments;
    if (kind.attribute == 0 || kind.kind == ColumnKind::gradient || of_moments != (GetParam() == KernelKind::moments)) {
      EXPECT_TRUE(frame) << "not looked at: another attribute's, or another kernel's";
      continue;
    }
    ASSERT_FALSE(frame);
    EXPECT_EQ(frame.error().code, ErrorCode::invalid_data);
    EXPECT_THAT(frame.error().message,
                AllOf(HasSubstr("damaged.svol"), HasSubstr(fmt::format("of row {}", row)), HasSubstr("checksum")));
  }
}

TEST_P(StreamerOf, NoFlippedByteOfTheIndexGoesUnseen) {
  const TestVolume volume = sample_volume(1500, 18);
  const format::Bytes sound = test_volume_bytes(volume);
  const auto expected = placed_splats(*open(volume).value()->request(front_view(), opaque(), percent(1)).value());
  std::mt19937 random(18);
  for (int trial = 0; trial < 300; ++trial) {
    format::Bytes damaged = sound;
    damaged[random() % sound.size()] ^= static_cast<std::byte>(1 + random() % 255);
    const auto streamer = Streamer::open(memory_source(damaged, "damaged.svol"), {plenty, "a1", GetParam()});
    if (!streamer) continue;
    const auto frame = (*streamer)->request(front_view(), opaque(), percent(1));
    if (frame) {
      ASSERT_EQ(placed_splats(**frame), expected) << "trial " << trial;
    }
  }
}

}  // namespace
}  // namespace splatvol::test
