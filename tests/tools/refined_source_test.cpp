// Refined meshes keep the volume and the field, and add one point for each edge.
#include "tools/refined_source.h"

#include <gtest/gtest.h>

#include <limits>
#include <set>

#include "tests/builder/support/piece_source.h"
#include "tests/support/results.h"

namespace splatvol::test {
namespace {

double field(const dvec3& p) { return 1 + p.x - 2 * p.y + 3 * p.z; }

std::vector<Piece> pieces_of(Source& source) {
  std::vector<Piece> pieces;
  while (auto piece = source.next().value()) pieces.push_back(std::move(*piece));
  return pieces;
}

std::vector<Piece> refined(std::vector<Piece> pieces, int refinements) {
  return pieces_of(*refine(std::make_unique<PieceSource>(std::move(pieces)), refinements, "mesh"));
}

double volume(const Piece& piece) { return test::volume({piece.points, piece.tetrahedra}); }

TEST(Refine, KeepsVolumeAndField) {
  const Mesh mesh = jittered(3, 0.3);
  for (const int refinements : {1, 2, 3}) {
    const auto pieces = refined({mesh_piece(mesh, field)}, refinements);
    ASSERT_EQ(pieces.size(), 1u);
    const Piece& piece = pieces[0];
    ASSERT_EQ(piece.tetrahedra.size(), mesh.tetrahedra.size() << (3 * refinements));
    EXPECT_EQ(piece.census.tetrahedra, piece.tetrahedra.size());
    EXPECT_EQ(piece.census.cells.at("tetrahedron"), piece.tetrahedra.size());
    EXPECT_NEAR(volume(piece), test::volume(mesh), 1e-12);
    for (std::size_t i = 0; i < piece.points.size(); ++i)
      ASSERT_NEAR(piece.values[0][i], field(piece.points[i]), 1e-13);
  }
}

TEST(Refine, KeepsOrientation) {
  for (const Tetrahedron& corners : {Tetrahedron{0, 1, 2, 3}, {1, 0, 2, 3}}) {
    Piece one = mesh_piece({{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {corners}}, field);
    const auto pieces = refined({one}, 3);
    for (const auto& [a, b, c, d] : pieces.at(0).tetrahedra) {
      const auto& p = pieces[0].points;
      EXPECT_EQ(glm::dot(p[b] - p[a], glm::cross(p[c] - p[a], p[d] - p[a])) > 0, corners[0] == 0);
    }
  }
}

TEST(Refine, SplitsEachTetrahedronIntoEightEqualOnes) {
  const auto pieces = refined({mesh_piece(random_tetrahedra(1), field)}, 2);
  const Piece& piece = pieces.at(0);
  EXPECT_EQ(piece.points.size(), 35u);  // a tetrahedron with 5 points along each edge
  for (const auto& tetrahedron : piece.tetrahedra)
    EXPECT_NEAR(test::volume({piece.points, {tetrahedron}}), volume(piece) / 64, 1e-14);
}

TEST(Refine, MeetsAtCommonFaces) {
  // The corners and the middles of edges of n^3 cubes are the corners of (2 n)^3 cubes, each once.
  const auto pieces = refined({mesh_piece(lattice(3), field)}, 1);
  EXPECT_EQ(pieces.at(0).points.size(), 7u * 7 * 7);
}

TEST(Refine, PiecesRepeatTheirCommonPointsExactly) {
  const Piece whole = mesh_piece(jittered(4, 0.3), field);
  const auto at_once = refined({whole}, 1), in_parts = refined(cut(whole, 5), 1);
  ASSERT_EQ(in_parts.size(), 5u);
  std::set<std::array<double, 4>> different;
  std::size_t points = 0;
  for (const Piece& piece : in_parts)
    for (std::size_t i = 0; i < piece.points.size(); ++i, ++points)
      different.insert({piece.points[i].x, piece.points[i].y, piece.points[i].z, piece.values[0][i]});
  EXPECT_EQ(different.size(), at_once.at(0).points.size());
  EXPECT_GT(points, different.size());
}

TEST(Refine, LargePiecesComeInSeveral) {
  const auto source =
      refine(std::make_unique<PieceSource>(std::vector{mesh_piece(lattice(4), field), mesh_piece(lattice(2), field)}),
             5, "mesh");
  EXPECT_EQ(source->piece_count(), 2u);
  const auto pieces = pieces_of(*source);
  EXPECT_EQ(source->piece_count(), pieces.size());
  ASSERT_GT(pieces.size(), 3u);
  double sum = 0;
  std::size_t tetrahedra = 0;
  for (const Piece& piece : pieces) {
    EXPECT_LE(piece.tetrahedra.size(), 1'500'000u);
    tetrahedra += piece.tetrahedra.size();
    sum += volume(piece);
  }
  EXPECT_EQ(tetrahedra, (384u + 48) << 15);
  EXPECT_NEAR(sum, 2, 1e-9);
}

TEST(Refine, WhatAMissingValueHidesStaysHidden) {
  Piece piece = mesh_piece(random_tetrahedra(1), field);
  piece.values[0][2] = std::numeric_limits<double>::quiet_NaN();
  const auto pieces = refined({piece}, 3);
  const auto is_missing = [&](std::uint32_t point) { return std::isnan(pieces.at(0).values[0][point]); };
  for (const auto& tetrahedron : pieces.at(0).tetrahedra) EXPECT_TRUE(std::ranges::any_of(tetrahedron, is_missing));
  EXPECT_FALSE(is_missing(0));
}

TEST(Refine, PointsWithoutCellsAreRefused) {
  const auto source = refine(std::make_unique<PieceSource>(std::vector{scattered(random_points(10))}), 1, "mesh");
  EXPECT_THAT(source->next(), FailsWith(ErrorCode::invalid_data, "mesh: no cells with a volume"));
}

}  // namespace
}  // namespace splatvol::test
