#include "format/boundary.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "base/file.h"
#include "format/volume.h"
#include "tests/format/allocation_counter.h"
#include "tests/support/memory_source.h"
#include "tests/support/results.h"
#include "tests/support/surgery.h"
#include "tests/support/test_volume.h"
#include "tests/support/volume_bytes.h"

namespace splatvol::test {
namespace {

using namespace format;
using ::testing::HasSubstr;

// A square in the plane x = `x`, of side^2 quads, each two triangles. `reversed`: its points are in reverse order.
TriangleMesh square(std::uint32_t side, double x, bool reversed = false) {
  TriangleMesh mesh;
  const std::uint32_t row = side + 1;
  for (std::uint32_t j = 0; j < row; ++j)
    for (std::uint32_t i = 0; i < row; ++i)
      mesh.points.emplace_back(x, static_cast<double>(i) / side, static_cast<double>(j) / side);
  for (std::uint32_t j = 0; j < side; ++j)
    for (std::uint32_t i = 0; i < side; ++i) {
      const std::uint32_t a = i + row * j;
      mesh.triangles.push_back({a, a + 1, a + row});
      mesh.triangles.push_back({a + 1, a + row + 1, a + row});
    }
  if (!reversed) return mesh;
  const auto last = static_cast<std::uint32_t>(mesh.points.size() - 1);
  std::ranges::reverse(mesh.points);
  for (auto& triangle : mesh.triangles)
    for (std::uint32_t& corner : triangle) corner = last - corner;
  return mesh;
}

std::vector<Patch> patches() { return {{"inlet", square(4, 0, true)}, {"none", {}}, {"wall \"1\"", square(7, 3)}}; }

// The positions of all corners, triangle by triangle.
std::vector<dvec3> corners_of(const TriangleMesh& mesh) {
  std::vector<dvec3> corners;
  for (const auto& triangle : mesh.triangles)
    for (const std::uint32_t corner : triangle) corners.push_back(mesh.points[corner]);
  return corners;
}

double largest_distance(const std::vector<dvec3>& a, const std::vector<dvec3>& b) {
  EXPECT_EQ(a.size(), b.size());
  double largest = 0;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i) largest = std::max(largest, glm::length(a[i] - b[i]));
  return largest;
}

Bytes file_with(const std::vector<Patch>& patches, double error = 0) {
  TestVolume volume = make_test_volume(random_points(100, 3), {std::vector<double>(100, 1.0)});
  auto packed = value_of(pack_boundary(patches, error));
  volume.info.boundary = packed.info;
  volume.boundary = packed.section;
  return test_volume_bytes(volume);
}

Result<std::shared_ptr<const Volume>> open(const Bytes& bytes) { return Volume::open(memory_source(bytes, "a.svol")); }

TEST(Boundary, ComesBackWithinItsError) {
  const Bytes file = file_with(patches());
  ASSERT_FALSE(file.empty());
  ASSERT_EQ(error_of(file), "");
  const auto volume = open(file).value();
  const BoundaryInfo& info = *volume->info().boundary;
  ASSERT_EQ(info.patches.size(), 3u);
  EXPECT_EQ(info.patches[2], (PatchInfo{"wall \"1\"", 64, 98}));
  EXPECT_EQ(info.patches[1], (PatchInfo{"none", 0, 0}));
  EXPECT_GT(info.error, 0);
  EXPECT_LT(info.error, 1e-6);
  for (std::size_t patch = 0; patch < 3; ++patch) {
    const auto mesh = value_of(volume->read_boundary({&patch, 1}));
    EXPECT_LE(largest_distance(corners_of(mesh), corners_of(patches()[patch].mesh)), info.error);
  }
  const std::size_t both[] = {2, 0};
  const auto joined = value_of(volume->read_boundary(both));
  EXPECT_EQ(joined.triangles.size(), 98u + 32u);
  EXPECT_EQ(joined.points.size(), 64u + 25u);
  EXPECT_EQ(corners_of(joined).back().x, 0);
  const std::size_t all[] = {0, 1, 2}, turned[] = {2, 1, 0};
  const std::uint64_t read = volume->bytes_read();
  EXPECT_EQ(corners_of(*volume->read_boundary(all)).back().x, 3);
  EXPECT_EQ(corners_of(*volume->read_boundary(turned)), corners_of(joined));
  EXPECT_EQ(volume->bytes_read(), read) << "the first read has all of a small file";
  const std::size_t other = 3;
  EXPECT_THAT(volume->read_boundary({&other, 1}).error().message, HasSubstr("no patch 3"));
}

// Triangles that have no outside come last, so that a number tells which ones they are.
TEST(Boundary, TwoSidedTrianglesComeLast) {
  const std::vector<Patch> plain = patches();
  std::vector<Patch> some = plain;
  const std::size_t count = some[2].mesh.triangles.size();
  for (std::size_t i = 0; i < count; ++i) some[2].mesh.two_sided.push_back(i % 7 == 3);
  some[0].mesh.two_sided.assign(some[0].mesh.triangles.size(), false);
  const Bytes file = file_with(some);
  ASSERT_EQ(error_of(file), "");
  const auto volume = open(file).value();
  EXPECT_EQ(volume->info().boundary->patches[0].two_sided, 0U);
  EXPECT_EQ(volume->info().boundary->patches[2].two_sided, count / 7);
  const std::size_t all[] = {0, 1, 2}, turned[] = {2, 0};
  const auto mesh = value_of(volume->read_boundary(all)), other = value_of(volume->read_boundary(turned));
  const std::size_t first = mesh.triangles.size() - count;
  const auto places = [&](const TriangleMesh& from, bool two_sided) {
    std::vector<double> sums;
    for (std::size_t i = 0; i < from.triangles.size(); ++i)
      if (from.is_two_sided(i) == two_sided && middle_of(from, i).x > 2)
        sums.push_back(middle_of(from, i).y + 100 * middle_of(from, i).z);
    std::ranges::sort(sums);
    return sums;
  };
  for (const bool two_sided : {false, true}) {
    EXPECT_THAT(places(mesh, two_sided),
                ::testing::Pointwise(::testing::DoubleNear(1e-4), places(some[2].mesh, two_sided)));
    EXPECT_EQ(places(other, two_sided), places(mesh, two_sided));
  }
  for (std::size_t i = 0; i < first; ++i) EXPECT_FALSE(mesh.is_two_sided(i));
  EXPECT_TRUE(value_of(volume->read_boundary(std::span(all).first(1))).two_sided.empty());
  EXPECT_EQ(read_record<Superblock>(file, 0).minor_version, 3);
  // Without such triangles the file is as it was before they were known.
  some[2].mesh.two_sided.assign(count, false);
  EXPECT_EQ(file_with(some), file_with(plain));
}

TEST(Boundary, IsReadOnDemandOnly) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(0, 1);
  TriangleMesh large;
  for (std::uint32_t i = 0; i < 30000; ++i) {
    large.points.emplace_back(uniform(random), uniform(random), uniform(random));
    if (i % 3 == 2) large.triangles.push_back({i - 2, i - 1, i});
  }
  const Bytes file = file_with({{"large", large}, {"small", square(2, 3)}});
  ASSERT_GT(file.size(), std::size_t{200} << 10);
  const auto volume = open(file).value();
  const std::uint64_t opened = volume->bytes_read();
  EXPECT_LE(opened, std::uint64_t{32} << 10);
  const std::size_t small = 1;
  ASSERT_TRUE(volume->read_boundary({&small, 1}));
  EXPECT_LT(volume->bytes_read() - opened, 500u);
  const std::size_t both[] = {0, 1};
  const auto joined = value_of(volume->read_boundary(both));
  EXPECT_EQ(joined.triangles.size(), 10000u + 8u);
}

