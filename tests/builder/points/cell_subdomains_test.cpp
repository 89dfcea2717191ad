// Voronoi cells in subdomains, beside those of all points at once.
#include "builder/points/cell_subdomains.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "builder/scattered/voronoi_cell.h"
#include "builder/sources/generator.h"
#include "tests/builder/support/piece_source.h"
#include "tests/builder/support/point_sets.h"
#include "tests/support/results.h"

namespace splatvol::test {
namespace {

using Points = std::vector<dvec3>;

constexpr std::uint64_t memory = std::uint64_t{1} << 26;

PointBatch empty_batch() {
  PointBatch batch;
  batch.resize_attributes(1);
  return batch;
}

PointBatch read_all(const std::function<Result<bool>(PointBatch&)>& next) {
  PointBatch all = empty_batch();
  while (value_of(next(all))) {
  }
  return all;
}

PointStream stream_of(Source& source) {
  return value_of(PointStream::create(source, false, memory, std::filesystem::temp_directory_path(), [](double) {}));
}

PointBatch in_subdomains(const std::unique_ptr<Source>& source, std::size_t subdomain_points,
                         std::uint64_t bytes = memory) {
  PointStream stream = stream_of(*source);
  auto subdomains =
      value_of(CellSubdomains::create(stream, bytes, std::filesystem::temp_directory_path(), subdomain_points));
  return read_all([&](PointBatch& batch) { return subdomains.next(batch); });
}

PointBatch without_material(const std::unique_ptr<Source>& source) {
  PointStream stream = stream_of(*source);
  return read_all([&](PointBatch& batch) { return stream.next(batch); });
}

std::unique_ptr<Source> source_of(const Points& points) {
  return std::make_unique<PieceSource>(std::vector{scattered(points)});
}

std::unique_ptr<Source> generated(Distribution distribution, std::uint64_t count = 8000) {
  return generate_points({count, distribution, 1, false});
}

// The Voronoi cells of all points at once: each is cut by every other point, until no other can matter.
class ExactCells {
 public:
  explicit ExactCells(const Points& positions)
      : positions_(positions), own_(positions.size()), neighbours_(positions.size()), moments_(positions.size()) {
    for (const dvec3& p : positions) domain_.include(p);
    const double margin = 4 * glm::length(domain_.extent());
    domain_ = {domain_.low - margin, domain_.high + margin};
    const auto count = static_cast<std::uint32_t>(positions.size());
    tbb::parallel_for(0U, count, [&](std::uint32_t i) { find(i); });
    tbb::parallel_for(0U, count, [&](std::uint32_t i) { usual_[i] = usual_of(i); });
    tbb::parallel_for(0U, count, [&](std::uint32_t i) { make(i); });
  }

  [[nodiscard]] const std::vector<SpatialMoments>& moments() const { return moments_; }

 private:
  // Near points first: they come from a heap.
  void find(std::uint32_t point) {
    std::vector<std::pair<double, std::uint32_t>> others;
    for (std::uint32_t i = 0; i < positions_.size(); ++i)
      if (i != point) others.emplace_back(squared_length(positions_[i] - positions_[point]), i);
    std::ranges::make_heap(others, std::greater());
    ConvexCell cell;
    cell.reset(domain_.low - positions_[point], domain_.high - positions_[point]);
    while (!others.empty() && others.front().first < 4 * farthest_squared(cell)) {
      const auto [square, other] = others.front();
      cell.clip(positions_[other] - positions_[point], square / 2, other);
      std::ranges::pop_heap(others, std::greater());
      others.pop_back();
    }
    std::vector<double> items;
    own_[point] = usual_radius(cell, items);
    for (const auto& face : cell.faces())
      if (face.label != ConvexCell::no_label) neighbours_[point].push_back(face.label);
  }

  [[nodiscard]] double usual_of(std::uint32_t point) const {
    std::vector<double> items = {own_[point]};
    for (const std::uint32_t neighbour : neighbours_[point]) items.push_back(own_[neighbour]);
    return quantile(items, 0.25);
  }

