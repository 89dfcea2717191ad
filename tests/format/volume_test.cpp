#include "format/volume.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "base/file.h"
#include "format/codes.h"
#include "tests/format/allocation_counter.h"
#include "tests/support/fault_source.h"
#include "tests/support/long.h"
#include "tests/support/memory_source.h"
#include "tests/support/results.h"
#include "tests/support/sanitizers.h"
#include "tests/support/temp_folder.h"
#include "tests/support/test_volume.h"
#include "tests/support/volume_bytes.h"

namespace splatvol::test {
namespace {

using namespace format;
using testing::HasSubstr;

std::vector<std::vector<double>> random_values(std::size_t attributes, std::size_t points,
                                               double missing_share = 0.05) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<std::vector<double>> values(attributes, std::vector<double>(points));
  for (auto& column : values)
    for (double& value : column) value = uniform(random) < missing_share ? std::nan("") : 10 * uniform(random) - 3;
  return values;
}

TestVolume small_volume(std::size_t points, std::size_t attributes, const TestVolumeOptions& options = {}) {
  return make_test_volume(random_points(points, 3), random_values(attributes, points), options);
}

std::shared_ptr<const Volume> open_bytes(const Bytes& bytes) {
  return value_of(Volume::open(memory_source(bytes, "test.svol")));
}

Status verify_bytes(const Bytes& bytes, std::size_t threads = 1) {
  SPLATVOL_TRY_ASSIGN(volume, Volume::open(memory_source(bytes, "test.svol")));
  return volume->verify([](double) {}, threads);
}

// The same by three readers, who share the chunks.
Status verify_in_parts(const Bytes& bytes) {
  SPLATVOL_TRY_ASSIGN(volume, Volume::open(memory_source(bytes, "test.svol")));
  const auto progress = [](double) {};
  Volume::CheckedValues all;
  constexpr std::uint64_t parts = 3;
  for (std::uint64_t part = 0; part < parts; ++part) {
    SPLATVOL_TRY_ASSIGN(found, volume->verify_chunks(part, parts, progress));
    all.histograms.resize(found.histograms.size());
    all.missing.resize(found.missing.size());
    for (std::size_t a = 0; a < found.missing.size(); ++a) {
      for (std::size_t bin = 0; bin < all.histograms[a].size(); ++bin)
        all.histograms[a][bin] += found.histograms[a][bin];
      all.missing[a] += found.missing[a];
    }
  }
  return volume->verify_rest(std::move(all), progress);
}

// Compares a chunk of material with its input. The tests of columns test the bounds of errors.
void expect_same_material(const ChunkEntry& entry, const Bytes& packed, const Column& column, const Group& group,
                          std::size_t resolution, const TestVolume& volume) {
  const auto attribute = static_cast<std::size_t>(std::max(column.attribute, 0));
  std::vector<dvec3> centroids(group.count);
  std::vector<SplatShape> shapes(group.count);
  std::vector<SplatValue> values(group.count);
  std::vector<vec3> gradients(group.count);
  if (column.kind == ColumnKind::centroid) {
    ASSERT_TRUE(unpack_centroids(entry, packed, centroids, volume.info.cube, "test"));
    PositionCodes codes;
    ASSERT_TRUE(unpack_centroid_codes(entry, packed, group.count, volume.info.cube, "test", codes));
    for (std::size_t i = 0; i < group.count; ++i)
      EXPECT_LE(glm::distance(centroids[i], volume.centroids[resolution][group.begin + i]), 2 * codes.error);
  } else if (column.kind == ColumnKind::moments) {
    ASSERT_TRUE(unpack_moments(entry, packed, shapes, volume.info.cube.edge, "test"));
    for (std::size_t i = 0; i < group.count; ++i) {
      const SplatShape& expected = volume.shapes[resolution][group.begin + i];
      EXPECT_NEAR(shapes[i].mass, expected.mass, 0.003 * expected.mass);
      for (int k = 0; k < 3; ++k)
        EXPECT_NEAR(shapes[i].deviations[k], expected.deviations[k], 0.003 * expected.deviations[k]);
    }
  } else if (column.kind == ColumnKind::value_moments) {
    ASSERT_TRUE(unpack_value_moments(entry, packed, values, "test"));
    for (std::size_t i = 0; i < group.count; ++i) {
      const SplatValue& expected = volume.signals[attribute][resolution][group.begin + i];
      EXPECT_NEAR(values[i].coverage, expected.coverage, 1.0 / 255);
      if (!(expected.coverage > 0)) continue;
      EXPECT_NEAR(values[i].deviation, expected.deviation, 0.05 * expected.deviation + 1e-14);
      for (int k = 0; k < 3; ++k) EXPECT_NEAR(values[i].correlation[k], expected.correlation[k], 0.034);
    }
  } else {
    ASSERT_EQ(column.kind, ColumnKind::gradient);
    ASSERT_TRUE(unpack_gradients(entry, packed, gradients, "test"));
    for (std::size_t i = 0; i < group.count; ++i) {
      const dvec3 expected(volume.gradients[attribute][group.begin + i]);
      const double length = glm::length(expected);
      for (int k = 0; k < 3; ++k)
        EXPECT_NEAR(static_cast<double>(gradients[i][k]), length > 0 ? expected[k] / length : 0, 0.004);
    }
  }
}

// Compares all chunks of a file with their input.
void expect_same_columns(const Volume& file, const TestVolume& volume) {
  const RowLayout& rows = file.rows();
  for (std::uint64_t row = 0; row < rows.row_count(); ++row) {
    const DirectoryPage page = file.read_directory_page(file.directory_page_of_row(row)).value();
    const Group group = rows.group(rows.group_of_row(row));
    const std::size_t resolution = rows.resolution_of_row(row);
    for (const int c : rows.columns_of_row(row)) {
      const ChunkLocation& location = file.find_chunk(page, row, c);
      const Bytes packed = file.read_bytes(location.offset, location.entry.packed_bytes).value();
      const Column& column = file.info().columns[static_cast<std::size_t>(c)];
      if (column.kind == ColumnKind::position) {
        std::vector<dvec3> positions(group.count);
        ASSERT_TRUE(unpack_positions(location.entry, packed, positions, volume.info.cube, "test"));
        for (std::size_t i = 0; i < group.count; ++i)
          for (int axis = 0; axis < 3; ++axis)
            EXPECT_NEAR(positions[i][axis], volume.positions[group.begin + i][axis], volume.position_error);
      } else if (column.kind == ColumnKind::value) {
        std::vector<float> values(group.count);
        ASSERT_TRUE(unpack_values(location.entry, packed, values, "test"));
        for (std::size_t i = 0; i < group.count; ++i) {
          const float expected = volume.stored[static_cast<std::size_t>(column.attribute)][group.begin + i];
          EXPECT_TRUE(values[i] == expected || (std::isnan(values[i]) && std::isnan(expected)));
        }
      } else if (column.kind == ColumnKind::octant) {
        std::vector<std::uint8_t> depths(group.count), counts(group.count);
        ASSERT_TRUE(unpack_octants(location.entry, packed, depths, counts, "test"));
        for (std::size_t i = 0; i < group.count; ++i) {
          EXPECT_EQ(depths[i], volume.depths[resolution][group.begin + i]);
          EXPECT_EQ(counts[i], volume.counts[resolution][group.begin + i]);
        }
      } else {
        expect_same_material(location.entry, packed, column, group, resolution, volume);
      }
    }
  }
}

// Compares the nodes of a file, depth first, with the tree of the input. Returns the next node of the tree.
std::size_t expect_same_nodes(const Volume& file, const IndexPage& page, std::uint32_t node, int attribute,
                              const NodeArrays& tree, std::size_t at) {
  EXPECT_EQ(page.nodes.child_masks[node], tree.child_masks[at]);
  EXPECT_EQ(page.nodes.first_resolutions[node], tree.first_resolutions[at]);
  EXPECT_TRUE(std::ranges::equal(page.nodes.counts_of(node), tree.counts_of(at)));
  for (std::size_t r = tree.first_resolutions[at]; r < tree.shape.resolutions; ++r)
    EXPECT_EQ(page.nodes.size_code_at(node, 0, r), tree.size_code_at(at, 0, r));
  if (attribute >= 0) {
    const ValueSummary& expected = tree.summaries[at * tree.shape.attributes + static_cast<std::size_t>(attribute)];
    EXPECT_EQ(page.nodes.summaries[node].min, expected.min);
    EXPECT_EQ(page.nodes.summaries[node].max, expected.max);
    EXPECT_EQ(page.nodes.summaries[node].occupancy, expected.occupancy);
  }
  const auto children = static_cast<std::uint32_t>(std::popcount(tree.child_masks[at]));
  ++at;
  if (page.links[node] == IndexPage::no_node) {
    for (std::uint32_t c = 0; c < children; ++c)
      at = expect_same_nodes(file, page, page.first_children[node] + c, attribute, tree, at);
    return at;
  }
  const auto linked = value_of(file.read_index_page(page.pages[page.links[node]], page.nodes.child_masks[node],
                                                    page.nodes.counts_of(node), {attribute}));
  for (std::uint32_t c = 0; c < children; ++c) at = expect_same_nodes(file, linked, c, attribute, tree, at);
  return at;
}

void expect_comes_back(const TestVolume& volume) {
  const Bytes bytes = test_volume_bytes(volume);
  const auto file = open_bytes(bytes);
  EXPECT_EQ(message_of(file->verify([](double) {})), "");
  EXPECT_EQ(file->info().resolution_counts, volume.info.resolution_counts);
  expect_same_columns(*file, volume);
  for (int attribute = -1; attribute < static_cast<int>(volume.stored.size()); ++attribute) {
    const IndexPage root = file->read_index_root({attribute}).value();
    EXPECT_EQ(expect_same_nodes(*file, root, 0, attribute, volume.tree, 0), volume.tree.size());
  }
  const Histograms histograms = file->read_histograms().value();
  for (std::size_t a = 0; a < volume.stored.size(); ++a) {
    std::uint64_t present = 0;
    for (const std::uint64_t count : histograms[a]) present += count;
    EXPECT_EQ(present + file->info().attributes[a].missing, volume.positions.size());
  }
}

TEST(Volume, ComesBack) {
  expect_comes_back(small_volume(1, 1));
  expect_comes_back(small_volume(2, 0));
  expect_comes_back(small_volume(20, 2));
  expect_comes_back(small_volume(1000, 3));
}

TEST(Volume, ComesBackWithinTheErrorOfItsPositions) {
  expect_comes_back(small_volume(1500, 1, {.node_points = 8, .position_error = 1e-4}));
}

TEST(Volume, ComesBackFarFromTheOriginWithAnOffset) {
  const TestVolumeOptions options{.position_error = 1e-6, .cube = {{1e7, -1e7, 5}, 1}, .value_offset = 101325};
  auto points = random_points(500, 8);
  for (dvec3& p : points) p += options.cube.origin;
  auto values = random_values(1, 500);
  for (double& value : values[0]) value += 101325;
  expect_comes_back(make_test_volume(points, values, options));
}

TEST(Volume, ComesBackWithoutAnyPresentValue) {
  expect_comes_back(make_test_volume(random_points(100, 1), random_values(1, 100, 2.0)));
}

TEST(Volume, ComesBackWhereAllPointsCoincide) {
  expect_comes_back(make_test_volume(std::vector<dvec3>(50, dvec3(0.3)), random_values(1, 50)));
}

TEST(Volume, TheSameInputGivesTheSameBytes) {
  const TestVolume volume = small_volume(700, 2);
  EXPECT_EQ(test_volume_bytes(volume), test_volume_bytes(volume));
}

TEST(Volume, ProgressGrowsToOne) {
  const Bytes bytes = test_volume_bytes(small_volume(700, 1));
  double last = 0;
  ASSERT_TRUE(open_bytes(bytes)->verify([&](double fraction) {
    EXPECT_GE(fraction, last);
    last = fraction;
  }));
  EXPECT_EQ(last, 1);
}

// --- Damage: every length and every byte.

TEST(Damage, EveryTruncationIsRefused) {
  const Bytes whole = test_volume_bytes(small_volume(150, 1));
  ASSERT_TRUE(verify_bytes(whole));
  for (std::size_t length = 0; length < whole.size(); ++length) {
    const Bytes part(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(length));
    EXPECT_THAT(message_of(Volume::open(memory_source(part, "test.svol"))), testing::StartsWith("test.svol: "))
        << length;
  }
}

TEST(Damage, AGrownFileIsRefused) {
  Bytes grown = test_volume_bytes(small_volume(150, 1));
  grown.push_back(std::byte{0});
  EXPECT_THAT(verify_bytes(grown).error().message, HasSubstr("[R2]"));
}

TEST(Damage, EveryFlippedByteIsFound) {
  Bytes bytes = test_volume_bytes(small_volume(is_long() ? 500 : 150, 1));
  ASSERT_TRUE(verify_bytes(bytes));
  ASSERT_TRUE(verify_in_parts(bytes));
  std::mt19937 random(1);
  const std::size_t step = is_sanitized && !is_long() ? 11 : 1;  // each takes ten times as long there
  for (std::size_t i = 0; i < bytes.size(); i += step) {
    const std::byte whole = bytes[i];
    for (const std::byte pattern : {std::byte{1} << random() % 8, static_cast<std::byte>(1 + random() % 255)}) {
      bytes[i] = whole ^ pattern;
      const Status status = verify_bytes(bytes);
      ASSERT_FALSE(status) << "byte " << i << " of " << bytes.size();
      ASSERT_FALSE(verify_in_parts(bytes)) << "byte " << i << " of " << bytes.size();
      EXPECT_THAT(status.error().message, testing::StartsWith("test.svol: "));
    }
    bytes[i] = whole;
  }
}

// Many pages of the directory, and two damaged places: the first one is told.
TEST(Damage, IsToldTheSameWayByAnyNumberOfThreads) {
  Bytes bytes = test_volume_bytes(small_volume(is_sanitized ? 6'000 : 20'000, 3, {.node_points = 8}));
  ASSERT_GT(Volume::open(memory_source(bytes, "test.svol")).value()->directory_page_count(), 4u);
  for (const std::size_t threads : {0u, 1u, 2u, 16u}) EXPECT_TRUE(verify_bytes(bytes, threads)) << threads;
  EXPECT_TRUE(verify_in_parts(bytes));
  std::mt19937 random(2);
  for (int tries = 0; tries < (is_sanitized ? 3 : 100); ++tries) {
    const std::array<std::size_t, 2> at = {random() % bytes.size(), random() % bytes.size()};
    for (const std::size_t i : at) bytes[i] ^= std::byte{1};
    const Status status = verify_bytes(bytes), by_many = verify_bytes(bytes, 4);
    EXPECT_FALSE(verify_in_parts(bytes)) << "bytes " << at[0] << " and " << at[1];
    for (const std::size_t i : at) bytes[i] ^= std::byte{1};
    ASSERT_FALSE(status) << "bytes " << at[0] << " and " << at[1];
    ASSERT_FALSE(by_many) << "bytes " << at[0] << " and " << at[1];
    EXPECT_EQ(by_many.error().message, status.error().message);
  }
}

// --- Reads.

TEST(Reads, AFailingSourceGivesItsErrorWhereverItFails) {
  // Larger than the first read, so that every kind of part needs a read.
  const Bytes bytes = test_volume_bytes(small_volume(2500, 2, {.node_points = 8}));
  ASSERT_GT(bytes.size(), 2 * min_first_read_bytes);
  std::shared_ptr<Faults> faults;
  const auto verify = [&](std::uint64_t failing_read) -> Status {
    faults = std::make_shared<Faults>(memory_source(bytes, "counted"));
    faults->fail_read(failing_read);
    SPLATVOL_TRY_ASSIGN(volume, Volume::open(std::make_unique<FaultSource>(faults)));
    return volume->verify([](double) {});
  };
  ASSERT_TRUE(verify(1'000'000));
  const std::uint64_t all = faults->reads();
  EXPECT_GT(all, 100u);
  for (std::uint64_t k = 0; k < all; k += is_sanitized ? 5 : 1) {
    EXPECT_THAT(verify(k), FailsWith(ErrorCode::io, fmt::format("counted: read {} fails, as the test wants", k)));
    EXPECT_EQ(faults->reads(), k + 1);
  }
}

TEST(Reads, OpeningTakesOneRead) {
  for (const std::size_t points : {1, 300, 2500}) {
    const Bytes bytes = test_volume_bytes(small_volume(points, 2));
    const auto faults = std::make_shared<Faults>(memory_source(bytes, "counted"));
    const auto volume = value_of(Volume::open(std::make_unique<FaultSource>(faults)));
    EXPECT_EQ(faults->reads(), 1u);
    EXPECT_LE(volume->preamble_bytes(), min_first_read_bytes);
    EXPECT_EQ(volume->bytes_read(), std::min<std::uint64_t>(bytes.size(), min_first_read_bytes));

    // The first picture too: root page, and the chunks of the coarsest resolution.
    ASSERT_TRUE(volume->read_index_root({0}));
    const DirectoryPage page = volume->read_directory_page(0).value();
    for (const int column : volume->rows().columns_of_row(0)) {
      const ChunkLocation& location = volume->find_chunk(page, 0, column);
      ASSERT_TRUE(volume->read_bytes(location.offset, location.entry.packed_bytes));
    }
    EXPECT_EQ(faults->reads(), 1u);
  }
}

TEST(Reads, APreambleLongerThanTheFirstReadTakesTwo) {
  const Bytes bytes = test_volume_bytes(small_volume(400, 120));
  const auto faults = std::make_shared<Faults>(memory_source(bytes, "counted"));
  const auto volume = value_of(Volume::open(std::make_unique<FaultSource>(faults)));
  ASSERT_GT(volume->preamble_bytes(), min_first_read_bytes);
  EXPECT_EQ(faults->reads(), 2u);
  EXPECT_TRUE(volume->verify([](double) {}));
}

TEST(Reads, OneAttributeOfManyIsReadByItself) {
  const TestVolume volume = small_volume(600, 150, {.node_points = 1});
  const Bytes bytes = test_volume_bytes(volume);
  const auto file = open_bytes(bytes);
  const IndexPage root = file->read_index_root({7}).value();
  ASSERT_FALSE(root.pages.empty());
  const auto node = static_cast<std::size_t>(std::ranges::find(root.links, 0u) - root.links.begin());
  const IndexPageRef& ref = root.pages[0];
  ASSERT_GT(ref.page_bytes, 64u << 10);
  const std::uint64_t before = file->bytes_read();
  ASSERT_TRUE(file->read_index_page(ref, root.nodes.child_masks[node], root.nodes.counts_of(node), {7}));
  EXPECT_LT(file->bytes_read() - before, ref.page_bytes / 4);
  EXPECT_EQ(expect_same_nodes(*file, root, 0, 7, volume.tree, 0), volume.tree.size());
}

TEST(Reads, RangesPastTheEndAreRefused) {
  const Bytes bytes = test_volume_bytes(small_volume(10, 1));
  const auto file = open_bytes(bytes);
  EXPECT_TRUE(file->read_bytes(bytes.size(), 0));
  EXPECT_FALSE(file->read_bytes(bytes.size(), 1));
  EXPECT_FALSE(file->read_bytes(1, ~std::uint64_t{0}));
  EXPECT_FALSE(file->read_bytes(~std::uint64_t{0}, 2));
}

// --- Writing.

TEST(Writer, ThePreambleOfManyAttributesFits) {
  const Bytes bytes = test_volume_bytes(small_volume(300, 200));
  const auto file = open_bytes(bytes);
  EXPECT_LE(file->preamble_bytes(), max_preamble_bytes);
  // Not only the metadata, but also the coarsest resolution.
  const DirectoryPage page = file->read_directory_page(0).value();
  const ChunkLocation& last = file->find_chunk(page, 0, file->rows().columns_of_row(0).back());
  EXPECT_GE(file->preamble_bytes(), last.offset + last.entry.packed_bytes);
  EXPECT_TRUE(file->verify([](double) {}));
}

TEST(Writer, ABillionPointsOfManyAttributesFit) {
  const TempFolder folder;
  for (const std::size_t attributes : {1, 20, 200}) {
    TestVolume volume = small_volume(300, attributes);
    volume.info.points_per_chunk.assign(volume.info.resolutions(), 4096);
    std::uint64_t points = 1'000'000'000;
    for (std::size_t r = volume.info.resolutions(); r-- > 0; points /= 3) volume.info.resolution_counts[r] = points;
    EXPECT_EQ(message_of(create_writer(volume, folder.path("large.svol"))), "");
  }
  EXPECT_THAT(folder.names(), testing::IsEmpty());
}

TEST(Writer, TooManyAttributesAreRefusedAndLeaveNothingBehind) {
  const TempFolder folder;
  TestVolume volume = small_volume(5, 1);
  const Attribute attribute = volume.info.attributes[0];
  for (int i = 1; i < 20000; ++i) {
    volume.info.attributes.push_back(attribute);
    volume.info.attributes.back().name = fmt::format("attribute {}", i);
    volume.info.columns.push_back({ColumnKind::value, ColumnScope::segment, i});
  }
  volume.tree.shape.attributes = 20000;
  volume.tree.summaries.assign(volume.tree.size() * 20000, ValueSummary{});
  EXPECT_THAT(create_writer(volume, folder.path("many.svol")),
              FailsWith(ErrorCode::unsupported, HasSubstr("20000 attributes")));
  EXPECT_THAT(folder.names(), testing::IsEmpty());
}

TEST(Writer, AbandonedItLeavesNothingBehind) {
  const TempFolder folder;
  const TestVolume volume = small_volume(100, 1);
  {
    const auto writer = value_of(create_writer(volume, folder.path("half.svol")));
    EXPECT_THAT(folder.names(), testing::IsEmpty());
    EXPECT_FALSE(writer->finish({{}}));  // rows are missing
  }
  EXPECT_THAT(folder.names(), testing::IsEmpty());
}

TEST(Writer, RefusesWhatDoesNotFit) {
  const TempFolder folder;
  const TestVolume good = small_volume(100, 1);
  const auto refuses = [&](auto change) {
    TestVolume volume = good;
    change(volume);
    const auto writer = create_writer(volume, folder.path("bad.svol"));
    return !writer && writer.error().code == ErrorCode::invalid_argument;
  };
  EXPECT_FALSE(refuses([](TestVolume&) {}));
  EXPECT_TRUE(refuses([](TestVolume& v) { v.info.points_per_chunk[0] = 0; }));
  EXPECT_TRUE(refuses([](TestVolume& v) { v.info.points_per_chunk.pop_back(); }));
  EXPECT_TRUE(refuses([](TestVolume& v) { v.info.columns.clear(); }));
  EXPECT_TRUE(refuses([](TestVolume& v) { v.info.resolution_counts.pop_back(); }));
  EXPECT_TRUE(refuses([](TestVolume& v) { v.info.size_bounds.clear(); }));
  EXPECT_TRUE(refuses([](TestVolume& v) { v.tree.counts.pop_back(); }));
  EXPECT_THAT(folder.names(), testing::IsEmpty());

  const auto writer = value_of(create_writer(good, folder.path("bad.svol")));
  EXPECT_FALSE(writer->append_row({}, {}));
}

TEST(Writer, RowsThatWerePackedBeforeAreTakenAsTheyAre) {
  const TempFolder folder;
  const TestVolume volume = small_volume(500, 2);
  const Bytes expected = test_volume_bytes(volume);
  const auto file = open_bytes(expected);
  const auto writer = value_of(create_writer(volume, folder.path("rows.svol")));
  for (std::uint64_t row = 0; row < file->rows().row_count(); ++row) {
    const DirectoryPage page = file->read_directory_page(file->directory_page_of_row(row)).value();
    std::vector<ChunkEntry> entries;
    Bytes bytes;
    for (const int column : file->rows().columns_of_row(row)) {
      const ChunkLocation& location = file->find_chunk(page, row, column);
      entries.push_back(location.entry);
      const auto chunk = std::span(expected).subspan(location.offset, location.entry.packed_bytes);
      bytes.insert(bytes.end(), chunk.begin(), chunk.end());
    }
    EXPECT_FALSE(writer->append_row(entries, std::span(bytes).first(bytes.size() - 1)));
    EXPECT_FALSE(writer->append_row(std::span(entries).first(entries.size() - 1), bytes));
    ASSERT_TRUE(writer->append_row(entries, bytes));
  }
  ASSERT_TRUE(writer->finish(file->read_histograms().value()));
  EXPECT_TRUE(bytes_of(folder.read("rows.svol")) == expected);
}

// Few rows are copied. Many are moved without copying, and the file has padding for it.
TEST(Writer, TheLastRowsMayBeInTheFileBefore) {
  const TempFolder folder;
  VolumeInfo info;
  info.points_per_chunk = {64};
  info.columns = {{ColumnKind::position, ColumnScope::segment, -1}, {ColumnKind::octant, ColumnScope::resolution, -1}};
  info.cube = {dvec3(0), 1};
  constexpr std::size_t chunk_bytes = 4097, row_bytes = 2 * chunk_bytes, first_rows = 3;
  const auto row_of = [](std::uint64_t row) { return Bytes(row_bytes, static_cast<std::byte>(row % 251)); };
  const auto entry_of = [](const Bytes& row) {
    return ChunkEntry{hash_bytes(std::span(row).first(chunk_bytes)), chunk_bytes, chunk_bytes, 0, 0, 0};
  };
  for (const std::uint64_t rows : {10, 2200}) {
    info.resolution_counts = {rows * 64};
    const std::string path = folder.path("rows.svol");
    auto file = value_of(AtomicFile::create(path));
    for (std::uint64_t row = first_rows; row < rows; ++row) ASSERT_TRUE(file.append(row_of(row)));
    auto pages = value_of(TempFile::create(folder.path()));
    PackedIndex index{{1, 1, 0}, {{0, 8, 8, 0}, Bytes(8)}, std::move(pages)};
    const auto writer =
        VolumeWriter::create(std::move(file), first_rows * row_bytes, info, std::move(index), folder.path());
    ASSERT_TRUE(writer) << writer.error().message;
    for (std::uint64_t row = 0; row < rows; ++row) {
      const Bytes bytes = row_of(row);
      const std::array entries = {entry_of(bytes), entry_of(bytes)};
      ASSERT_TRUE(row < first_rows ? (*writer)->append_row(entries, bytes) : (*writer)->add_written_row(entries));
    }
    ASSERT_TRUE((*writer)->finish({}));

    const Bytes all = bytes_of(folder.read("rows.svol"));
    const auto volume = value_of(Volume::open(open_file(path).value()));
    for (std::uint64_t row = 0; row < rows; ++row) {
      const DirectoryPage page = volume->read_directory_page(volume->directory_page_of_row(row)).value();
      const ChunkLocation& location = volume->find_chunk(page, row, 0);
      if (row == first_rows && rows > 1000) {
        EXPECT_EQ(location.offset % AtomicFile::insertable_bytes, 0u);
      }
      ASSERT_TRUE(std::ranges::equal(std::span(all).subspan(location.offset, row_bytes), row_of(row))) << row;
    }
    EXPECT_EQ(all.size(), (*writer)->file_bytes());
  }
}

// 19 MB of directory and 32 MB of index pages. The writer holds the directory root, and 1 MiB for copying.
TEST(Writer, HoldsLittleHoweverManyRowsThereAre) {
  const TempFolder folder;
  VolumeInfo info;
  info.points_per_chunk = {64};
  info.resolution_counts = {300'000 * 64};
  info.columns = {{ColumnKind::position, ColumnScope::segment, -1}, {ColumnKind::octant, ColumnScope::resolution, -1}};
  info.cube = {dvec3(0), 1};
  auto pages = value_of(TempFile::create(folder.path()));
  for (int i = 0; i < 32; ++i) ASSERT_TRUE(pages.append(Bytes(1u << 20)));
  PackedIndex index{{1, 1, 0}, {{0, 8, 8, 0}, Bytes(8)}, std::move(pages)};
  const std::array<ChunkEntry, 2> entries = {{{1, 1, 1, 0, 0, 0}, {2, 1, 1, 0, 0, 0}}};
  const Bytes bytes(2);

  start_counting_allocations();
  auto file = value_of(AtomicFile::create(folder.path("rows.svol")));
  const auto writer = value_of(VolumeWriter::create(std::move(file), 0, info, std::move(index), folder.path()));
  for (std::uint64_t row = 0; row < 300'000; ++row) ASSERT_TRUE(writer->append_row(entries, bytes));
  ASSERT_TRUE(writer->finish({}));
  EXPECT_LT(most_bytes_allocated(), 4u << 20);
  EXPECT_GT(writer->file_bytes(), (32u << 20) + 300'000 * (64 + 2));
}

TEST(Writer, AFolderThatIsNotThereIsNamed) {
  const TempFolder folder;
  const TestVolume volume = small_volume(5, 1);
  const std::string path = folder.path("absent/file.svol");
  EXPECT_THAT(create_writer(volume, path).error().message, HasSubstr(path));
}

std::string refusal_of(const TestVolume& volume) { return error_of(test_volume_bytes(volume)); }

// All checksums are right.
TEST(Verify, AnIndexThatLiesIsFound) {
  const auto points = random_points(300, 1);
  std::vector<double> values;
  for (const dvec3& p : points) values.push_back(p.x);
  const TestVolume sound = make_test_volume(points, {values});
  EXPECT_EQ(refusal_of(sound), "");
  for (std::size_t node = 0; node < sound.tree.size(); ++node) {
    for (int lie = 0; lie < 3; ++lie) {
      TestVolume lying = sound;
      ValueSummary& summary = lying.tree.summaries[node];
      if (lie == 0) summary.max = summary.min;
      if (lie == 1) summary.min = summary.max;
      if (lie == 2) summary.occupancy = 0;
      EXPECT_THAT(refusal_of(lying), testing::HasSubstr("of the index")) << node << ", " << lie;
    }
  }
  TestVolume swapped = sound;
  const auto [low, high] = std::ranges::minmax_element(swapped.positions, {}, &dvec3::x);
  std::swap(*low, *high);
  EXPECT_THAT(refusal_of(swapped), testing::HasSubstr("outside of its node"));
}

// More than one walk through the index takes.
TEST(Verify, AnIndexThatLiesAboutTheLastOfManyAttributesIsFound) {
  TestVolume volume = small_volume(100, 40);
  EXPECT_EQ(refusal_of(volume), "");
  volume.tree.summaries.back().occupancy = 0;
  EXPECT_THAT(refusal_of(volume), testing::HasSubstr("of the index"));
}

}  // namespace
}  // namespace splatvol::test