TEST(Boundary, CoarserTrianglesTakeFewerBytes) {
  const auto fine = pack_boundary(patches(), 0), coarse = pack_boundary(patches(), 0.1);
  ASSERT_TRUE(fine && coarse);
  EXPECT_LT(coarse->section.size(), fine->section.size());
  EXPECT_NEAR(coarse->info.error, 0.1, 0.1 / 8);
  EXPECT_GE(coarse->info.error, 0.1);
}

// Patches of one place stay there.
TEST(Boundary, CommonEdgesStayCommon) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(-1e5, 1e5);
  std::vector<Patch> both(2);
  both[0].name = "a";
  both[1].name = "b";
  for (std::uint32_t i = 0; i < 300; ++i) {
    const dvec3 p(uniform(random), uniform(random), uniform(random));
    both[0].mesh.points.push_back(p);
    both[1].mesh.points.insert(both[1].mesh.points.begin(), p);
  }
  for (std::uint32_t i = 0; i + 2 < 300; ++i)
    for (Patch& patch : both) patch.mesh.triangles.push_back({i, i + 1, i + 2});
  const auto volume = open(file_with(both, 1e-3)).value();
  const std::size_t first = 0, second = 1;
  const auto a = volume->read_boundary({&first, 1}).value(), b = volume->read_boundary({&second, 1}).value();
  for (std::uint32_t i = 0; i < 300; ++i) EXPECT_EQ(a.points[i], b.points[299 - i]);
}