  void make(std::uint32_t point) {
    ConvexCell cell;
    make_cell(positions_, point, neighbours_[point], domain_, cell);
    trim(cell, usual_, usual_[point]);
    moments_[point] = cell.moments();
  }

  const Points& positions_;
  Box domain_;
  std::vector<double> own_, usual_ = std::vector<double>(positions_.size());  // distances of a cell's vertices
  std::vector<std::vector<std::uint32_t>> neighbours_;
  std::vector<SpatialMoments> moments_;
};

// Shares of the points whose mass and centroid are far from the exact ones, and the ratio of all mass to the exact one.
struct Deviation {
  double median_mass, far_mass, far_centroid, total;
};

Deviation compare(const std::unique_ptr<Source>& source, const std::unique_ptr<Source>& again,
                  std::size_t subdomain_points) {
  const PointBatch parts = in_subdomains(source, subdomain_points), all = without_material(again);
  EXPECT_EQ(parts.positions, all.positions);
  EXPECT_EQ(parts.keys, all.keys);
  const ExactCells whole(all.positions);
  std::vector<double> errors;
  double far_mass = 0, far_centroid = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const SpatialMoments &a = parts.moments[i], &b = whole.moments()[i];
    EXPECT_TRUE(std::isfinite(a.mass) && a.mass >= 0) << i;
    EXPECT_TRUE(std::isfinite(parts.value_moments[0][i].mean));
    EXPECT_EQ(a.mass == 0, b.mass == 0) << i;
    const double size = std::sqrt(b.covariance.xx + b.covariance.yy + b.covariance.zz);
    errors.push_back(std::abs(a.mass / b.mass - 1));
    far_mass += errors.back() > 0.1 ? 1 : 0;
    far_centroid += glm::length(a.centroid - b.centroid) > 0.1 * size ? 1 : 0;
  }
  std::ranges::nth_element(errors, errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2));
  const auto count = static_cast<double>(all.size());
  return {errors[errors.size() / 2], far_mass / count, far_centroid / count,
          total_mass(parts.moments) / total_mass(whole.moments())};
}

TEST(CellSubdomains, CellsAreNearlyTheExactOnes) {
  struct Case {
    Distribution distribution;
    double median, far, total;
  };
  // Measured: .008, .10 and 1.01 for uniform points, and all mass 1.36 for the vortex. Where sparse points end is a
  // matter of taste: their outer cells are large, and their neighbours' trimming follows.
  for (const auto& [distribution, median, far, total] :
       {Case{Distribution::uniform, 0.015, 0.15, 0.03}, Case{Distribution::vortex, 0.04, 0.45, 0.4},
        Case{Distribution::clusters, 0.03, 0.4, 0.05}, Case{Distribution::half_tiny, 0.02, 0.2, 0.03}}) {
    SCOPED_TRACE(distribution_names()[static_cast<std::size_t>(distribution)]);
    const Deviation d = compare(generated(distribution), generated(distribution), 700);
    EXPECT_LT(d.median_mass, median);
    EXPECT_LT(d.far_mass, far);
    EXPECT_LT(d.far_centroid, far);
    EXPECT_NEAR(d.total, 1, total);
  }
}

TEST(CellSubdomains, LatticesFarFromTheOriginHaveTheirCells) {
  for (const double thin : {1.0, 1e-3, 1e-6}) {
    Points points;
    for (int i = 0; i < 14; ++i)
      for (int j = 0; j < 14; ++j)
        for (int k = 0; k < 14; ++k) points.push_back(dvec3(1e6, -1e6, 0) + dvec3(i, j, thin * k));
    const Deviation d = compare(source_of(points), source_of(points), 300);
    EXPECT_LT(d.median_mass, 0.02) << thin;
    EXPECT_NEAR(d.total, 1, 0.06) << thin;  // a third of the points are outer ones, which are trimmed otherwise
  }
}

