// How many bytes a build holds: counts what operator new returns.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "base/file.h"
#include "builder/pipeline/build.h"
#include "builder/pipeline/memory_plan.h"
#include "builder/points/point_stream.h"
#include "builder/sources/generator.h"
#include "tests/builder/support/meshes.h"
#include "tests/builder/support/piece_source.h"
#include "tests/builder/support/point_sets.h"
#include "tests/format/allocation_counter.h"
#include "tests/support/long.h"
#include "tests/support/results.h"

namespace splatvol::test {
namespace {

double field(const dvec3& p, std::size_t attribute) {
  const double k = 1 + static_cast<double>(attribute % 7);
  return std::sin(k * p.x) + p.y * p.z + static_cast<double>(attribute);
}

// Values that take no memory, as those in a reader's own arrays.
class FieldValues final : public LentValues {
 public:
  explicit FieldValues(std::vector<dvec3> points) : points_(std::move(points)) {}
  void get(std::size_t attribute, std::span<const std::uint32_t> points, std::span<double> values) const override {
    for (std::size_t i = 0; i < points.size(); ++i) values[i] = field(points_[points[i]], attribute);
  }

  std::uint64_t bytes() const override { return points_.size() * sizeof(dvec3); }

 private:
  std::vector<dvec3> points_;
};

// Pieces of many attributes.
class ManyAttributes final : public Source {
 public:
  ManyAttributes(std::vector<Piece> pieces, std::size_t attributes, bool may_lend = true)
      : pieces_(std::move(pieces)), may_lend_(may_lend) {
    for (std::size_t a = 0; a < attributes; ++a) attributes_.push_back("a" + std::to_string(a));
  }
  const std::vector<std::string>& attributes() const override { return attributes_; }
  void lend_values() override { lends_ = may_lend_; }
  std::size_t piece_count() const override { return pieces_.size(); }
  Result<std::unique_ptr<Piece>> next() override {
    if (next_ == pieces_.size()) return nullptr;
    auto piece = std::make_unique<Piece>(pieces_[next_++]);
    piece->values.clear();
    if (lends_) piece->lent = std::make_shared<FieldValues>(piece->points);
    for (std::size_t a = 0; a < attributes_.size() && !lends_; ++a) {
      piece->values.emplace_back().reserve(piece->points.size());
      for (const dvec3& p : piece->points) piece->values.back().push_back(field(p, a));
    }
    return piece;
  }