TEST(Boundary, OfOnePointOrALine) {
  TriangleMesh point{{dvec3(1, 2, 3)}, {{0, 0, 0}}};
  const Bytes file = file_with({{"point", point}});
  EXPECT_EQ(error_of(file), "");
  const std::size_t first = 0;
  EXPECT_EQ(open(file).value()->read_boundary({&first, 1})->points.at(0), dvec3(1, 2, 3));
}

TEST(Boundary, FilesWithoutOneAreOfTheFirstVersion) {
  const TestVolume plain = make_test_volume(random_points(50, 3), {std::vector<double>(50, 1.0)});
  const auto version = [](const Bytes& file) { return read_record<Superblock>(file, 0).minor_version; };
  EXPECT_EQ(version(test_volume_bytes(plain)), 0);
  EXPECT_EQ(version(file_with(patches())), 1);
}

TEST(Boundary, WhatCannotBeStoredIsRefused) {
  EXPECT_THAT(pack_boundary({}, 0).error().message, HasSubstr("0 patches"));
  EXPECT_THAT(pack_boundary(std::vector<Patch>{{"a", {}}, {"a", {}}}, 0).error().message, HasSubstr("\"a\""));
  EXPECT_THAT(pack_boundary(std::vector<Patch>(5000), 0).error().message, HasSubstr("5000 patches"));
  TestVolume volume = make_test_volume(random_points(50, 3), {std::vector<double>(50, 1.0)});
  volume.info.boundary = pack_boundary(patches(), 0)->info;
  EXPECT_TRUE(test_volume_bytes(volume).empty()) << "described, and not there";
}

// Hashes are right in all of these.
struct DamagedBoundary : testing::Test {
  Bytes harmed(Part part, std::size_t index, const std::function<void(Bytes&)>& harm) const {
    return Dissected(file_).harmed(part, index, harm);
  }
  void expect_refused(const Bytes& file, const std::string& words) const {
    const std::string message = error_of(file);
    EXPECT_THAT(message, HasSubstr(words));
    EXPECT_EQ(message.find('\n'), std::string::npos);
  }
  template <class T>
  static std::function<void(Bytes&)> put(std::size_t offset, T number) {
    return [=](Bytes& bytes) { std::memcpy(bytes.data() + offset, &number, sizeof(number)); };
  }

  const Bytes file_ = file_with(patches());
};

TEST_F(DamagedBoundary, IsWholeWhenNothingIsDone) {
  EXPECT_EQ(error_of(harmed(Part::superblock, 0, [](Bytes&) {})), "");
  EXPECT_EQ(Dissected(file_).count(Part::patch), 3u);
}

TEST_F(DamagedBoundary, TablesFollowTheirRules) {
  expect_refused(harmed(Part::patch_table, 0, put<std::uint32_t>(12, 5)), "a patch has the wrong length [R21]");
  expect_refused(harmed(Part::patch_table, 0, put<std::uint32_t>(8, 7)), "tile their section [R21]");
  expect_refused(harmed(Part::patch_table, 0, put<std::uint64_t>(0, 7)), "patch \"inlet\": checksum mismatch");
  expect_refused(harmed(Part::patch_table, 0, [](Bytes& table) { table.resize(16); }), "checksum mismatch [R21]");
}

TEST_F(DamagedBoundary, NumbersAreInTheirRanges) {
  const std::size_t points = 64, codes = 12 * points;
  const auto byte = [](std::size_t offset, unsigned value) { return put(offset, static_cast<std::uint8_t>(value)); };
  // The first point's x: planes of its four bytes.
  expect_refused(harmed(Part::patch, 2, byte(0, 1)), "a position is out of range [R21]");
  expect_refused(harmed(Part::patch, 2, byte(codes, 1)), "names a point that is not there [R21]");
  expect_refused(harmed(Part::patch, 2, byte(codes + 2, 1)), "no triangle names a point [R21]");
}