// Each subdomain by itself is worthless: the neighbours of all points lie in others.
TEST(CellSubdomains, LookAcrossTheirBorders) {
  const PointBatch few = in_subdomains(generated(Distribution::uniform), 50);
  const PointBatch many = in_subdomains(generated(Distribution::uniform), 5000);
  std::size_t different = 0;
  for (std::size_t i = 0; i < few.size(); ++i)
    different += std::abs(few.moments[i].mass / many.moments[i].mass - 1) > 0.1 ? 1 : 0;
  EXPECT_LE(different, few.size() / 8);
}

TEST(CellSubdomains, DoNotDependOnThreadsOrMemory) {
  const auto find = [](std::uint64_t bytes) { return in_subdomains(generated(Distribution::clusters), 900, bytes); };
  const PointBatch many = find(std::uint64_t{1} << 30);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const PointBatch single = find(1);
  ASSERT_EQ(many.positions, single.positions);
  for (std::size_t i = 0; i < many.size(); ++i) {
    ASSERT_EQ(many.moments[i].mass, single.moments[i].mass);
    ASSERT_EQ(many.moments[i].centroid, single.moments[i].centroid);
    ASSERT_EQ(many.value_moments[0][i].variance, single.value_moments[0][i].variance);
    ASSERT_EQ(many.gradients[0][i], single.gradients[0][i]);
  }
}

TEST(CellSubdomains, SurvivePointsWithoutAVolume) {
  Points plane;
  for (int i = 0; i < 50; ++i)
    for (int j = 0; j < 50; ++j)
      plane.push_back(0.05 * i * glm::normalize(dvec3(1, 2, 3)) + 0.05 * j * glm::normalize(dvec3(3, 0, -1)));
  const double mass = total_mass(in_subdomains(source_of(plane), 500).moments);
  EXPECT_GT(mass, 2.45 * 2.45 * 0.01);
  EXPECT_LT(mass, 2.55 * 2.55 * 0.2);
  for (const Distribution distribution : {Distribution::line, Distribution::layer, Distribution::two_clusters}) {
    const PointBatch points = in_subdomains(generated(distribution, 2000), 300);
    ASSERT_EQ(points.size(), 2000u);
    EXPECT_GT(total_mass(points.moments), 0);
    for (const SpatialMoments& m : points.moments) ASSERT_TRUE(std::isfinite(m.mass) && std::isfinite(m.covariance.xy));
  }
  const PointBatch single = in_subdomains(source_of({dvec3(1e5)}), 300);
  ASSERT_EQ(single.size(), 1u);
  EXPECT_GT(single.moments[0].mass, 0);
}

TEST(CellSubdomains, CoincidentPointsShareNothingAndKeepTheirValues) {
  Points points(3000, dvec3(0.5));
  Piece piece = scattered(points);
  for (std::size_t i = 0; i < points.size(); ++i) piece.values[0][i] = static_cast<double>(i);
  const PointBatch found = in_subdomains(std::make_unique<PieceSource>(std::vector{piece}), 300);
  ASSERT_EQ(found.size(), points.size());
  std::vector<bool> seen(points.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    EXPECT_EQ(found.moments[i].mass > 0, i == 0);
    seen[static_cast<std::size_t>(found.values[0][i])] = true;
  }
  EXPECT_EQ(std::ranges::count(seen, false), 0);
}

TEST(CellSubdomains, MissingValuesHaveNoMassAndDoNotSpread) {
  Piece piece = scattered([] {
    Points points;
    for (int i = 0; i < 1000; ++i) points.emplace_back(i % 10, i / 10 % 10, i / 100);
    return points;
  }());
  for (std::size_t i = 0; i < piece.points.size(); ++i)
    piece.values[0][i] = i % 7 == 0 ? std::numeric_limits<double>::quiet_NaN() : 2 * piece.points[i].x;
  const PointBatch found = in_subdomains(std::make_unique<PieceSource>(std::vector{piece}), 200);
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (std::isnan(found.values[0][i])) {
      EXPECT_EQ(found.value_moments[0][i].mass, 0);
    } else if (found.positions[i].x > 0 && found.positions[i].x < 9) {  // and a neighbour along x has a value
      EXPECT_LT(glm::distance(found.gradients[0][i], dvec3(2, 0, 0)), 1e-9);
    }
  }
}

}  // namespace
}  // namespace splatvol::test