 private:
  std::vector<Piece> pieces_;
  std::vector<std::string> attributes_;
  bool may_lend_;
  bool lends_ = false;
  std::size_t next_ = 0;
};

// Bytes of a piece, with what its reader would hold: points twice, and the tetrahedra at each point.
std::size_t piece_bytes(const std::vector<Piece>& pieces) {
  std::size_t most = 0;
  for (const Piece& piece : pieces)
    most = std::max(most, 2 * sizeof(dvec3) * piece.points.size() + sizeof(Tetrahedron) * piece.tetrahedra.size() +
                              VertexMaterial::bytes(piece.points.size(), piece.tetrahedra.size()));
  return most;
}

struct Built {
  std::size_t most_bytes = 0;
  BuildReport report;
};

Built build(const std::vector<Piece>& pieces, std::size_t attributes, BuildOptions options, const std::string& path) {
  ManyAttributes source(pieces, attributes);
  start_counting_allocations();
  auto report = value_of(build_volume(source, path, options, [](const char*, double) {}));
  return {most_bytes_allocated(), std::move(report)};
}

// Whatever the attributes, a build holds its memory, a piece and some hundred KiB. Files are the same.
TEST(HeldBytes, AreBoundedForAnyNumberOfAttributes) {
  const tbb::global_control control(tbb::global_control::max_allowed_parallelism, 2);
  const std::string path = testing::TempDir() + "held.svol";
  const Piece mesh = mesh_piece(jittered(18, 0.2), [](const dvec3& p) { return p.x; });
  for (const auto& pieces : {std::vector{mesh}, cut(mesh, 3)})
    for (const std::size_t attributes : sample_of<std::size_t>({20, 1, 80})) {
      std::string expected;
      for (const std::uint64_t memory : {std::uint64_t{256} << 20, std::uint64_t{32} << 20, std::uint64_t{1}}) {
        const Built built = build(pieces, attributes, {.memory = memory}, path);
        const std::uint64_t granted = std::max(memory, built.report.least_memory);
        EXPECT_LE(built.most_bytes, granted + piece_bytes(pieces) + (std::size_t{2} << 20))
            << attributes << " attributes, " << memory << " bytes";
        if (expected.empty()) expected = *read_text_file(path);
        EXPECT_TRUE(*read_text_file(path) == expected) << attributes << " attributes, " << memory << " bytes";
      }
    }
}

// Thousands of overlapping cells round one vertex: their splats all meet each other.
TEST(HeldBytes, OfCellsRoundOneVertexAreBounded) {
  const std::uint32_t count = is_long() ? 330'000 : 33'000;
  Mesh mesh{uniform_points(static_cast<int>(count)), {}};
  std::mt19937 random(3);
  std::uniform_int_distribution<std::uint32_t> other(1, count - 1);
  while (mesh.tetrahedra.size() < count / 33 * 6) {
    const Tetrahedron corners{0, other(random), other(random), other(random)};
    if (corners[1] != corners[2] && corners[2] != corners[3] && corners[3] != corners[1])
      mesh.tetrahedra.push_back(corners);
  }
  const std::vector<Piece> pieces = {mesh_piece(mesh, [](const dvec3& p) { return p.x; })};
  const std::uint64_t memory = std::uint64_t{256} << 20;
  const Built built = build(pieces, 1, {.memory = memory, .keep_cells = true}, testing::TempDir() + "held_fan.svol");
  EXPECT_LE(built.report.least_memory, memory);
  // Kept cells have buffers, too: 5 MiB were measured.
  EXPECT_LE(built.most_bytes, memory + piece_bytes(pieces) + (std::size_t{8} << 20));
}

// Cells are found in one subdomain at a time if the memory has no room for more.
TEST(HeldBytes, OfSampledCellsAreBounded) {
  const std::string path = testing::TempDir() + "held_cells.svol";
  std::string expected;
  for (const std::uint64_t memory : {std::uint64_t{64} << 20, std::uint64_t{1}}) {
    const auto source = generate_points({is_long() ? 300'000u : 60'000u, Distribution::clusters, 1, false});
    start_counting_allocations();
    const auto report = value_of(build_volume(*source, path, {.memory = memory, .connectivity = Connectivity::none},
                                              [](const char*, double) {}));
    // The sorted points keep a part of the memory, too.
    EXPECT_LE(most_bytes_allocated(), std::max(memory, report.least_memory) + (std::size_t{14} << 20)) << memory;
    if (expected.empty()) expected = *read_text_file(path);
    EXPECT_TRUE(*read_text_file(path) == expected) << memory;
  }
}

TEST(HeldBytes, OfAPieceAreCounted) {
  const Piece mesh = mesh_piece(jittered(30, 0.2), [](const dvec3& p) { return p.x; });
  for (const bool lends : {false, true}) {
    ManyAttributes source({mesh}, 80, lends);
    start_counting_allocations();
    const auto points = value_of(PointStream::create(
        source, true, std::size_t{8} << 20, testing::TempDir(), [](double) {}, false));
    const std::uint64_t values = lends ? 0 : 80 * mesh.points.size() * sizeof(double);
    EXPECT_GE(points.summary().bytes_to_read, values);
    EXPECT_LE(most_bytes_allocated(), points.summary().bytes_to_read + (std::size_t{2} << 20)) << lends;
  }
}

// Lent values give the same file as values of the piece.
TEST(HeldBytes, LentValuesGiveTheSameFile) {
  const std::string lent = testing::TempDir() + "lent.svol", own = testing::TempDir() + "own.svol";
  const Piece mesh = mesh_piece(jittered(9, 0.2), [](const dvec3& p) { return field(p, 0); });
  ManyAttributes lends({mesh}, 3), copies({mesh}, 3, false);
  ASSERT_TRUE(build_volume(lends, lent, {}, [](const char*, double) {}));
  ASSERT_TRUE(build_volume(copies, own, {}, [](const char*, double) {}));
  EXPECT_TRUE(*read_text_file(lent) == *read_text_file(own));
}

TEST(MemoryPlan, LittleMemoryGivesSmallBatchesAndLeastTellsWhatTheyTake) {
  BuildShape shape{.attributes = 27, .gradients = false, .estimates = false, .index_leaf_points = 512};
  const MemoryPlan large = plan_memory(std::uint64_t{8} << 30, shape), small = plan_memory(1, shape);
  EXPECT_EQ(large.batches.points, 4096u);
  EXPECT_EQ(small.batches.points, 64u);
  EXPECT_EQ(small.most_batches, 2u);
  EXPECT_EQ(small.least, large.least);
  EXPECT_LT(small.least, std::uint64_t{64} << 20);
  const MemoryPlan enough = plan_memory(small.least, shape);
  EXPECT_LE(enough.rows, small.least / 4);
  shape.attributes = 100;
  EXPECT_GT(plan_memory(1, shape).least, small.least);
  shape.gradients = true;
  EXPECT_GT(plan_memory(1, shape).least, plan_memory(1, {.attributes = 100, .index_leaf_points = 512}).least);
}

}  // namespace
}  // namespace splatvol::test