TEST_F(DamagedBoundary, MetadataFollowTheirRules) {
  expect_refused(harmed(Part::metadata, 0, replacing("\"boundary\"", "\"x-oundary\"")), "boundary [R21]");
  expect_refused(harmed(Part::metadata, 0, replacing("\"wall \\\"1\\\"\"", "\"inlet\"")), "'inlet' appears twice [R9]");
  expect_refused(harmed(Part::metadata, 0, replacing("\"points\":64", "\"points\":63")), "wrong length [R21]");
  expect_refused(harmed(Part::metadata, 0, replacing("\"points\":64", "\"points\":400")), "too many points [R9]");
  expect_refused(harmed(Part::metadata, 0, replacing("\"triangles\":98", "\"triangles\":4000000000")), "[R9]");
  const auto with = [&](const std::string& more) {
    return harmed(Part::metadata, 0, replacing("\"triangles\":98", "\"triangles\":98," + more));
  };
  for (const char* wrong : {"99", "-1", "1.5", "null", "[]", "\"1\"", "18446744073709551615"})
    expect_refused(with(std::string("\"two_sided\":") + wrong), "two_sided");
  EXPECT_EQ(error_of(with("\"two_sided\":98")), "") << "of any minor version";
  EXPECT_EQ(error_of(with("\"two_sidedness\":99")), "") << "what a reader does not know is skipped";
  expect_refused(harmed(Part::metadata, 0, replacing("\"quantisation_step\":", "\"quantisation_step\":-")), "[R9]");
}

TEST_F(DamagedBoundary, CannotClaimManyTriangles) {
  const Bytes file = harmed(Part::metadata, 0, replacing("\"triangles\":98", "\"triangles\":300000000"));
  start_counting_allocations();
  EXPECT_NE(error_of(file), "");
  EXPECT_LT(most_bytes_allocated(), std::size_t{16} << 20);
}

// A file whose only patch has so many triangles between 200 points. Its frame is near the ratio that R7 allows.
Bytes file_of_many(std::uint32_t triangles) {
  constexpr std::uint32_t points = 200;
  Bytes payload(12 * (points + std::size_t{triangles}));
  const auto codes = std::span(payload).subspan(12 * points, 3 * std::size_t{triangles});
  std::fill(codes.begin() + points, codes.end(), std::byte{1});
  std::mt19937 random(3);
  for (std::size_t i = points; i < codes.size(); i += 300) codes[i] = static_cast<std::byte>(1 + random() % points);
  return Dissected(file_with({{"one", square(1, 0)}})).assemble([&](Part part, std::size_t, Bytes& bytes) {
    if (part == Part::patch) bytes = payload;
    if (part == Part::metadata)
      replacing(R"("points":4,"triangles":2)", fmt::format(R"("points":{},"triangles":{})", points, triangles))(bytes);
  });
}

TEST(HugeBoundary, IsCheckedInLittleMemory) {
  const Bytes file = file_of_many(5'000'000);
  EXPECT_LT(file.size(), std::size_t{1} << 20);
  const auto volume = open(file).value();
  start_counting_allocations();
  EXPECT_EQ(message_of(volume->verify([](double) {})), "");
  EXPECT_LT(most_bytes_allocated(), std::size_t{8} << 20);

  const std::size_t first = 0;
  start_counting_allocations();
  EXPECT_EQ(volume->read_boundary({&first, 1})->triangles.size(), 5'000'000U);
  EXPECT_LT(most_bytes_allocated(), std::size_t{66} << 20) << "the mesh, and little besides";
}

TEST(HugeBoundary, ComesBackAsItWas) {
  const TriangleMesh large = square(1050, 3);
  const Bytes file = file_with({{"small", square(2, 1)}, {"large", large}});
  const auto volume = open(file).value();
  ASSERT_GT(payload_bytes(volume->info().boundary->patches[1]), std::uint64_t{1} << 25);
  const std::size_t both[] = {0, 1};
  const auto joined = value_of(volume->read_boundary(both));
  std::vector<dvec3> corners = corners_of(joined);
  corners.erase(corners.begin(), corners.begin() + 24);
  EXPECT_LE(largest_distance(corners, corners_of(large)), volume->info().boundary->error);
  EXPECT_EQ(error_of(file), "");
}

TEST_F(DamagedBoundary, EachFlippedByteAndCutIsFound) {
  const auto volume = open(file_).value();
  const auto section = std::ranges::find(volume->sections(), SectionKind::boundary, &SectionEntry::kind);
  ASSERT_NE(section, volume->sections().end());
  for (std::uint64_t at = section->offset; at < section->offset + section->packed_bytes; ++at) {
    Bytes flipped = file_;
    flipped[at] ^= std::byte{0x10};
    EXPECT_NE(error_of(flipped), "") << at;
    const auto opened = open(flipped);
    ASSERT_TRUE(opened) << "a viewer that shows no boundary reads no byte of it";
    const std::size_t all[] = {0, 1, 2};
    EXPECT_FALSE((*opened)->read_boundary(all)) << at;
  }
  for (std::uint64_t size = section->offset; size < file_.size(); size += 7)
    EXPECT_FALSE(open(Bytes(file_.begin(), file_.begin() + static_cast<std::ptrdiff_t>(size))));
}

}  // namespace
}  // namespace splatvol::test
